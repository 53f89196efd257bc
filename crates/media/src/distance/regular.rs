//! Regular tracking: the optical depth is inverted exactly, cell by cell.

use super::WeightedFlight;
use super::depth::fly_by_depth;
use crate::channels::Channels;
use crate::field::ExactField;
use crate::tally::Tally;
use rand_core::Rng;

/// Flies until the optical depth reaches `drawn`, an exponential variate.
///
/// Exact; no null collisions; on escape the transmittance is known, so that other techniques can
/// weigh against it. Cost: every voxel on the way. A field per channel: one channel chosen by the
/// throughput `beta`, balance heuristic over channels.
pub fn regular_flight<F: ExactField, C: Channels, R: Rng + ?Sized>(
    field: &F,
    channels: C,
    beta: C::Value,
    drawn: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> WeightedFlight<C::Value> {
    fly_by_depth(channels, beta, drawn, rng, tally, |depth, tally| field.t_at_depth(depth, tally))
}
