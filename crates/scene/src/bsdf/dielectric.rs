//! The interface of a body of glass or water: exact Fresnel factors and refraction at facets
//! (Walter et al. 2007).

use glam::Vec3;

use super::fresnel::{Dielectric, at_normal, dielectric};

/// Indices are cut here: beyond, nothing but a fraction of a percent gets through.
const MAX_IOR: f32 = 1e3;

/// An interface between two indices.
///
/// Radiance scales by the square of the index: what crosses towards `wo` is multiplied by
/// `1 / eta^2`, `eta` the index on the side of `wi` over that on the side of `wo`. So for values
/// `f` of light that crosses, `f(wo, wi) n_i^2 = f(wi, wo) n_o^2`, and over a way in and out again
/// the factors cancel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interface {
    /// Index beyond over the index on the viewer's side.
    eta: f32,
    f0: f32,
    look: Dielectric,
}

/// How far a body of index `ior` is apart from the outside: 0 for index 1.
pub(super) fn contrast(ior: f32) -> f32 {
    ior.clamp(1.0, MAX_IOR) - 1.0
}

impl Interface {
    /// Between the outside (index 1) and a body of index `ior`, seen from outside where `entering`.
    pub(super) fn new(ior: f32, look: Dielectric, entering: bool) -> Interface {
        let ior = ior.clamp(1.0, MAX_IOR);
        let eta = if entering { ior } else { 1.0 / ior };
        Interface { eta, f0: at_normal(ior), look }
    }

    /// Index beyond over the index on the viewer's side.
    #[inline]
    pub(super) fn eta(&self) -> f32 {
        self.eta
    }

    /// Reflected share per channel and share let through (white), at the cosine between `wo` and
    /// the facet.
    ///
    /// Exact for the specular strength and colour 1. Else `KHR_materials_specular` moves the
    /// reflectance at normal incidence, the rest of the curve keeps its shape, and total reflection
    /// stays total.
    #[inline]
    pub(super) fn split(&self, cos: f32) -> (Vec3, f32) {
        let f = dielectric(cos, self.eta);
        if f >= 1.0 {
            return (Vec3::ONE, 0.0);
        }
        let rise = ((f - self.f0) / (1.0 - self.f0)).clamp(0.0, 1.0);
        let reflected = self.look.strength * (self.look.f0 + (Vec3::ONE - self.look.f0) * rise);
        (reflected, (1.0 - reflected.max_element()).max(0.0))
    }

    /// The direction that becomes `wo` by refraction at a facet `h` with `wo . h > 0`; `None` under
    /// total reflection.
    #[inline]
    pub(super) fn refract(&self, wo: Vec3, h: Vec3) -> Option<Vec3> {
        let cos = wo.dot(h);
        let sin2 = (1.0 - cos * cos).max(0.0) / (self.eta * self.eta);
        if sin2 >= 1.0 {
            return None;
        }
        Some(((cos / self.eta - (1.0 - sin2).sqrt()) * h - wo / self.eta).normalize())
    }

    /// The facet that refracts `wi` (below) into `wo` (above), with its two cosines (the second
    /// negative) and `d` with `wo + eta wi` of length `|d|` along it; `None` if no facet does.
    #[inline]
    pub(super) fn facet(&self, wo: Vec3, wi: Vec3) -> Option<Facet> {
        let h = (wo + self.eta * wi).normalize_or_zero();
        let h = if h.z < 0.0 { -h } else { h };
        let (cos_o, cos_i) = (wo.dot(h), wi.dot(h));
        let length = self.eta * cos_i + cos_o;
        // Seen or lit from behind, or equal indices.
        if cos_o <= 0.0 || cos_i >= 0.0 || length == 0.0 {
            return None;
        }
        Some(Facet { h, cos_o, jacobian: -cos_i / (length * length) })
    }
}

/// A refracting facet.
pub(super) struct Facet {
    /// Normal of the microfacet, a unit vector with positive z.
    pub h: Vec3,
    /// Cosine to `wo`, positive.
    pub cos_o: f32,
    /// Solid angle of normals per solid angle of `wi`, over `eta^2` (Walter et al. 2007, equation
    /// 17).
    pub jacobian: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLEAR: Dielectric = Dielectric { f0: Vec3::splat(0.04), strength: 1.0 };

    #[test]
    fn snell_and_back() {
        for entering in [true, false] {
            let interface = Interface::new(1.5, CLEAR, entering);
            let h = Vec3::new(0.2, -0.3, 0.9).normalize();
            let wo = Vec3::new(-0.1, 0.1, 0.8).normalize();
            let wi = interface.refract(wo, h).unwrap();
            let (sin_o, sin_i) = (wo.cross(h).length(), wi.cross(h).length());
            assert!((sin_o - interface.eta * sin_i).abs() < 1e-6);
            assert!((wo.cross(h) + interface.eta * wi.cross(h)).length() < 1e-6);
            let facet = interface.facet(wo, wi).unwrap();
            assert!((facet.h - h).length() < 1e-5);
        }
        assert!(
            Interface::new(1.5, CLEAR, false).refract(Vec3::new(0.8, 0.0, 0.6), Vec3::Z).is_none()
        );
    }

    /// The Jacobian against the change of `wi` when the facet turns.
    #[test]
    fn jacobian_is_the_change_of_solid_angle() {
        let interface = Interface::new(1.5, CLEAR, true);
        let h = Vec3::new(0.1, 0.2, 0.9).normalize();
        let wo = Vec3::new(-0.5, 0.1, 0.7).normalize();
        let (x, y) = pileus_math::basis(h);
        let step = 3e-3f32;
        let turned =
            |a: f32, b: f32| interface.refract(wo, (h + a * x + b * y).normalize()).unwrap();
        let dx = (turned(step, 0.0) - turned(-step, 0.0)) / (2.0 * step);
        let dy = (turned(0.0, step) - turned(0.0, -step)) / (2.0 * step);
        let area = dx.cross(dy).length();
        let facet = interface.facet(wo, turned(0.0, 0.0)).unwrap();
        let expected = facet.jacobian * interface.eta * interface.eta;
        assert!((area * expected - 1.0).abs() < 1e-3, "{area} {expected}");
    }

    #[test]
    fn specular_look_leaves_total_reflection() {
        let look = Dielectric { f0: Vec3::new(0.02, 0.04, 0.0), strength: 0.5 };
        let interface = Interface::new(1.5, look, false);
        assert_eq!(interface.split(0.3), (Vec3::ONE, 0.0));
        let (reflected, through) = interface.split(1.0);
        assert!((reflected - 0.5 * look.f0).abs().max_element() < 1e-6);
        assert!((through - 0.98).abs() < 1e-6);
    }
}
