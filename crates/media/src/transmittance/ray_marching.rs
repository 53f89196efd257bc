//! Plain ray marching: biased.

use super::comb::comb;
use crate::channels::Channels;
use crate::field::RayField;
use crate::stretch::product_over_stretches;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::uniform;
use rand_core::Rng;

/// Samples along a ray.
pub const MARCHING_TEETH: u32 = 64;

/// A **biased** estimate of the transmittance: `exp(-depth)` of an unbiased depth by `teeth`
/// equidistant samples with one random offset.
///
/// Too bright by Jensen's inequality, by `T Var[depth] / 2` to first order.
pub fn ray_marching<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
    teeth: u32,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    let whole = f32::INFINITY;
    product_over_stretches(field, channels, whole, 0.0, rng, tally, |field, stretch, rng, tally| {
        (channels.of(comb(field, stretch, teeth, uniform(rng), tally)) * -1.0).exp()
    })
}
