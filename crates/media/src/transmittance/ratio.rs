//! Ratio tracking [Novak et al. 2014]: the product of null probabilities along the majorants' Poisson process.

use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::random::uniform;
use crate::tally::Tally;
use rand_core::Rng;

/// The outcome of a ratio-tracking walk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RatioEstimate {
    /// Unbiased estimate of the transmittance, in [0, 1] for a field with a bound.
    pub transmittance: f32,
    /// Product of the null probabilities met: the estimate without the roulette's compensation. This is the path's density under delta
    /// tracking over its density here, which weights of multiple importance sampling are made of.
    pub null_probability: f32,
}

/// An unbiased estimate of the transmittance, in [0, 1] for a field with a bound.
///
/// Relative variance `exp(integral of sigma_t^2 / majorant) - 1`; mean lookups: the majorant optical depth.
#[inline(always)]
pub fn ratio_tracking<F: RayField, R: Rng + ?Sized>(
    walk: TentativeCollisions<F>,
    rng: &mut R,
    tally: &mut Tally,
) -> f32 {
    ratio_tracking_with_roulette(walk, 0.0, rng, tally).transmittance
}

/// As [`ratio_tracking`], with a roulette that ends walks whose estimate has fallen below `threshold`: it survives with the
/// probability `estimate / threshold` and goes on with the estimate `threshold`. Unbiased; bounds the cost in thick media.
#[inline(always)]
pub fn ratio_tracking_with_roulette<F: RayField, R: Rng + ?Sized>(
    mut walk: TentativeCollisions<F>,
    threshold: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> RatioEstimate {
    let mut estimate = RatioEstimate { transmittance: 1.0, null_probability: 1.0 };
    while let Some(tentative) = walk.next(rng) {
        let sigma_t = walk.sigma_t(tentative);
        tally.lookups += 1;
        tally.violations += u64::from(sigma_t > tentative.majorant);
        let null = 1.0 - sigma_t / tentative.majorant;
        estimate.null_probability *= null;
        estimate.transmittance *= null;
        if estimate.transmittance < threshold {
            if uniform(rng) * threshold >= estimate.transmittance {
                estimate.transmittance = 0.0;
                break;
            }
            estimate.transmittance = threshold;
        }
        if estimate.transmittance == 0.0 {
            break;
        }
    }
    tally.majorant_steps += walk.field().steps();
    estimate
}
