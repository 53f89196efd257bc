//! Plain ray marching: biased.

use super::jittered_samples::jittered_depth;
use crate::channels::Channels;
use crate::field::RayField;
use crate::ray_interval::product_over_intervals;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::uniform;
use rand_core::Rng;

/// Samples along a ray.
pub(crate) const MARCHING_SAMPLES: u32 = 64;

/// A **biased** estimate of the transmittance: `exp(-depth)` of an unbiased depth by `samples`
/// equidistant samples with one random offset.
///
/// Too bright by Jensen's inequality, by `T Var[depth] / 2` to first order.
pub fn ray_marching<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
    samples: u32,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    let whole = f32::INFINITY;
    product_over_intervals(
        field,
        channels,
        whole,
        0.0,
        rng,
        tally,
        |field, interval, rng, tally| {
            (channels.of(jittered_depth(field, interval, samples, uniform(rng), tally)) * -1.0)
                .exp()
        },
    )
}
