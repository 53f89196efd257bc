//! What an interface reflects: Schlick's approximation and the exact equations for dielectrics.

use glam::Vec3;

/// `(1 - cos)^5` for a cosine in [0, 1]: how far Schlick's reflectance has come from normal to
/// grazing incidence (Schlick 1994).
#[inline]
pub(super) fn schlick(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Mean of [`schlick`] over the hemisphere, weighted by the cosine.
pub(super) const SCHLICK_AVERAGE: f32 = 1.0 / 21.0;

/// Reflectance at normal incidence of a dielectric of this index, at least 1; 1 for an infinite
/// index.
#[inline]
pub(super) fn at_normal(ior: f32) -> f32 {
    if ior.is_finite() {
        let r = (ior - 1.0) / (ior + 1.0);
        r * r
    } else {
        1.0
    }
}

/// Reflectance of a smooth dielectric for unpolarised light, exact (Fresnel); 1 under total
/// internal reflection.
///
/// `cos` is the cosine of incidence in [0, 1], `eta` the index beyond the interface over the index
/// on this side.
#[inline]
pub(super) fn dielectric(cos: f32, eta: f32) -> f32 {
    if eta == 1.0 {
        return 0.0;
    }
    let cos = cos.clamp(0.0, 1.0);
    let sin2 = (1.0 - cos * cos) / (eta * eta);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let cos_beyond = (1.0 - sin2).sqrt();
    let s = (cos - eta * cos_beyond) / (cos + eta * cos_beyond);
    let p = (eta * cos - cos_beyond) / (eta * cos + cos_beyond);
    0.5 * (s * s + p * p)
}

/// Reflectance of glTF's dielectric after Schlick, with `KHR_materials_specular`:
/// `strength (f0 + (1 - f0) schlick)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dielectric {
    /// Reflectance at normal incidence, in [0, 1] per channel.
    pub f0: Vec3,
    /// Factor on the whole, in [0, 1].
    pub strength: f32,
}

impl Dielectric {
    /// The largest channel of the reflectance at normal incidence: what is let through is white, as
    /// the extension wants it.
    #[inline]
    pub(super) fn f0_max(&self) -> f32 {
        self.f0.max_element()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_reflectances() {
        assert!((dielectric(1.0, 1.5) - 0.04).abs() < 1e-6);
        assert!((dielectric(1.0, 1.0 / 1.5) - 0.04).abs() < 1e-6);
        assert!((at_normal(1.5) - 0.04).abs() < 1e-6);
        assert_eq!(at_normal(f32::INFINITY), 1.0);
        // 60 degrees into glass: Rs = ((1/2 - sqrt(3/2)) / (1/2 + sqrt(3/2)))^2 with 1.5 cos_t =
        // sqrt(3/2).
        let (c, t) = (0.5f64, 1.5f64.sqrt());
        let (s, p) = ((c - t) / (c + t), (2.25 * c - t) / (2.25 * c + t));
        assert!((f64::from(dielectric(0.5, 1.5)) - 0.5 * (s * s + p * p)).abs() < 1e-6);
    }

    #[test]
    fn brewster_and_total_reflection() {
        // At Brewster's angle, tan = n, the reflected light is s-polarised only: half of ((n^2 - 1)
        // / (n^2 + 1))^2.
        let n = 1.5f32;
        let cos = 1.0 / (1.0 + n * n).sqrt();
        let s = (n * n - 1.0) / (n * n + 1.0);
        assert!((dielectric(cos, n) - 0.5 * s * s).abs() < 1e-6);
        let critical = (1.0 - 1.0 / (n * n)).sqrt();
        assert_eq!(dielectric(critical - 1e-3, 1.0 / n), 1.0);
        assert!(dielectric(critical + 1e-3, 1.0 / n) < 1.0);
    }

    #[test]
    fn the_same_from_both_sides() {
        for i in 1..100 {
            let (cos, n) = (i as f32 / 100.0, 1.7f32);
            let beyond = (1.0 - (1.0 - cos * cos) / (n * n)).sqrt();
            assert!((dielectric(cos, n) - dielectric(beyond, 1.0 / n)).abs() < 1e-5);
        }
    }

    #[test]
    fn average_of_schlick() {
        let n = 10_000;
        let mean: f64 = (0..n)
            .map(|i| {
                let mu = (f64::from(i) + 0.5) / f64::from(n);
                2.0 * mu * f64::from(schlick(mu as f32)) / f64::from(n)
            })
            .sum();
        assert!((mean - f64::from(SCHLICK_AVERAGE)).abs() < 1e-6);
    }
}
