//! Unbiased ray marching [Kettunen et al. 2021]: jittered equidistant samples, a pivot, and rare
//! higher orders as symmetric means.

use super::jittered_samples::jittered_depth;
use crate::channels::Channels;
use crate::field::RayField;
use crate::ray_interval::product_over_intervals;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::elementary::{exp, ln};
use pileus_math::random::uniform;
use rand_core::Rng;
use smallvec::SmallVec;

/// Probability of order zero: one set of samples, no correction.
const STOP_AT_ZERO: f32 = 0.9;
/// Orders up to this are certain once zero was passed; `k` beyond goes on with this over `k`
/// [Bhanot and Kennedy 1985].
const CERTAIN_ORDER: f32 = 2.0;
/// Mean order under these constants.
const MEAN_ORDER: f32 = 0.319_45;

/// Lookups worth spending on a residual depth (majorant less minorant): the fit of Kettunen et
/// al. 2021.
fn lookups_for(residual: f32) -> f32 {
    let cube = (0.015 + residual) * (0.65 + residual) * (60.3 + residual);
    // A cube root with the same bits on every machine.
    exp(ln(cube) * (1.0 / 3.0)).ceil()
}

/// An unbiased, possibly negative estimate of the transmittance; without variance for constant
/// extinction, and for linear extinction but for rounding.
///
/// `interval` is the largest majorant depth that is marched at once: infinite for the published
/// method, finite to cut the ray so that samples do not beat with the field over its whole length.
/// About the lookups of the published fit per interval.
pub fn unbiased_ray_marching<F: RayField, C: Channels, R: Rng + ?Sized>(
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
            let residual = (interval.depth - interval.minorant_depth).max(0.0);
            let samples = (lookups_for(residual) / (MEAN_ORDER + 1.0)).round().max(1.0) as u32;
            let (first, last) = interval.ends();
            let slope = field.sigma_t_anywhere(last) - field.sigma_t_anywhere(first);
            tally.lookups += 2;
            let distance = interval.length / samples as f32;
            let mut sample = |rng: &mut R| {
                let offset = uniform(rng);
                let depth = jittered_depth(field, interval, samples, offset, tally);
                channels.of(depth + distance * (0.5 - offset) * slope) * -1.0
            };
            let mut exponents: SmallVec<[C::Value; 8]> = SmallVec::new();
            exponents.push(sample(rng));
            if uniform(rng) < STOP_AT_ZERO {
                return exponents[0].exp();
            }
            exponents.push(sample(rng));
            exponents.push(sample(rng));
            let mut order = CERTAIN_ORDER + 1.0;
            while uniform(rng) < CERTAIN_ORDER / order {
                exponents.push(sample(rng));
                order += 1.0;
            }
            mean_over_pivots::<C::Value>(&exponents)
        },
    )
}

/// The mean over pivots `p` of `exp(x_p) * sum of m_k / (k! P(order >= k))`, `m_k` the symmetric
/// mean of order `k` of the others' distances from `x_p`.
fn mean_over_pivots<S: Spectrum>(x: &[S]) -> S {
    let mut total = S::ZERO;
    let mut means: SmallVec<[S; 8]> = SmallVec::new();
    for (p, &pivot) in x.iter().enumerate() {
        symmetric_means(
            x.iter().enumerate().filter(|(i, _)| *i != p).map(|(_, &value)| value - pivot),
            &mut means,
        );
        let mut series = S::ONE;
        // 1 / (k! P(order >= k)).
        let mut factor = 1.0 / (1.0 - STOP_AT_ZERO);
        for (k, &mean) in means.iter().enumerate().skip(1) {
            let k = k as f32;
            factor /= k;
            if k > CERTAIN_ORDER {
                factor *= k / CERTAIN_ORDER;
            }
            series += mean * factor;
        }
        total += pivot.exp().times(series);
    }
    total * (1.0 / x.len() as f32)
}

/// Elementary symmetric means of `values`, orders 0 to their number: the averages of all `k`-fold
/// products of distinct values.
///
/// Each value enters as a convex combination, `m_k += (k / n) (m_(k-1) y - m_k)`: no binomial is
/// formed, so that nothing overflows but what is itself too large.
pub(crate) fn symmetric_means<S: Spectrum>(
    values: impl Iterator<Item = S>,
    means: &mut SmallVec<[S; 8]>,
) {
    means.clear();
    means.push(S::ONE);
    for (i, y) in values.enumerate() {
        let n = i + 1;
        means.push(S::ZERO);
        for k in (1..=n).rev() {
            let share = k as f32 / n as f32;
            means[k] = means[k] * (1.0 - share) + (means[k - 1] * y) * share;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symmetric_means_are_the_averages_of_products() {
        let y = [0.3f32, -1.5, 2.0, 0.7];
        let mut means = SmallVec::new();
        symmetric_means(y.into_iter(), &mut means);
        let pairs: f32 =
            (0..4).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| y[i] * y[j]).sum();
        assert_eq!(means.len(), 5);
        assert!((means[1] - y.iter().sum::<f32>() / 4.0).abs() < 1e-6);
        assert!((means[2] - pairs / 6.0).abs() < 1e-6);
        assert!((means[4] - y.iter().product::<f32>()).abs() < 1e-6);
    }

    /// Holds the symmetric means against their recursion in double precision: thousands of samples,
    /// orders up to where the means leave single precision.
    #[test]
    fn symmetric_means_of_thousands_are_finite_and_accurate() {
        let value =
            |i: u32| 0.5 + 0.4 * f64::from(i.wrapping_mul(2_654_435_769) >> 8) / 16_777_216.0;
        let n = 4000;
        let mut means = SmallVec::new();
        symmetric_means((0..n).map(|i| value(i) as f32), &mut means);
        let mut exact = vec![1.0f64];
        for i in 0..n {
            exact.push(0.0);
            for k in (1..=i as usize + 1).rev() {
                let share = k as f64 / f64::from(i + 1);
                exact[k] += share * (exact[k - 1] * value(i) - exact[k]);
            }
        }
        assert!(means.iter().all(|m| m.is_finite()));
        let mut checked = 0;
        for (mean, exact) in means.iter().zip(&exact).filter(|(_, exact)| **exact > 1e-30) {
            assert!((f64::from(*mean) / exact - 1.0).abs() < 1e-4, "{mean} {exact}");
            checked += 1;
        }
        assert!(checked > 150, "{checked}");
    }
}
