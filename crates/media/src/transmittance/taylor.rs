//! The Taylor series of `exp(-tau)` about zero, each power of the depth from independent samples.

use crate::channels::Channels;
use crate::field::RayField;
use crate::ray_interval::product_over_intervals;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::elementary::exp;
use pileus_math::random::{exponential, happens, uniform};
use rand_core::Rng;

/// Majorant depth of an interval: the series about zero is useless for deep ones.
pub(crate) const TAYLOR_INTERVAL_DEPTH: f32 = 1.0;

/// How the order of the last term is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum TaylorOrder {
    /// Poisson of this mean; the term of that order alone is returned, divided by its probability.
    Poisson(f32),
    /// Order `k` follows the last with the probability `min(1, depth / k)`, depth the majorant's;
    /// all terms are summed.
    #[default]
    Terms,
}

/// An unbiased, signed estimate of the transmittance: `sum of (-tau)^k / k!`, the `k` factors of a
/// power sampled independently.
///
/// No control: relative variance grows exponentially with the depth of an `interval`, so that rays
/// are cut.
pub fn taylor<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
    order: TaylorOrder,
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
            let mut depth = |rng: &mut R| {
                let depth = uniform(rng) * interval.depth;
                interval.real_ratio(field, depth, channels, tally) * interval.depth
            };
            match order {
                TaylorOrder::Poisson(mean) => {
                    let mut product = C::Value::splat(exp(mean));
                    let mut time = exponential(rng);
                    while time < mean && product.max_abs() > 0.0 {
                        product = product.times(depth(rng) * (-1.0 / mean));
                        time += exponential(rng);
                    }
                    product
                }
                TaylorOrder::Terms => {
                    let (mut sum, mut term) = (C::Value::ONE, C::Value::ONE);
                    let mut k = 1.0f32;
                    loop {
                        let survival = (interval.depth / k).min(1.0);
                        if survival < 1.0 && !happens(survival, rng) {
                            return sum;
                        }
                        term = term.times(depth(rng) * (-1.0 / (k * survival)));
                        if term.max_abs() == 0.0 {
                            return sum;
                        }
                        sum += term;
                        k += 1.0;
                    }
                }
            }
        },
    )
}
