//! Flights by optical depth: an exponential depth is drawn and inverted. Shared by the samplers
//! that can invert it.

use super::{Flight, WeightedFlight};
use crate::channels::Channels;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::Decision;
use rand_core::Rng;

/// `exp(-depth)` per channel; no extinction over an infinite length has no depth.
fn transmittance<C: Channels>(channels: C, depth: f64) -> C::Value {
    channels.of(depth as f32).map(|d| if d > 0.0 { -d } else { 0.0 }).exp()
}

/// A channel, in proportion to the throughput; equal shares if there is none.
pub(super) fn choose_channel<S: Spectrum, R: Rng + ?Sized>(beta: S, rng: &mut R) -> usize {
    if S::COUNT == 1 {
        return 0;
    }
    let weight = |c: usize| f64::from(beta.channel(c).abs());
    let total: f64 = (0..S::COUNT).map(weight).sum();
    let mut u = Decision::new(rng);
    let mut up_to = 0.0;
    for c in 0..S::COUNT - 1 {
        up_to += if total > 0.0 { weight(c) / total } else { 1.0 / S::COUNT as f64 };
        if u.is_below_exactly(up_to, rng) {
            return c;
        }
    }
    S::COUNT - 1
}

/// Flies until the optical depth reaches `drawn`, an exponential variate of mean one. `t_at_depth`:
/// the ray parameter up to which the field's optical depth is that of its argument, or the depth of
/// the whole ray if it is less.
///
/// With several channels the depth is drawn for one, chosen in proportion to the throughput, and
/// weighted by the mean of the densities that all channels would have had (balance heuristic): no
/// channel's throughput exceeds the number of channels times the mean.
pub(super) fn fly_by_depth<C: Channels, R: Rng + ?Sized>(
    channels: C,
    beta: C::Value,
    drawn: f32,
    rng: &mut R,
    tally: &mut Tally,
    t_at_depth: impl FnOnce(f64, &mut Tally) -> Result<f32, f64>,
) -> WeightedFlight<C::Value> {
    let relative = channels.of(1.0);
    let channel = choose_channel(beta, rng);
    let depth = f64::from(drawn) / f64::from(relative.channel(channel));
    match t_at_depth(depth, tally) {
        // A channel without extinction never collides.
        Ok(t) if depth < f64::INFINITY => {
            tally.collisions += 1;
            let density = relative.times(transmittance(channels, depth));
            let weight = density * (1.0 / density.mean_by(beta));
            WeightedFlight { flight: Flight::Collision(t), weight, null_probability: 1.0 }
        }
        Ok(_) => escape(transmittance(channels, f64::INFINITY), beta),
        Err(whole) => escape(transmittance(channels, whole), beta),
    }
}

fn escape<S: Spectrum>(transmittance: S, beta: S) -> WeightedFlight<S> {
    let probability = transmittance.mean_by(beta);
    WeightedFlight {
        flight: Flight::Escape,
        weight: transmittance * (1.0 / probability),
        null_probability: probability,
    }
}
