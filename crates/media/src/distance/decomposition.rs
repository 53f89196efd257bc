//! Decomposition tracking [Kutz et al. 2017]: the minorant is a medium of its own, whose collisions
//! need no lookup.

use super::spectral::real_probability;
use super::{Flight, WeightedFlight};
use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::Decision;
use rand_core::Rng;

/// Flies to the next real collision.
///
/// Two independent processes, the minorant's and the residual's, of which the nearer event wins:
/// one process of their summed rate, the majorant, whose events belong to the minorant with
/// probability `minorant / majorant`. Those are real and save their lookup; the others are real
/// with probability `(sigma_t - minorant) / (majorant - minorant)`. The law of flights, and how
/// channels share them, is that of delta (spectral) tracking. Unbiased for bounds that hold.
#[inline(always)]
pub(crate) fn decomposition_tracking<F: RayField, C: Channels, R: Rng + ?Sized>(
    mut walk: TentativeCollisions<F>,
    channels: C,
    beta: C::Value,
    rng: &mut R,
    tally: &mut Tally,
) -> WeightedFlight<C::Value> {
    let mut weight = C::Value::ONE;
    let mut null_probability = 1.0;
    let flight = loop {
        let Some(tentative) = walk.next(rng) else {
            break Flight::Escape;
        };
        let throughput = beta.times(weight);
        let control = channels.of(walk.field().minorant() / tentative.majorant);
        let p_control = real_probability(control, throughput);
        let mut u = Decision::new(rng);
        if u.is_below(p_control, rng) {
            tally.collisions += 1;
            weight = weight.times(control * (1.0 / p_control));
            break Flight::Collision(tentative.t);
        }
        let sigma_t = walk.sigma_t(tentative, tally);
        let real = channels.of(sigma_t / tentative.majorant);
        let residual = (real - control).map(|r| r.max(0.0));
        let p_residual = real_probability(residual, throughput).min(1.0 - p_control);
        let p_null = 1.0 - p_control - p_residual;
        // Without a probability of null collisions only rounding could lead to one.
        let p_real = f64::from(p_control) + f64::from(p_residual);
        if u.is_below_exactly(p_real, rng) || !(p_null > 0.0) {
            tally.collisions += 1;
            weight = weight.times(residual * (1.0 / p_residual));
            break Flight::Collision(tentative.t);
        }
        tally.null_collisions += 1;
        null_probability *= p_null;
        weight = weight.times((C::Value::ONE - control - residual) * (1.0 / p_null));
        if p_control + p_residual == 0.0 && walk.is_endless() {
            break Flight::Escape;
        }
    };
    tally.majorant_steps += walk.field().steps();
    WeightedFlight { flight, weight, null_probability }
}
