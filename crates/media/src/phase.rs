//! Phase functions: the angular law of scattering, normalised over the sphere.

use crate::elementary::sin_cos_turn;
use glam::Vec3;
use std::f32::consts::PI;

/// 1 / (4 pi), the isotropic phase function, 1/sr.
pub const ISOTROPIC: f32 = 0.25 / PI;

/// Largest |g| of the Henyey-Greenstein phase function in single precision.
pub const MAX_G: f32 = 0.999;

/// A phase function. `cos_theta` is the cosine between the propagation directions before and after: 1 is forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// Equal in all directions.
    Isotropic,
    /// Henyey and Greenstein (1941) with mean cosine `g` in [-0.999, 0.999]; g > 0 scatters forward.
    HenyeyGreenstein {
        /// Mean cosine.
        g: f32,
    },
}

impl Phase {
    /// Henyey-Greenstein of mean cosine `g`, clamped to [-0.999, 0.999]; isotropic for g = 0.
    pub fn henyey_greenstein(g: f32) -> Phase {
        if g == 0.0 {
            Phase::Isotropic
        } else {
            Phase::HenyeyGreenstein { g: g.clamp(-MAX_G, MAX_G) }
        }
    }

    /// Mean cosine of the scattering angle.
    pub fn mean_cosine(&self) -> f32 {
        match *self {
            Phase::Isotropic => 0.0,
            Phase::HenyeyGreenstein { g } => g,
        }
    }

    /// Value, 1/sr; also the density with which [`Phase::sample`] draws (its samples have weight one).
    #[inline(always)]
    pub fn eval(&self, cos_theta: f32) -> f32 {
        match *self {
            Phase::Isotropic => ISOTROPIC,
            Phase::HenyeyGreenstein { g } => {
                henyey_greenstein(g.abs(), (1.0 - cos_theta.copysign(cos_theta * g)).max(0.0))
            }
        }
    }

    /// A direction for two random numbers in [0, 1), given the propagation direction `direction` (unit), and its density, 1/sr.
    #[inline(always)]
    pub fn sample(&self, direction: Vec3, u: [f32; 2]) -> (Vec3, f32) {
        let (cos_theta, sin_theta, pdf) = match *self {
            Phase::Isotropic => (1.0 - 2.0 * u[0], 2.0 * (u[0] * (1.0 - u[0])).sqrt(), ISOTROPIC),
            Phase::HenyeyGreenstein { g } => {
                let one_minus = henyey_greenstein_one_minus_cos(g.abs(), u[0]);
                let sin = (one_minus * (2.0 - one_minus)).sqrt();
                (
                    (1.0 - one_minus).copysign((1.0 - one_minus) * g),
                    sin,
                    henyey_greenstein(g.abs(), one_minus),
                )
            }
        };
        let (sin_phi, cos_phi) = sin_cos_turn(u[1]);
        let (x, y) = basis(direction);
        let wi = x * (sin_theta * cos_phi) + y * (sin_theta * sin_phi) + direction * cos_theta;
        // One Newton step keeps the direction a unit vector over thousands of scatterings.
        let wi = wi * (1.5 - 0.5 * wi.length_squared());
        (wi, pdf)
    }
}

/// `1 - cos` of the scattering angle for mean cosine `g` in [0, 1), by inversion.
///
/// With q = 1 - g + 2 g u the inverse is `cos = (1 + g^2 - ((1 - g^2) / q)^2) / (2 g)`; this form of `1 - cos` divides by no g
/// and loses no digits near the forward peak.
#[inline(always)]
fn henyey_greenstein_one_minus_cos(g: f32, u: f32) -> f32 {
    let q = 1.0 - g + 2.0 * g * u;
    (2.0 * (1.0 - g) * (1.0 - g) * (1.0 - u) * (1.0 + g * u) / (q * q)).clamp(0.0, 2.0)
}

/// Value of Henyey-Greenstein for `g` in [0, 1) and `one_minus_cos = 1 - cos_theta`.
#[inline(always)]
fn henyey_greenstein(g: f32, one_minus_cos: f32) -> f32 {
    // (1-g)^2 + 2g(1-cos) loses no digits near the forward peak, where 1 + g^2 - 2g cos cancels.
    let d = (1.0 - g) * (1.0 - g) + 2.0 * g * one_minus_cos;
    ISOTROPIC * (1.0 - g * g) / (d * d.sqrt())
}

/// Two unit vectors that form a right-handed orthonormal basis with the unit vector `n` (Duff et al. 2017).
#[inline(always)]
pub fn basis(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::uniform;
    use rand_pcg::Pcg32;

    const GS: [f32; 9] = [-0.999, -0.9, -0.5, -1e-4, 1e-4, 0.3, 0.8, 0.95, 0.999];

    #[test]
    fn normalised_with_the_stated_mean_cosine() {
        for g in GS {
            let phase = Phase::henyey_greenstein(g);
            // Substitution 1 - c = 2 x^3 (mirrored for g < 0) resolves the peak.
            let n = 200_000;
            let (mut total, mut mean) = (0.0f64, 0.0f64);
            for i in 0..n {
                let x = (f64::from(i) + 0.5) / f64::from(n);
                let one_minus = 2.0 * x.powi(3);
                let weight = 6.0 * x * x / f64::from(n) * std::f64::consts::TAU;
                let cos = if g >= 0.0 { 1.0 - one_minus } else { one_minus - 1.0 };
                let value = f64::from(henyey_greenstein(g.abs(), one_minus as f32));
                assert!((f64::from(phase.eval(cos as f32)) - value).abs() <= 0.13 * value + 1e-6);
                total += value * weight;
                mean += cos * value * weight;
            }
            assert!((total - 1.0).abs() < 1e-4, "g {g}: total {total}");
            assert!((mean - f64::from(g)).abs() < 1e-4, "g {g}: mean cosine {mean}");
        }
    }

    /// Null hypothesis: cosines of samples fall into 64 bins of equal probability. Chi-square with 63 degrees of freedom,
    /// false alarm 1e-7 per case (critical value 150).
    #[test]
    fn samples_follow_the_density() {
        for (k, g) in GS.into_iter().chain([0.0]).enumerate() {
            let phase = Phase::henyey_greenstein(g);
            let mut rng = Pcg32::new(k as u64, 7);
            let mut bins = [0u32; 64];
            let n = 640_000;
            let axis = Vec3::new(0.36, -0.48, 0.8);
            let mut mean_phi = Vec3::ZERO;
            for _ in 0..n {
                let (wi, pdf) = phase.sample(axis, [uniform(&mut rng), uniform(&mut rng)]);
                assert!(pdf > 0.0 && (wi.length() - 1.0).abs() < 1e-5);
                mean_phi += wi;
                // Cumulative distribution in f64: (1-g^2)/(2g) (1/(1-g) ... ), by the distance form.
                let gd = f64::from(g.abs());
                let peak = if g < 0.0 { -axis } else { axis };
                let one_minus = 0.5 * (wi - peak).as_dvec3().length_squared();
                let u = if gd.abs() < 1e-9 {
                    1.0 - 0.5 * one_minus
                } else {
                    let d = ((1.0 - gd) * (1.0 - gd) + 2.0 * gd * one_minus).sqrt();
                    (1.0 - gd * gd) / (2.0 * gd) * (1.0 / d - 1.0 / (1.0 + gd))
                };
                bins[((u * 64.0) as usize).min(63)] += 1;
            }
            let expected = f64::from(n) / 64.0;
            let chi2: f64 =
                bins.iter().map(|&b| (f64::from(b) - expected).powi(2) / expected).sum();
            assert!(chi2 < 150.0, "g {g}: chi2 {chi2}");
            let mean = mean_phi / n as f32;
            assert!((mean - axis * g).length() < 0.005, "g {g}: mean {mean}");
        }
    }

    #[test]
    fn basis_is_orthonormal() {
        let mut rng = Pcg32::new(3, 3);
        for _ in 0..10_000 {
            let n = Phase::Isotropic.sample(Vec3::Z, [uniform(&mut rng), uniform(&mut rng)]).0;
            let (x, y) = basis(n);
            assert!((x.cross(y) - n).length() < 1e-5);
            assert!(x.dot(y).abs() < 1e-6 && (x.length() - 1.0).abs() < 1e-5);
        }
    }
}
