//! Extinction that is the same in all channels: delta tracking, whose flights carry no weight.

use super::{ChannelMode, CoupledFlight, NeverDecoupled};
use crate::media::collisions::Collisions;
use glam::Vec3;
use pileus_media::Tally;
use pileus_media::random::happens_of;
use rand_core::Rng;

/// All channels have the same extinction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grey;

impl ChannelMode for Grey {
    type Nulls = f32;
    type Flight = CoupledFlight;
    type Decoupled = NeverDecoupled<f32>;
    const GREY: bool = true;
    const DECOUPLES: bool = false;

    #[inline(always)]
    fn share(self, _: &CoupledFlight, _: Vec3) -> f32 {
        1.0
    }

    #[inline(always)]
    fn fly<C: Collisions, R: Rng>(
        self,
        flight: &mut CoupledFlight,
        mut collisions: C,
        _: Option<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> bool {
        let mut null_probability = flight.null_probability;
        let ended = loop {
            let Some(tentative) = collisions.next(rng) else { break false };
            let sigma_t = collisions.sigma_t(tentative, tally);
            if happens_of(sigma_t, tentative.majorant, rng) {
                tally.collisions += 1;
                flight.collision = Some(collisions.place(tentative));
                break true;
            }
            tally.null_collisions += 1;
            if collisions.weighted() {
                null_probability *= 1.0 - sigma_t / tentative.majorant;
            }
        };
        flight.null_probability = null_probability;
        tally.majorant_steps += collisions.steps();
        ended
    }

    #[inline(always)]
    fn shadow_ratios(self, _: Vec3, _: Vec3) -> Option<(f32, Vec3)> {
        Some((1.0, Vec3::ONE))
    }
}
