//! Spectral MIS: all channels share the strongest one's collisions, and real or null is decided by
//! the mean of the throughput-weighted channels [Kutz et al. 2017].
//!
//! Under that rule the mean of the throughput over channels is the same before and after every
//! event, so that no channel's weight exceeds the number of channels; it is single-sample multiple
//! importance sampling over channels by the balance heuristic [Miller et al. 2019].

use super::{ChannelMode, CoupledFlight, NeverDecoupled};
use crate::media::collisions::Collisions;
use glam::Vec3;
use pileus_media::Tally;
use pileus_media::distance::real_probability;
use pileus_media::random::happens;
use rand_core::Rng;

/// Channels are weighted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spectral {
    /// Whether the throughput decides what a collision is taken for, or else the plain mean over
    /// channels.
    pub(crate) by_throughput: bool,
}

impl ChannelMode for Spectral {
    type Nulls = f32;
    type Flight = CoupledFlight;
    type Decoupled = NeverDecoupled<f32>;
    const GREY: bool = false;
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
        let (mut beta, mut null_probability) = (flight.beta, flight.null_probability);
        let ended = loop {
            let Some(tentative) = collisions.next(rng) else { break false };
            let sigma_t = collisions.sigma_t(tentative, tally);
            let real = collisions.ratio() * (sigma_t / tentative.majorant);
            let weights = if self.by_throughput { beta } else { Vec3::ONE };
            let probability = real_probability(real, weights);
            if happens(probability, rng) {
                tally.collisions += 1;
                beta *= real / probability;
                flight.collision = Some(collisions.place(tentative));
                break true;
            }
            tally.null_collisions += 1;
            beta *= (Vec3::ONE - real) / (1.0 - probability);
            if collisions.weighted() {
                null_probability *= 1.0 - probability;
            }
            // No extinction in any channel that has throughput, now and for all that follows: an
            // endless walk would not end.
            if probability == 0.0 && collisions.is_endless() && !collisions.leave_medium() {
                break false;
            }
        };
        (flight.beta, flight.null_probability) = (beta, null_probability);
        tally.majorant_steps += collisions.steps();
        ended
    }

    #[inline(always)]
    fn shadow_ratios(self, _: Vec3, ratio: Vec3) -> Option<(f32, Vec3)> {
        Some((1.0, ratio))
    }
}
