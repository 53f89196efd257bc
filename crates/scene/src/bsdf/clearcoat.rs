//! A thin varnish of index 1.5 over everything else (`KHR_materials_clearcoat`).

use glam::Vec3;

use super::compensation::ReflectionAlbedo;
use super::fresnel::schlick;
use super::ggx::Ggx;

/// Reflectance of the varnish at normal incidence.
const F0: f32 = 0.04;

/// A colourless reflection. What it lets through is not bent, as the extension has it.
///
/// Light between the varnish and what is below bounces in reality; here the layers below are scaled
/// by `min(1 - E(o), 1 - E(i))`, reciprocal and never above what is left.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clearcoat {
    strength: f32,
    ggx: Option<Ggx>,
    albedo: ReflectionAlbedo,
}

impl Clearcoat {
    /// `None` where there is no coat.
    pub(super) fn new(strength: f32, roughness: f32) -> Option<Clearcoat> {
        (strength > 0.0).then(|| {
            let ggx = Ggx::new(roughness);
            let albedo = ReflectionAlbedo::new(roughness, ggx);
            Clearcoat { strength: strength.min(1.0), ggx, albedo }
        })
    }

    /// The distribution of its facets; `None` for a mirror.
    #[inline]
    pub(super) fn ggx(&self) -> Option<&Ggx> {
        self.ggx.as_ref()
    }

    /// Fresnel factor at the cosine between direction and facet.
    #[inline]
    pub(super) fn fresnel(&self, cos: f32) -> f32 {
        self.strength * (F0 + (1.0 - F0) * schlick(cos))
    }

    /// Directional albedo: also what the layers below lose.
    #[inline]
    pub(super) fn albedo(&self, cos: f32) -> f32 {
        self.strength * pair(self.albedo.at(cos))
    }

    /// Mean albedo over the hemisphere.
    pub(super) fn average(&self) -> Vec3 {
        Vec3::splat(self.strength * pair(self.albedo.average()))
    }
}

#[inline]
fn pair([one, grazing]: [f32; 2]) -> f32 {
    F0 * one + (1.0 - F0) * grazing
}
