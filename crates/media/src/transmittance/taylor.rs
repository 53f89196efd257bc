//! The Taylor series of `exp(-tau)` about zero, each power of the depth from independent samples.

use crate::channels::Channels;
use crate::field::RayField;
use crate::stretch::product_over_stretches;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::elementary::exp;
use pileus_math::random::{exponential, happens, uniform};
use rand_core::Rng;

/// Majorant depth of a stretch: the series about zero is useless for deep ones.
pub const TAYLOR_STRETCH: f32 = 1.0;

/// The law of the order of the last term.
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
/// No control: relative variance grows exponentially with the depth of a `stretch`, so that rays
/// are cut.
pub fn taylor<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
    order: TaylorOrder,
    stretch: f32,
    threshold: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    product_over_stretches(
        field,
        channels,
        stretch,
        threshold,
        rng,
        tally,
        |field, stretch, rng, tally| {
            let mut depth = |rng: &mut R| {
                let depth = uniform(rng) * stretch.depth;
                stretch.real_ratio(field, depth, channels, tally) * stretch.depth
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
                        let survive = (stretch.depth / k).min(1.0);
                        if survive < 1.0 && !happens(survive, rng) {
                            return sum;
                        }
                        term = term.times(depth(rng) * (-1.0 / (k * survive)));
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
