//! What a render hears of its paths: counters, and what the film's layers ask for.

use crate::counters::Counters;
use crate::kernel::{LayerRecorder, Recorder};
use glam::{DVec3, Vec3};
use pileus_film::{FirstEvent, PathRecord};
use pileus_media::Medium;
use pileus_scene::{Interaction, Projection, Scene};

/// Counters, and the record of the path at hand where layers ask for it.
pub(crate) struct RenderRecorder<'a> {
    pub(crate) counters: Counters,
    pub(crate) layers: Option<SceneRecord<'a>>,
}

impl Recorder for RenderRecorder<'_> {
    #[inline(always)]
    fn counters(&mut self) -> &mut Counters {
        &mut self.counters
    }

    #[inline(always)]
    fn layers(&mut self) -> Option<&mut dyn LayerRecorder> {
        match &mut self.layers {
            Some(layers) => Some(layers),
            None => None,
        }
    }
}

/// The record of a path in a scene.
pub(crate) struct SceneRecord<'a> {
    scene: &'a Scene,
    path: PathRecord,
}

impl<'a> SceneRecord<'a> {
    pub(crate) fn new(scene: &'a Scene) -> SceneRecord<'a> {
        SceneRecord { scene, path: PathRecord::EMPTY }
    }

    /// What the path told; the next one begins.
    pub(crate) fn take(&mut self) -> PathRecord {
        std::mem::take(&mut self.path)
    }

    /// Scales the light that it told, as that of the sample.
    pub(crate) fn scale_light(&mut self, factor: f32) {
        self.path.scale_light(factor);
    }

    fn first(&mut self, p: DVec3, beta: Vec3, normal: Vec3, albedo: Vec3) {
        let camera = &self.scene.camera;
        let depth = match camera.projection() {
            Projection::Panorama => (p - camera.position()).length(),
            _ => camera.depth(p),
        };
        let event = FirstEvent {
            depth: depth as f32,
            position: p.as_vec3().to_array(),
            normal: normal.to_array(),
            albedo: albedo.to_array(),
        };
        self.path.add_first_event(beta.element_sum() * (1.0 / 3.0), &event);
    }
}

impl LayerRecorder for SceneRecord<'_> {
    #[inline(never)]
    fn light(&mut self, radiance: Vec3, scatterings: u32) {
        self.path.add_light(radiance.to_array(), scatterings);
    }

    #[inline(never)]
    fn escape(&mut self, radiance: Vec3, scatterings: u32) {
        self.path.add_light_of_environment(radiance.to_array(), scatterings);
    }

    #[inline(never)]
    fn transmittance(&mut self, beta: Vec3) {
        for (sum, beta) in self.path.transmittance.iter_mut().zip(beta.to_array()) {
            *sum += beta;
        }
    }

    #[inline(never)]
    fn first_in_medium(&mut self, p: DVec3, incoming: Vec3, beta: Vec3, albedo: Vec3) {
        let volumes = self.scene.volumes.iter();
        let rise: DVec3 = volumes.map(|volume| gradient(&volume.medium, p)).sum();
        let normal = (-rise).try_normalize().map_or(-incoming, DVec3::as_vec3);
        self.first(p, beta, normal, albedo);
    }

    #[inline(never)]
    fn first_at_surface(&mut self, surface: &Interaction, beta: Vec3) {
        let normal = surface.shading_normal;
        let normal = if surface.front_face { normal } else { -normal };
        self.first(surface.p, beta, normal, surface.parameters.base_color);
    }
}

/// Gradient of the extinction of a grid, 1/length^2: central differences over one voxel along each
/// of its axes. Zero in a medium without a grid.
fn gradient(medium: &Medium, p: DVec3) -> DVec3 {
    let Some(grid) = medium.grid() else { return DVec3::ZERO };
    if medium.bounds_world().is_some_and(|bounds| !bounds.contains(p)) {
        return DVec3::ZERO;
    }
    let voxels = grid.index_to_world().matrix3;
    let rise = |axis: DVec3| medium.sigma_t_at(p + 0.5 * axis) - medium.sigma_t_at(p - 0.5 * axis);
    let along = DVec3::from_array([voxels.x_axis, voxels.y_axis, voxels.z_axis].map(rise));
    // Differences transform as the gradient does: with the inverse transposed.
    let gradient = voxels.inverse().transpose() * along;
    if gradient.is_finite() { gradient } else { DVec3::ZERO }
}
