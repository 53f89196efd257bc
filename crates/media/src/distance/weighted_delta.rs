//! Weighted delta tracking [Kutz et al. 2017]: unbiased for any positive rate, also where it does
//! not bound the extinction.

use super::WeightedFlight;
use super::spectral::real_probability;
use super::tracking::track;
use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::tally::Tally;
use pileus_math::Spectrum;
use rand_core::Rng;

/// Flies to the next real collision.
///
/// A tentative collision is real with probability `|r| / (|r| + |1 - r|)`, `r` the extinction over
/// the rate, by the throughput-weighted mean over channels. Where the rate bounds the extinction
/// this is delta (spectral) tracking. Where it does not, weights grow by `2 r - 1` and change sign
/// at every null collision: unbiased, with a variance exponential in the integral of what exceeds
/// the rate. Violations are counted.
#[inline(always)]
pub(crate) fn weighted_delta_tracking<F: RayField, C: Channels, R: Rng + ?Sized>(
    walk: TentativeCollisions<F>,
    channels: C,
    beta: C::Value,
    rng: &mut R,
    tally: &mut Tally,
) -> WeightedFlight<C::Value> {
    track(walk, channels, beta, rng, tally, |real, throughput| {
        real_probability(real.map(|r| r.abs() / (r.abs() + (1.0 - r).abs())), throughput)
    })
}
