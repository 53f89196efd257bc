//! Power series about the majorant [Georgiev et al. 2019], with two laws of the order.

use crate::channels::Channels;
use crate::field::RayField;
use crate::stretch::{Stretch, product_over_stretches};
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::elementary::exp;
use pileus_math::random::{happens, uniform};
use rand_core::Rng;

/// Largest majorant depth of a stretch: `exp(-depth)` times a sum of size `exp(depth)` stays
/// accurate in single precision.
pub const PSERIES_STRETCH: f32 = 16.0;

/// Share of the series, as a Poisson law of the majorant depth, that [`pseries_cmf`] sums without
/// roulette [Georgiev et al. 2019].
const SURE: f32 = 0.99;

/// One factor of the series: the null ratio at a random point, times the depth.
#[inline(always)]
fn factor<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: &F,
    stretch: &Stretch,
    channels: C,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    let depth = uniform(rng) * stretch.depth;
    stretch.real_ratio(field, depth, channels, tally).complement(rng) * stretch.depth
}

/// An unbiased estimate of the transmittance; exact where the majorant is tight.
///
/// `exp(-depth) * sum of W_k / P(order >= k)`, `W_k` the product of `k` independent null ratios
/// times `depth^k / k!`. All orders which hold 99 % of a Poisson law of the majorant depth are
/// certain, later ones go on with the ratio of neighbouring terms. About
/// `depth + 2.3 sqrt(depth) + 1` lookups per stretch.
pub fn pseries_cmf<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
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
            let first = exp(-stretch.depth);
            let (mut sum, mut term) = (C::Value::ONE, C::Value::ONE);
            let (mut probability, mut cumulative) = (first, first);
            let mut k = 1.0f32;
            loop {
                let survive = if cumulative < SURE { 1.0 } else { (stretch.depth / k).min(1.0) };
                if survive < 1.0 && !happens(survive, rng) {
                    break;
                }
                let step = factor(field, stretch, channels, rng, tally);
                term = term.times(step * (1.0 / (k * survive)));
                if term.max_abs() == 0.0 {
                    break;
                }
                sum += term;
                probability *= stretch.depth / k;
                cumulative += probability;
                k += 1.0;
            }
            sum * first
        },
    )
}

/// An unbiased estimate of the transmittance; exact where the majorant is tight.
///
/// The power series of [`pseries_cmf`], whose next term is taken with the probability of its own
/// size, so that lookups go where terms are large. An early term that happens to be small ends the
/// series: the rare others then carry the rest.
pub fn pseries_cumulative<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
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
            let (mut sum, mut term) = (C::Value::ONE, C::Value::ONE);
            let mut k = 1.0f32;
            loop {
                let step = factor(field, stretch, channels, rng, tally) * (1.0 / k);
                let next = term.times(step);
                let size = next.max_abs();
                if size == f32::INFINITY {
                    // Only without a bound. It would never shrink again.
                    return next;
                }
                let survive = size.min(1.0);
                if !happens(survive, rng) {
                    break;
                }
                term = next * (1.0 / survive);
                sum += term;
                k += 1.0;
            }
            sum * exp(-stretch.depth)
        },
    )
}
