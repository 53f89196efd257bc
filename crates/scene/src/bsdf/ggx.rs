//! The microfacet distribution of Trowbridge and Reitz (1975), named GGX by Walter et al. (2007).

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;
use pileus_math::elementary::sin_cos_turn;

/// Widths below this are a perfectly smooth surface.
pub(super) const SMOOTH: f32 = 1e-3;

/// Isotropic GGX with height-correlated Smith shadowing. Directions are local: unit vectors, z
/// along the shading normal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ggx {
    /// Width, in [`SMOOTH`, 1].
    alpha: f32,
    alpha2: f32,
}

impl Ggx {
    /// The distribution of a perceptual roughness in [0, 1]; `None` where the surface is perfectly
    /// smooth.
    #[inline]
    pub(super) fn new(roughness: f32) -> Option<Ggx> {
        let alpha = roughness * roughness;
        (alpha >= SMOOTH).then(|| Ggx::of_width(alpha))
    }

    /// The distribution of a width, for tables that reach down to zero.
    #[inline]
    pub(super) fn of_width(alpha: f32) -> Ggx {
        Ggx { alpha, alpha2: alpha * alpha }
    }

    /// Width.
    #[inline]
    pub(super) fn alpha(&self) -> f32 {
        self.alpha
    }

    /// Density of normals `h` (z not negative): its integral weighted by the cosine is 1.
    #[inline]
    pub(super) fn density(&self, h: Vec3) -> f32 {
        // From the sine: 1 - z^2 would lose all digits where alpha is small.
        let slope = (h.x * h.x + h.y * h.y) / self.alpha2 + h.z * h.z;
        FRAC_1_PI / (self.alpha2 * slope * slope)
    }

    /// `sqrt(alpha^2 + (1 - alpha^2) cos^2)`: the root in Smith's functions, times the cosine.
    #[inline]
    fn root(&self, cos: f32) -> f32 {
        (self.alpha2 + (1.0 - self.alpha2) * cos * cos).sqrt()
    }

    /// Share of facets seen and lit over `4 cos_o cos_i`, height-correlated (Heitz 2014, equation
    /// 99); cosines positive.
    #[inline]
    pub(super) fn visibility(&self, cos_o: f32, cos_i: f32) -> f32 {
        0.5 / (cos_i * self.root(cos_o) + cos_o * self.root(cos_i))
    }

    /// Density of normals that `sample` draws, over `4 cos(wo, h)`: the density of a mirrored
    /// direction per solid angle.
    #[inline]
    pub(super) fn pdf_mirrored(&self, cos_o: f32, h: Vec3) -> f32 {
        self.density(h) * 0.5 / (cos_o + self.root(cos_o))
    }

    /// Value times cosine over density of a mirrored direction: what [`Ggx::sample`] loses to
    /// shadowing, at most 1.
    #[inline]
    pub(super) fn weight_mirrored(&self, cos_o: f32, cos_i: f32) -> f32 {
        self.visibility(cos_o, cos_i) * cos_i * 2.0 * (cos_o + self.root(cos_o))
    }

    /// Draws a normal among those that `wo` sees, proportional to their projected area (Dupuy and
    /// Benyoub 2023: spherical caps).
    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: [f32; 2]) -> Vec3 {
        sample_visible(self.alpha, wo, u)
    }
}

/// Draws a normal among those that `wo` sees, for a distribution of any width `alpha`, zero
/// included; `u` is uniform in [0, 1)^2. [`Ggx::sample`] is this for widths above its limit.
#[inline]
pub(super) fn sample_visible(alpha: f32, wo: Vec3, u: [f32; 2]) -> Vec3 {
    let stretched = Vec3::new(alpha * wo.x, alpha * wo.y, wo.z).normalize();
    let (sin, cos) = sin_cos_turn(u[0]);
    // z is uniform in (-stretched.z, 1]; its distance from 1 is kept so that the sine has all its
    // digits.
    let below_one = u[1] * (1.0 + stretched.z);
    let radius = (below_one * (2.0 - below_one)).max(0.0).sqrt();
    let cap = Vec3::new(radius * cos, radius * sin, 1.0 - below_one);
    let h = cap + stretched;
    Vec3::new(alpha * h.x, alpha * h.y, h.z.max(0.0)).normalize_or(Vec3::Z)
}

/// A direction about z with density `cos / pi`.
#[inline]
pub(super) fn sample_cosine(u: [f32; 2]) -> Vec3 {
    let (sin, cos) = sin_cos_turn(u[0]);
    let radius = u[1].sqrt();
    Vec3::new(radius * cos, radius * sin, (1.0 - u[1]).max(0.0).sqrt())
}

/// A direction about z, uniform over the hemisphere.
#[inline]
pub(super) fn sample_hemisphere(u: [f32; 2]) -> Vec3 {
    let (sin, cos) = sin_cos_turn(u[0]);
    let radius = (u[1] * (2.0 - u[1])).sqrt();
    Vec3::new(radius * cos, radius * sin, 1.0 - u[1])
}

/// Density of [`sample_hemisphere`].
pub(super) const HEMISPHERE: f32 = 0.5 / PI;

#[cfg(test)]
mod tests {
    use super::*;

    /// Quadrature over normals, resolved near the pole: `sum f(h) dh`.
    fn over_normals(alpha: f32, f: impl Fn(Vec3) -> f64) -> f64 {
        let (n, m) = (2000, 96);
        let mut sum = 0.0;
        for k in 0..n {
            // tan = alpha t / (1 - t) spreads the peak.
            let t = (f64::from(k) + 0.5) / f64::from(n);
            let tan = f64::from(alpha) * t / (1.0 - t);
            let theta = tan.atan();
            let dtheta = f64::from(alpha) / ((1.0 - t) * (1.0 - t)) / (1.0 + tan * tan);
            for j in 0..m {
                let phi = (f64::from(j) + 0.5) / f64::from(m) * std::f64::consts::TAU;
                let h = Vec3::new(
                    (theta.sin() * phi.cos()) as f32,
                    (theta.sin() * phi.sin()) as f32,
                    theta.cos() as f32,
                );
                let dh = theta.sin() * dtheta * std::f64::consts::TAU / f64::from(n * m);
                sum += f(h) * dh;
            }
        }
        sum
    }

    #[test]
    fn normals_project_to_one() {
        for roughness in [0.04f32, 0.2, 0.5, 1.0] {
            let ggx = Ggx::new(roughness).unwrap();
            let total = over_normals(ggx.alpha, |h| f64::from(ggx.density(h) * h.z));
            assert!((total - 1.0).abs() < 1e-4, "roughness {roughness}: {total}");
            // Visible normals, from any side, also: the masking function is Smith's.
            for cos in [0.05f32, 0.5, 0.95] {
                let o = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                let total = over_normals(ggx.alpha, |h| {
                    f64::from(ggx.pdf_mirrored(cos, h) * 4.0 * o.dot(h).max(0.0))
                });
                assert!((total - 1.0).abs() < 2e-3, "roughness {roughness}, cos {cos}: {total}");
            }
        }
    }

    #[test]
    fn smooth_is_the_limit() {
        assert!(Ggx::new(0.03).is_none());
        assert!(Ggx::new(0.032).is_some());
        let o = Vec3::new(0.6, 0.0, 0.8);
        assert!((sample_visible(0.0, o, [0.3, 0.7]) - Vec3::Z).length() < 1e-7);
    }
}
