//! Power series about the majorant [Georgiev et al. 2019], with two laws of the order.

use crate::channels::Channels;
use crate::field::RayField;
use crate::ray_interval::{RayInterval, product_over_intervals};
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::elementary::exp;
use pileus_math::random::{happens, uniform};
use rand_core::Rng;

/// Largest majorant depth of an interval: `exp(-depth)` times a sum of size `exp(depth)` stays
/// accurate in single precision.
pub(crate) const PSERIES_INTERVAL_DEPTH: f32 = 16.0;

/// Share of the series, as a Poisson law of the majorant depth, that [`pseries_cmf`] sums without
/// roulette [Georgiev et al. 2019].
const CERTAIN_SHARE: f32 = 0.99;

/// One factor of the series: the null ratio at a random point, times the depth.
#[inline(always)]
fn factor<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: &F,
    interval: &RayInterval,
    channels: C,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    let depth = uniform(rng) * interval.depth;
    interval.real_ratio(field, depth, channels, tally).complement(rng) * interval.depth
}

/// An unbiased estimate of the transmittance; exact where the majorant is tight.
///
/// `exp(-depth) * sum of W_k / P(order >= k)`, `W_k` the product of `k` independent null ratios
/// times `depth^k / k!`. All orders which hold 99 % of a Poisson law of the majorant depth are
/// certain, later ones go on with the ratio of neighbouring terms. About
/// `depth + 2.3 sqrt(depth) + 1` lookups per interval.
pub(crate) fn pseries_cmf<F: RayField, C: Channels, R: Rng + ?Sized>(
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
            let first = exp(-interval.depth);
            let (mut sum, mut term) = (C::Value::ONE, C::Value::ONE);
            let (mut probability, mut cumulative) = (first, first);
            let mut k = 1.0f32;
            loop {
                let survival =
                    if cumulative < CERTAIN_SHARE { 1.0 } else { (interval.depth / k).min(1.0) };
                if survival < 1.0 && !happens(survival, rng) {
                    break;
                }
                let step = factor(field, interval, channels, rng, tally);
                term = term.times(step * (1.0 / (k * survival)));
                if term.max_abs() == 0.0 {
                    break;
                }
                sum += term;
                probability *= interval.depth / k;
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
pub(crate) fn pseries_cumulative<F: RayField, C: Channels, R: Rng + ?Sized>(
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
            let (mut sum, mut term) = (C::Value::ONE, C::Value::ONE);
            let mut k = 1.0f32;
            loop {
                let step = factor(field, interval, channels, rng, tally) * (1.0 / k);
                let next = term.times(step);
                let size = next.max_abs();
                if size == f32::INFINITY {
                    // Only without a bound. It would never shrink again.
                    return next;
                }
                let survival = size.min(1.0);
                if !happens(survival, rng) {
                    break;
                }
                term = next * (1.0 / survival);
                sum += term;
                k += 1.0;
            }
            sum * exp(-interval.depth)
        },
    )
}
