//! One grid: the events of most clouds. No list of media, no choice of voxel type or method:
//! flights by tentative collisions, shadow rays by ratio tracking.

use super::channels::{ChannelMode, FlightUnderWay};
use super::collisions::OneMedium;
use super::{Collision, FlightEnd, Media, Ray, RaySegment, Shadow};
use glam::{DVec3, Vec3};
use pileus_media::kernel::{GridShape, Voxel};
use pileus_media::transmittance::ratio_tracking_with_roulette;
use pileus_media::{ChromaticRatio, Grey, Medium, PhaseAt, Tally, TentativeCollisions};
use rand_core::Rng;
use std::marker::PhantomData;

/// Which phase functions a kernel is compiled for.
pub(crate) trait PhaseAxis: Sync {
    /// The phase function at a point of a medium, for light that arrives along `incoming`.
    fn at<'a, R: Rng + Clone>(
        medium: &'a Medium,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> PhaseAt<'a>;
}

/// Isotropic or Henyey-Greenstein, the same everywhere: part of the kernel's own code.
pub(crate) struct IsotropicOrHenyeyGreenstein;

impl PhaseAxis for IsotropicOrHenyeyGreenstein {
    #[inline(always)]
    fn at<'a, R: Rng + Clone>(medium: &'a Medium, _: DVec3, _: Vec3, _: &mut R) -> PhaseAt<'a> {
        medium.phase().hg_or_isotropic().unwrap_or(PhaseAt::Isotropic)
    }
}

/// Any phase function.
pub(crate) struct AnyPhase;

impl PhaseAxis for AnyPhase {
    #[inline(always)]
    fn at<'a, R: Rng + Clone>(
        medium: &'a Medium,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> PhaseAt<'a> {
        medium.phase_at(p_world, incoming, rng)
    }
}

/// One grid medium with voxels of type `V`, on the majorants that every grid has by default.
pub(crate) struct OneGrid<'a, V, C, P> {
    pub(crate) medium: &'a Medium,
    pub(crate) grid: &'a GridShape,
    pub(crate) voxels: &'a [V],
    pub(crate) channels: C,
    pub(crate) phase: PhantomData<P>,
}

impl<V: Voxel, C: ChannelMode, P: PhaseAxis> Media for OneGrid<'_, V, C, P> {
    type Channels = C;

    #[inline(always)]
    fn flight<R: Rng + Clone>(
        &self,
        RaySegment { ray, t_max, .. }: RaySegment<'_>,
        beta: Vec3,
        first: Option<[f32; 2]>,
        decoupled: &mut C::Decoupled,
        rng: &mut R,
        tally: &mut Tally,
    ) -> FlightEnd<C::Nulls> {
        let mut flight = C::Flight::begin(beta);
        let ratio = self.medium.chromatic_ratio();
        let share = if C::GREY { 1.0 } else { self.channels.share(&flight, ratio) };
        if (C::GREY || share > 0.0)
            && let Some(span) = self.grid.span(ray.origin, ray.direction, t_max)
        {
            let field = self.grid.ray(self.voxels, &span, share);
            let (walk, decision) = match first {
                Some([depth, u]) => (TentativeCollisions::with_first(field, depth), Some(u)),
                None => (TentativeCollisions::new(field), None),
            };
            let ratio = if C::GREY { Vec3::ONE } else { ratio / share };
            let t_enter = span.t_enter;
            let collisions = OneMedium { walk, medium: 0, t_enter, ratio, weighted: true };
            self.channels.fly(&mut flight, collisions, decision, rng, tally);
        }
        flight.end(None, decoupled)
    }

    #[inline(always)]
    fn transmittance<R: Rng + Clone>(
        &self,
        RaySegment { ray, t_max, .. }: RaySegment<'_>,
        threshold: f32,
        beta: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        let ratio = self.medium.chromatic_ratio();
        let Some((share, ratios)) = self.channels.shadow_ratios(beta, ratio) else {
            return Shadow::CLEAR;
        };
        let Some(span) = self.grid.span(ray.origin, ray.direction, t_max) else {
            return Shadow::CLEAR;
        };
        let walk = TentativeCollisions::new(self.grid.ray(self.voxels, &span, share));
        if C::GREY {
            let estimate = ratio_tracking_with_roulette(walk, Grey, threshold, rng, tally);
            return Shadow {
                transmittance: Vec3::splat(estimate.transmittance),
                null_probability: Vec3::splat(estimate.null_probability),
            };
        }
        let estimate =
            ratio_tracking_with_roulette(walk, ChromaticRatio(ratios), threshold, rng, tally);
        Shadow {
            transmittance: estimate.transmittance,
            null_probability: estimate.null_probability,
        }
    }

    fn scattering<R: Rng + Clone>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
        mut visit: impl FnMut(Vec3, PhaseAt<'_>),
    ) {
        let sigma_t = self.medium.sigma_t_at(p_world) as f32;
        if sigma_t > 0.0 {
            let sigma_s = self.medium.albedo_at(p_world) * self.medium.chromatic_ratio();
            visit(sigma_s * sigma_t, P::at(self.medium, p_world, incoming, rng));
        }
    }

    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)> {
        self.grid.span(ray.origin, ray.direction, t_max).map(|span| span.extent())
    }

    #[inline(always)]
    fn properties<R: Rng + Clone>(
        &self,
        _: &Collision,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> (PhaseAt<'_>, Vec3) {
        (P::at(self.medium, p_world, incoming, rng), self.medium.albedo_at(p_world))
    }

    #[inline(always)]
    fn starts_matter(&self) -> bool {
        false
    }
}
