//! The walk that all trackers share which look up the extinction at every tentative collision; they
//! differ in how they decide.

use super::{Flight, WeightedFlight};
use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::happens;
use rand_core::Rng;

/// Walks until a tentative collision is taken for real. `probability`: of that decision, from
/// extinction over majorant per channel and the throughput; zero only if the extinction is zero in
/// every channel of non-zero throughput.
#[inline(always)]
pub(super) fn track<F: RayField, C: Channels, R: Rng + ?Sized>(
    mut walk: TentativeCollisions<F>,
    channels: C,
    beta: C::Value,
    rng: &mut R,
    tally: &mut Tally,
    probability: impl Fn(C::Value, C::Value) -> f32,
) -> WeightedFlight<C::Value> {
    let mut weight = C::Value::ONE;
    let mut null_probability = 1.0;
    let flight = loop {
        let Some(tentative) = walk.next(rng) else {
            break Flight::Escape;
        };
        let sigma_t = walk.sigma_t(tentative, tally);
        let real = channels.of(sigma_t / tentative.majorant);
        let p = probability(real, beta.times(weight));
        if happens(p, rng) {
            tally.collisions += 1;
            weight = weight.times(real * (1.0 / p));
            break Flight::Collision(tentative.t);
        }
        tally.null_collisions += 1;
        null_probability *= 1.0 - p;
        weight = weight.times((C::Value::ONE - real) * (1.0 / (1.0 - p)));
        if p == 0.0 && walk.is_endless() {
            break Flight::Escape;
        }
    };
    tally.majorant_steps += walk.field().steps();
    WeightedFlight { flight, weight, null_probability }
}
