//! What is told of a path while it is traced: its counters, and to a prepass more. Renders compile
//! none of the rest.

use crate::counters::Counters;
use crate::media::Ray;
use glam::{DVec3, Vec3};

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

impl Recorder for Counters {
    #[inline(always)]
    fn counters(&mut self) -> &mut Counters {
        self
    }
}
