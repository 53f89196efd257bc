//! The next-flight estimator [Cramer 1978]: at every vertex, the probability of reaching the end
//! directly.

use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::tally::Tally;
use pileus_math::Spectrum;
use rand_core::Rng;

/// An unbiased estimate of the transmittance; exact where the majorant is tight.
///
/// `sum of W_k exp(-majorant depth from x_k to the end)` over the vertices `x_0 = start, x_1, ...`
/// of the majorants' Poisson process, `W_k` the product of null ratios up to `x_k`. The sum is
/// carried along the walk: it decays by the majorant depth passed and grows by `W_k` at every
/// vertex, so that the depth to the end need not be known beforehand. Mean lookups: the majorant
/// depth, fewer once `W` is zero.
#[inline(always)]
pub(crate) fn next_flight<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    let mut walk = TentativeCollisions::new(field);
    let (mut weight, mut sum) = (C::Value::ONE, C::Value::ONE);
    loop {
        match walk.next_with_depth(rng) {
            Ok((next, depth)) => {
                sum = sum.times(C::Value::splat(-depth).exp());
                let sigma_t = walk.sigma_t(next, tally);
                weight = weight.times(channels.of(sigma_t / next.majorant).complement(rng));
                if weight.max_abs() == 0.0 {
                    sum = sum.times(C::Value::splat(-walk.depth_to_end()).exp());
                    break;
                }
                if weight.max_abs() == f32::INFINITY {
                    // Only without a bound; later terms would make it NaN.
                    sum = weight;
                    break;
                }
                sum += weight;
            }
            Err(depth) => {
                sum = sum.times(C::Value::splat(-depth).exp());
                break;
            }
        }
    }
    tally.majorant_steps += walk.field().steps();
    sum
}
