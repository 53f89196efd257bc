//! One grid whose extinction differs per channel: channels fly together until their events differ, then they part.
//!
//! Each channel by itself is delta tracking: weights of one, as in a grey render of it alone. What is common is decided once: all channels of a flight meet the
//! tentative collisions of the strongest one's majorant, and one uniform number decides for all. Whatever a channel takes for real, stronger ones take for real:
//! what one walk costs serves all channels, and where they collide at one point they scatter as one path. A sample holds three paths at most.
//!
//! Measured against weights over channels (spectral tracking): `docs/charts/whole.md`.

use super::single_grey::{SingleGrid, plain_properties, plain_scattering};
use super::{Collision, Ending, Flown, Leg, Media, Parted, Ray, Shadow, Structures};
use glam::{DVec3, Vec3};
use pileus_media::random::Decision;
use pileus_media::transmittance::ratio_tracking_with_roulette;
use pileus_media::{
    PhaseAt, RayField, Relative, Spectrum, Tally, TentativeCollisions, Voxel,
};
use rand_core::Rng;
use std::marker::PhantomData;

/// One grid medium of extinction per channel with voxels of type `V` and majorant structures `S`.
pub(crate) struct SingleChromatic<'a, V, S> {
    pub(crate) structures: PhantomData<S>,
    pub(crate) one: SingleGrid<'a, V>,
    /// Whether paths and shadow rays are weighted against each other: both then walk the same majorants, those of the strongest channel that began the flight. Else
    /// a flight that the strongest has left goes on with those of the next.
    pub(crate) weighted: bool,
}

/// One for the channels that have throughput, zero for others.
#[inline(always)]
fn present(beta: Vec3) -> Vec3 {
    Spectrum::map(beta, |b| if b != 0.0 { 1.0 } else { 0.0 })
}

impl<V: Voxel, S: Structures> Media for SingleChromatic<'_, V, S> {
    type Nulls = Vec3;
    const PARTS: bool = true;
    type Others = Parted<Vec3>;

    #[inline(always)]
    fn flight<R: Rng>(
        &self,
        Leg { ray, t_max, .. }: Leg<'_>,
        first: Option<[f32; 2]>,
        flown: &mut Flown<Vec3>,
        others: &mut Parted<Vec3>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        // Extinction of the channels on their way, over the strongest one's of the grid.
        let mut left = present(flown.beta);
        let mut relative = self.one.medium.chromatic_ratio() * left;
        let share = relative.max_element();
        // Clear in all of these channels.
        if share <= 0.0 {
            return None;
        }
        let span = self.one.grid.span(ray.origin, ray.direction, t_max)?;
        // Over that of the flight.
        relative /= share;
        let field = S::ray(self.one, &span, share);
        let (mut walk, mut decision) = match first {
            Some([depth, u]) => {
                let walk = TentativeCollisions::with_first(field, depth);
                (walk, Some(Decision::of_stratified(u)))
            }
            None => (TentativeCollisions::new(field), None),
        };
        let mut inverse = 1.0;
        let before = flown.beta;
        let mut nearest: Option<Ending<Vec3>> = None;
        let mut end = |ending: Ending<Vec3>| {
            if nearest.is_none() {
                nearest = Some(ending);
            } else {
                others.push(ending);
            }
        };
        let mut nulls = Vec3::ONE;
        while let Some(tentative) = walk.next_of_share(inverse, rng) {
            let sigma_t = walk.sigma_t(tentative, tally);
            let real = relative * (inverse * (sigma_t / tentative.majorant));
            let mut u = decision.take().unwrap_or_else(|| Decision::new(rng));
            let collide = u.is_below_each(real, rng);
            if collide.any() {
                tally.collisions += 1;
                let channels = Vec3::select(collide, left, Vec3::ZERO);
                let t = span.t_enter + f64::from(tentative.t);
                let collision = Some(Collision { t, medium: 0 });
                end(Ending { channels, null_probability: nulls, collision });
                left -= channels;
                relative = Vec3::select(collide, Vec3::ZERO, relative);
                let strongest = relative.max_element();
                // None is left that could collide.
                if strongest <= 0.0 {
                    break;
                }
                if !self.weighted {
                    inverse = 1.0 / strongest;
                }
            } else {
                tally.null_collisions += 1;
            }
            nulls *= Vec3::ONE - real;
        }
        tally.majorant_steps += walk.field().steps();
        if left != Vec3::ZERO {
            end(Ending { channels: left, null_probability: nulls, collision: None });
        }
        let ending = nearest?;
        *flown =
            Flown { beta: before * ending.channels, null_probability: ending.null_probability };
        ending.collision
    }

    #[inline(always)]
    fn transmittance<R: Rng>(
        &self,
        Leg { ray, t_max, .. }: Leg<'_>,
        threshold: f32,
        beta: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        let relative = self.one.medium.chromatic_ratio();
        let present = present(beta);
        let share = (relative * present).max_element();
        if share <= 0.0 {
            return Shadow::CLEAR;
        }
        let Some(span) = self.one.grid.span(ray.origin, ray.direction, t_max) else {
            return Shadow::CLEAR;
        };
        let walk = TentativeCollisions::new(S::ray(self.one, &span, share));
        // Channels that have left are as opaque as the strongest: they do not keep the walk alive.
        let relative = Vec3::select(present.cmpgt(Vec3::ZERO), relative / share, Vec3::ONE);
        let estimate =
            ratio_tracking_with_roulette(walk, Relative(relative), threshold, rng, tally);
        Shadow {
            transmittance: estimate.transmittance,
            null_probability: estimate.null_probability,
        }
    }

    fn scattering<R: Rng>(
        &self,
        p_world: DVec3,
        _: Vec3,
        _: &mut R,
        visit: impl FnMut(Vec3, PhaseAt<'_>),
    ) {
        plain_scattering(self.one.medium, p_world, visit);
    }

    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)> {
        self.one.grid.span(ray.origin, ray.direction, t_max).map(|span| span.extent())
    }

    #[inline(always)]
    fn properties<R: Rng>(
        &self,
        _: &Collision,
        p_world: DVec3,
        _: Vec3,
        _: &mut R,
    ) -> (PhaseAt<'_>, Vec3) {
        plain_properties(self.one.medium, p_world)
    }
}
