//! Surfaces that let light go straight on, and those that do not: what shadow rays to lights
//! without extent have to know.

use std::collections::BTreeMap;

use super::{Hit, Surfaces};
use crate::bsdf::Passing;

/// A material that lets light through, but not straight on.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// Name of the material; empty if it has none.
    pub name: String,
    /// Whether it bends light into one direction, so that no path finds a light without extent
    /// behind it; else it scatters light, and paths find the light from the surface.
    pub bends: bool,
    /// Index of refraction, at least 1.
    pub ior: f32,
    /// Perceptual roughness at most, in [0, 1].
    pub roughness: f32,
}

impl Surfaces {
    /// Whether light may go straight through some surface: a smooth thin wall, or a body of index 1
    /// exactly. It is said of materials; what a point lets through, which may be nothing, is what
    /// [`Bsdf::straight_through`](crate::Bsdf::straight_through) says.
    pub fn has_panes(&self) -> bool {
        self.has_panes
    }

    /// Whether light may go straight through the surface that was hit.
    #[inline]
    pub fn may_pass_straight(&self, hit: &Hit) -> bool {
        let mesh = &self.meshes[self.instances[hit.instance as usize].mesh];
        let part = mesh.part(hit.triangle as usize);
        self.material(part).may_pass_straight(part.solid)
    }

    /// The materials of panes by name, each once.
    pub fn panes(&self) -> Vec<String> {
        let parts = self.meshes.iter().flat_map(|mesh| &mesh.parts);
        let panes = parts.filter(|part| self.material(part).may_pass_straight(part.solid));
        let by_number: BTreeMap<u32, String> =
            panes.map(|part| (part.material, self.material(part).name.clone())).collect();
        by_number.into_values().collect()
    }

    /// The materials that let light through, but bent or scattered, each once.
    pub fn obstacles(&self) -> Vec<Obstacle> {
        let mut found = BTreeMap::new();
        for part in self.meshes.iter().flat_map(|mesh| &mesh.parts) {
            let material = self.material(part);
            let bends = match material.passing_at_most(part.solid) {
                Some(Passing::Bent) => true,
                Some(Passing::Scattered) => false,
                Some(Passing::Straight) | None => continue,
            };
            let obstacle = Obstacle {
                name: material.name.clone(),
                bends,
                ior: material.ior,
                roughness: material.roughness.clamp(0.0, 1.0),
            };
            found.insert((part.material, bends), obstacle);
        }
        found.into_values().collect()
    }

    pub(super) fn find_panes(&mut self) {
        let mut parts = self.meshes.iter().flat_map(|mesh| &mesh.parts);
        self.has_panes = parts.any(|part| self.material(part).may_pass_straight(part.solid));
    }
}
