//! One grid of grey extinction: the kernel of most clouds. No channels, no list of media, no choice of voxel type.

use super::{Collision, Flown, Media, Ray, Shadow};
use glam::{DVec3, Vec3};
use pileus_media::distance::{Flight, delta_tracking};
use pileus_media::transmittance::{delta_transmittance, ratio_tracking_with_roulette};
use pileus_media::{GridMedium, Phase, Tally, TentativeCollisions, Voxel};
use rand_core::Rng;

/// One grey grid medium with voxels of type `V`.
pub(crate) struct SingleGrey<'a, V> {
    pub(crate) medium: &'a GridMedium,
    pub(crate) voxels: &'a [V],
    /// Delta tracking instead of ratio tracking for transmittance.
    pub(crate) delta: bool,
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
        // Delta-tracked shadow rays stop with the same probabilities: they cancel.
        let count = !self.delta;
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
        let walk = TentativeCollisions::new(self.medium.ray(self.voxels, &span));
        if self.delta {
            let transmittance = Vec3::splat(delta_transmittance(walk, rng, tally));
            return Shadow { transmittance, null_probability: Vec3::ONE };
        }
        let estimate = ratio_tracking_with_roulette(walk, threshold, rng, tally);
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
