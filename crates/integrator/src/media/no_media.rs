//! No volume: flights go on to the next surface, shadow rays lose nothing.

use super::channels::{CoupledFlight, FlightUnderWay, Grey, NeverDecoupled};
use super::{Collision, FlightEnd, Media, Ray, RaySegment, Shadow};
use glam::{DVec3, Vec3};
use pileus_media::{PhaseAt, Tally};
use rand_core::Rng;

/// There is none.
pub(crate) struct NoMedia;

impl Media for NoMedia {
    type Channels = Grey;

    #[inline(always)]
    fn flight<R: Rng + Clone>(
        &self,
        _: RaySegment<'_>,
        beta: Vec3,
        _: Option<[f32; 2]>,
        decoupled: &mut NeverDecoupled<f32>,
        _: &mut R,
        _: &mut Tally,
    ) -> FlightEnd<f32> {
        CoupledFlight::begin(beta).end(None, decoupled)
    }

    #[inline(always)]
    fn transmittance<R: Rng + Clone>(
        &self,
        _: RaySegment<'_>,
        _: f32,
        _: Vec3,
        _: &mut R,
        _: &mut Tally,
    ) -> Shadow {
        Shadow::CLEAR
    }

    #[inline(always)]
    fn scattering<R: Rng + Clone>(
        &self,
        _: DVec3,
        _: Vec3,
        _: &mut R,
        _: impl FnMut(Vec3, PhaseAt<'_>),
    ) {
    }

    #[inline(always)]
    fn extent(&self, _: &Ray, _: f64) -> Option<(f64, f64)> {
        None
    }

    #[inline(always)]
    fn properties<R: Rng + Clone>(
        &self,
        _: &Collision,
        _: DVec3,
        _: Vec3,
        _: &mut R,
    ) -> (PhaseAt<'_>, Vec3) {
        // Nothing collides.
        (PhaseAt::Isotropic, Vec3::ZERO)
    }

    #[inline(always)]
    fn starts_matter(&self) -> bool {
        false
    }
}
