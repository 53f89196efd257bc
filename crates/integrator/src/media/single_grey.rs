//! One grid of grey extinction: the kernel of most clouds. No channels, no list of media, no choice of voxel type.

use super::{Collision, Flown, Media, Ray, Shadow};
use glam::{DVec3, Vec3};
use pileus_media::distance::{Flight, delta_tracking};
use pileus_media::transmittance::{Estimator, ratio_tracking_with_roulette};
use pileus_media::{Grey, GridMedium, Phase, Span, Tally, TentativeCollisions, Voxel};
use rand_core::Rng;

/// One grey grid medium with voxels of type `V`.
pub(crate) struct SingleGrey<'a, V> {
    pub(crate) medium: &'a GridMedium,
    pub(crate) voxels: &'a [V],
    /// How shadow rays are estimated.
    pub(crate) estimator: Estimator,
}

impl<V: Voxel> SingleGrey<'_, V> {
    /// Every estimator but ratio tracking: kept out of the kernel that most scenes run.
    #[inline(never)]
    fn other<R: Rng>(&self, span: &Span, threshold: f32, rng: &mut R, tally: &mut Tally) -> Shadow {
        let field = self.medium.ray(self.voxels, span);
        let transmittance = self.estimator.estimate(field, Grey, threshold, rng, tally);
        Shadow { transmittance: Vec3::splat(transmittance), null_probability: Vec3::ONE }
    }
}

impl<V: Voxel> Media for SingleGrey<'_, V> {
    #[inline(always)]
    fn flight<R: Rng>(
        &self,
        ray: &Ray,
        first: Option<f32>,
        flown: &mut Flown,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let span = self.medium.span(ray.origin, ray.direction, f64::INFINITY)?;
        let field = self.medium.ray(self.voxels, &span);
        let walk = match first {
            Some(depth) => TentativeCollisions::with_first(field, depth),
            None => TentativeCollisions::new(field),
        };
        let nulls = &mut flown.null_probability;
        // Only the density of ratio tracking is known along null collisions; weights beside others leave them out.
        let count = self.estimator == Estimator::Ratio;
        match delta_tracking(walk, rng, tally, |p| {
            if count {
                *nulls *= p
            }
        }) {
            Flight::Collision(t) => Some(Collision { t: span.t_enter + f64::from(t), medium: 0 }),
            Flight::Escape => None,
        }
    }

    #[inline(always)]
    fn transmittance<R: Rng>(
        &self,
        ray: &Ray,
        t_max: f64,
        threshold: f32,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        let Some(span) = self.medium.span(ray.origin, ray.direction, t_max) else {
            return Shadow::CLEAR;
        };
        if self.estimator != Estimator::Ratio {
            return self.other(&span, threshold, rng, tally);
        }
        let walk = TentativeCollisions::new(self.medium.ray(self.voxels, &span));
        let estimate = ratio_tracking_with_roulette(walk, Grey, threshold, rng, tally);
        Shadow {
            transmittance: Vec3::splat(estimate.transmittance),
            null_probability: Vec3::splat(estimate.null_probability),
        }
    }

    #[inline(always)]
    fn properties(&self, _: &Collision, p_world: DVec3) -> (Phase, Vec3) {
        (*self.medium.phase(), self.medium.albedo_at(p_world))
    }
}
