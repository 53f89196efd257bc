//! What is told of a path while it is traced: its counters, to a prepass more, and what layers ask
//! for. Renders compile none of what a prepass hears, and ask once an event whether some layer does.

use crate::counters::Counters;
use crate::media::Ray;
use glam::{DVec3, Vec3};
use pileus_scene::Interaction;

/// Light of one shadow ray, as a prepass learns from it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DirectLight {
    /// Probability with which the ray was sent.
    pub(crate) survival: f32,
    /// Largest transmittance of any channel.
    pub(crate) transmittance: f32,
    /// Luminance that would be scattered if scattering were isotropic and nothing in the way.
    pub(crate) unshadowed: f32,
}

/// Hears what a path does.
pub(crate) trait Recorder {
    /// Where events are counted.
    fn counters(&mut self) -> &mut Counters;

    /// Who hears what layers ask for, if any does.
    #[inline(always)]
    fn layers(&mut self) -> Option<&mut dyn LayerRecorder> {
        None
    }

    /// A flight along `ray` that ended at `length`.
    #[inline(always)]
    fn flight(&mut self, _ray: &Ray, _length: f64) {}

    /// A shadow ray, with the product below which its walk undergoes Russian roulette.
    #[inline(always)]
    fn shadow_ray(&mut self, _ray: &Ray, _length: f64, _threshold: f32) {}

    /// What a shadow ray from the medium interaction at hand brought.
    #[inline(always)]
    fn direct_light(&mut self, _light: DirectLight) {}

    /// A medium interaction at `p` has been lit, with throughput `beta` behind it; `radiance`: of
    /// the path until now.
    #[inline(always)]
    fn medium_interaction(&mut self, _p: DVec3, _beta: Vec3, _radiance: Vec3) {}
}

/// Hears what layers ask for.
pub(crate) trait LayerRecorder {
    /// Light that was scattered so often on its way.
    fn light(&mut self, radiance: Vec3, scatterings: u32);

    /// Light of the environment that was scattered so often on its way.
    fn escape(&mut self, radiance: Vec3, scatterings: u32);

    /// A path that met nothing sees this share of the background.
    fn transmittance(&mut self, beta: Vec3);

    /// The first event: in a medium at `p`, met with throughput `beta` from direction `incoming`.
    fn first_in_medium(&mut self, p: DVec3, incoming: Vec3, beta: Vec3, albedo: Vec3);

    /// The first event: at a surface.
    fn first_at_surface(&mut self, surface: &Interaction, beta: Vec3);
}
