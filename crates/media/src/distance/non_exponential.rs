//! Flights through media that are not exponential: the depth is drawn from the transmittance
//! function, and inverted exactly.

use super::depth::choose_channel;
use super::{Flight, WeightedFlight};
use crate::channels::Channels;
use crate::field::ExactField;
use crate::tally::Tally;
use crate::transmittance_function::Passage;
use pileus_math::Spectrum;
use rand_core::Rng;

/// Flies until the optical depth reaches one drawn from the transmittance function of `passage`.
/// `drawn`: an exponential variate.
///
/// Exact: the collision has the density `p_u` or `p_c` of the transmittance function times the
/// extinction, the escape the survival `X_u` or `X_c`. Null collisions do not apply: the
/// transmittance function has a memory. With several channels the depth is drawn for one, chosen in
/// proportion to the throughput, and weighted by the mean over channels of the densities that all
/// would have had (balance heuristic); where the transmittance function has an atom, which channels
/// of other extinction do not share, a collision counts for those of the chosen one's alone. Grey
/// media stay grey. Cost: every voxel on the way.
pub fn regular_flight_non_exponential<F: ExactField, C: Channels, R: Rng + ?Sized>(
    field: &F,
    passage: Passage<'_>,
    channels: C,
    beta: C::Value,
    drawn: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> WeightedFlight<C::Value> {
    let relative = channels.of(1.0);
    let channel = choose_channel(beta, rng);
    // Infinite for a channel without extinction, which never collides.
    let depth = passage.depth(f64::from(drawn)) / f64::from(relative.channel(channel));
    let whole = match field.t_at_depth(depth, tally) {
        Ok(t) if depth < f64::INFINITY => {
            tally.collisions += 1;
            let own = relative.channel(channel);
            let density = relative.map(|r| {
                if r > 0.0 {
                    (f64::from(r) * passage.density(f64::from(r) * depth)) as f32
                } else {
                    0.0
                }
            });
            let mean = density.mean_by(beta);
            let weight = if relative == C::Value::splat(own) {
                C::Value::ONE
            } else if passage.has_atom() || !(mean > 0.0) {
                alone(relative.map(|r| if r == own { 1.0 } else { 0.0 }), beta)
            } else {
                density * (1.0 / mean)
            };
            return WeightedFlight { flight: Flight::Collision(t), weight, null_probability: 1.0 };
        }
        Ok(_) => f64::INFINITY,
        Err(whole) => whole,
    };
    let survival =
        relative.map(|r| if r > 0.0 { passage.survival(f64::from(r) * whole) as f32 } else { 1.0 });
    let mean = survival.mean_by(beta);
    let weight = if C::Value::COUNT == 1 {
        C::Value::ONE
    } else if mean > 0.0 {
        survival * (1.0 / mean)
    } else {
        C::Value::ZERO
    };
    WeightedFlight { flight: Flight::Escape, weight, null_probability: 1.0 }
}

/// One over the probability that one of the channels `chosen` (one, others zero) was, in those
/// alone.
fn alone<S: Spectrum>(chosen: S, beta: S) -> S {
    chosen * (1.0 / chosen.mean_by(beta))
}
