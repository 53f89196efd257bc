//! Ratio tracking [Novak et al. 2014]: the product of null probabilities along the majorants'
//! Poisson process.

use crate::channels::{Channels, Grey};
use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::happens;
use rand_core::Rng;

/// The outcome of a ratio-tracking walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RatioEstimate<S> {
    /// Unbiased estimate of the transmittance, in [0, 1] for a field with a bound.
    pub transmittance: S,
    /// Product of the null probabilities met: the estimate without the roulette's compensation.
    /// This is the path's density under delta tracking over its density here, which weights of
    /// multiple importance sampling are made of.
    pub null_probability: S,
}

/// An unbiased estimate of the transmittance, in [0, 1] for a field with a bound.
///
/// Relative variance `exp(integral of sigma_t^2 / majorant) - 1`; mean lookups: the majorant
/// optical depth.
#[inline(always)]
pub fn ratio_tracking<F: RayField, R: Rng + ?Sized>(
    walk: TentativeCollisions<F>,
    rng: &mut R,
    tally: &mut Tally,
) -> f32 {
    ratio_tracking_with_roulette(walk, Grey, 0.0, rng, tally).transmittance
}

/// An unbiased estimate of the transmittance of all channels by one walk of ratio tracking, with
/// Russian roulette.
///
/// Roulette ends walks whose largest estimate has fallen below `threshold` (0: none): they survive
/// with the probability `estimate / threshold` and go on. Bounds the cost in thick media.
#[inline(always)]
pub fn ratio_tracking_with_roulette<F: RayField, C: Channels, R: Rng + ?Sized>(
    mut walk: TentativeCollisions<F>,
    channels: C,
    threshold: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> RatioEstimate<C::Value> {
    let (mut transmittance, mut null_probability) = (C::Value::ONE, C::Value::ONE);
    let small = threshold.max(f32::MIN_POSITIVE);
    while let Some(tentative) = walk.next(rng) {
        let sigma_t = walk.sigma_t(tentative, tally);
        let ratio = channels.of(sigma_t / tentative.majorant);
        // What weights are made of is rounded as flights round it.
        null_probability = null_probability.times(C::Value::ONE - ratio);
        transmittance = transmittance.times(ratio.complement(rng));
        let size = transmittance.max_abs();
        if size < small {
            if size == 0.0 {
                break;
            }
            let survival = size / threshold;
            if survival < 1.0 {
                if !happens(survival, rng) {
                    transmittance = C::Value::ZERO;
                    break;
                }
                transmittance *= 1.0 / survival;
            }
        }
    }
    tally.majorant_steps += walk.field().steps();
    RatioEstimate { transmittance, null_probability }
}
