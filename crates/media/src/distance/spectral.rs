//! Spectral tracking [Kutz et al. 2017]: one flight for all channels, real or null by the
//! throughput-weighted mean over channels.

use super::WeightedFlight;
use super::tracking::track;
use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::tally::Tally;
use pileus_math::Spectrum;
use rand_core::Rng;

/// Probability of taking a tentative collision for real: the mean of `real`, extinction over
/// majorant per channel, by the throughput `beta`.
///
/// Zero below the smallest normal number of single precision, whose reciprocal weights could not
/// hold.
#[inline(always)]
pub fn real_probability<S: Spectrum>(real: S, beta: S) -> f32 {
    let probability = real.mean_by(beta).min(1.0);
    if probability >= f32::MIN_POSITIVE { probability } else { 0.0 }
}

/// Flies to the next real collision of a path with throughput `beta`.
///
/// The mean of throughput times weight over channels is the same before and after every event, so
/// that no channel's weight exceeds the number of channels: single-sample multiple importance
/// sampling over channels by the balance heuristic [Miller et al. 2019]. Unbiased for bounds that
/// hold; for one channel it is delta tracking.
#[inline(always)]
pub(crate) fn spectral_tracking<F: RayField, C: Channels, R: Rng + ?Sized>(
    walk: TentativeCollisions<F>,
    channels: C,
    beta: C::Value,
    rng: &mut R,
    tally: &mut Tally,
) -> WeightedFlight<C::Value> {
    track(walk, channels, beta, rng, tally, real_probability)
}
