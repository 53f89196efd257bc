//! The Volterra recursion without null collisions [Georgiev et al. 2019].

use crate::channels::Channels;
use crate::field::RayField;
use crate::ray_interval::product_over_intervals;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::{happens, uniform};
use rand_core::Rng;

/// Majorant depth of an interval. The terms alternate and grow like `depth^k / k!`: deeper
/// intervals lose all accuracy to cancellation.
pub(crate) const VOLTERRA_INTERVAL_DEPTH: f32 = 1.0;

/// An unbiased, signed estimate of the transmittance.
///
/// `T(a, b) = 1 - integral of sigma_t(x) T(x, b) dx`, one vertex per level of the recursion, placed
/// by the majorant; a level is entered with the probability of the weight's size, if below one.
/// Relative variance grows exponentially with the depth of an `interval`, so that rays are cut.
pub fn volterra<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
    interval: f32,
    threshold: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    product_over_intervals(
        field,
        channels,
        interval,
        threshold,
        rng,
        tally,
        |field, interval, rng, tally| {
            let (mut sum, mut weight) = (C::Value::ONE, C::Value::ONE);
            let mut from = 0.0f32;
            loop {
                let left = interval.depth - from;
                let survival = (weight.max_abs() * left).min(1.0);
                if !happens(survival, rng) {
                    return sum;
                }
                from = (from + uniform(rng) * left).min(interval.depth);
                let step = interval.real_ratio(field, from, channels, tally);
                weight = weight.times(step * (-left / survival));
                sum += weight;
            }
        },
    )
}
