//! Transmittance of media that are not exponential: exact, or by a debiasing series [Misso et al.
//! 2022].
//!
//! A transmittance function does not multiply over intervals of a ray: both estimators treat the
//! ray as a whole. Mixtures of exponential transmittances have a third way, all other estimators on
//! a [`Scaled`](crate::Scaled) field, see
//! [`TransmittanceFunction::rate`](crate::transmittance_function::TransmittanceFunction::rate).

use super::debiased_ray_marching::{CONTINUATION_PROBABILITY, DEBIASED_SAMPLES};
use super::jittered_samples::jittered_depth;
use crate::channels::Channels;
use crate::field::{ExactField, RayField};
use crate::ray_interval::RayInterval;
use crate::tally::Tally;
use crate::transmittance_function::Passage;
use libm::exp;
use pileus_math::Spectrum;
use pileus_math::random::uniform;
use rand_core::Rng;

/// The survival of all channels at a depth of the field.
fn survival<C: Channels>(passage: Passage<'_>, channels: C, depth: f64) -> C::Value {
    // A channel without extinction sees nothing of an infinite depth.
    channels
        .of(1.0)
        .map(|r| if r > 0.0 { passage.survival(f64::from(r) * depth) as f32 } else { 1.0 })
}

/// The transmittance of a ray by a non-exponential transmittance function: exact, at the cost of
/// every voxel on the way.
pub fn exact_non_exponential<F: ExactField, C: Channels>(
    field: &F,
    passage: Passage<'_>,
    channels: C,
    tally: &mut Tally,
) -> C::Value {
    survival(passage, channels, field.optical_depth(tally))
}

/// How a debiasing series chooses its levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DebiasingSeries {
    /// Jittered samples of the coarsest level, at least one.
    pub samples: u32,
    /// Probability `p` of going on to the next level, in (0, 1): level `j` has `(1 - p) p^j`.
    pub continuation_probability: f32,
}

impl Default for DebiasingSeries {
    /// Samples and probability that debiased ray marching of the exponential transmittance has:
    /// eight, `2^(-3/2)`.
    fn default() -> DebiasingSeries {
        DebiasingSeries {
            samples: DEBIASED_SAMPLES,
            continuation_probability: CONTINUATION_PROBABILITY,
        }
    }
}

impl DebiasingSeries {
    /// A series from eight samples on whose levels `j` have probabilities in proportion to
    /// `2^(-exponent j)`.
    pub fn with_exponent(exponent: f64) -> DebiasingSeries {
        let continuation_probability = exp(-exponent * std::f64::consts::LN_2) as f32;
        DebiasingSeries { continuation_probability, ..DebiasingSeries::default() }
    }
}

/// An unbiased estimate of the transmittance under any transmittance function; it may exceed one or
/// be negative.
///
/// Level `j` is the transmittance function of the depth by `samples 2^j` jittered equidistant
/// samples. The coarsest level is returned with one difference of neighbouring levels over the
/// probability of that level; the even and the odd samples of the finer level are the two coarse
/// ones, so that the differences add up exactly and are of second order. Work is `2^j`: finite in
/// the mean for a continuation probability below 1/2. Where the mean squares of differences fall by
/// `2^-b` a level the variance is finite for one above `2^-b`: `b` is four for samples that
/// converge at first order (edges, unmatched ends) under a transmittance function of bounded
/// curvature and more on smooth rays; two where the depth lies at a kink of the survival, zero
/// where it lies at a jump (from a particle under a transmittance function with an atom). Before
/// the samples resolve a feature differences do not fall at all: a slow tail.
pub fn debiased_non_exponential<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    passage: Passage<'_>,
    channels: C,
    series: DebiasingSeries,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    let (interval, field) = RayInterval::whole(field);
    tally.majorant_steps += field.steps();
    if interval.depth == 0.0 {
        return C::Value::ONE;
    }
    if !(interval.length < f32::INFINITY) {
        // Constant extinction without end, by the contract of fields.
        return survival(passage, channels, f64::INFINITY);
    }
    let DebiasingSeries { samples, continuation_probability } = series;
    let coarse = jittered_depth(&field, &interval, samples, uniform(rng), tally);
    let mut level = 0;
    let mut probability = f64::from(1.0 - continuation_probability);
    while uniform(rng) < continuation_probability {
        level += 1;
        probability *= f64::from(continuation_probability);
    }
    let (a, b) = neighbours(&field, &interval, samples, level, rng, tally);
    channels.of(1.0).map(|r| {
        let r = f64::from(r);
        let first = passage.survival(r * f64::from(coarse));
        (first + difference(passage, r * a, r * b) / probability) as f32
    })
}

/// The difference of the levels `level + 1` and `level` of [`debiased_non_exponential`], for the
/// field's own channel and a ray of finite length: what a choice of levels is judged by.
pub fn debiasing_difference<F: RayField, R: Rng + ?Sized>(
    field: F,
    passage: Passage<'_>,
    samples: u32,
    level: u32,
    rng: &mut R,
    tally: &mut Tally,
) -> f64 {
    let (interval, field) = RayInterval::whole(field);
    if interval.depth == 0.0 || !(interval.length < f32::INFINITY) {
        return 0.0;
    }
    let (a, b) = neighbours(&field, &interval, samples, level, rng, tally);
    difference(passage, a, b)
}

/// Depths by the even and by the odd samples of the next finer level: with its offset `u` the
/// even ones have the offset `u / 2`, the odd ones `(u + 1) / 2`, in units of their distance.
fn neighbours<F: RayField, R: Rng + ?Sized>(
    field: &F,
    interval: &RayInterval,
    samples: u32,
    level: u32,
    rng: &mut R,
    tally: &mut Tally,
) -> (f64, f64) {
    let samples = samples.saturating_mul(1u32.checked_shl(level).unwrap_or(u32::MAX));
    let u = uniform(rng);
    let even = jittered_depth(field, interval, samples, 0.5 * u, tally);
    let odd = jittered_depth(field, interval, samples, 0.5 * (u + 1.0), tally);
    (f64::from(even), f64::from(odd))
}

/// The finer level's value less the mean of the two coarse ones'.
fn difference(passage: Passage<'_>, even: f64, odd: f64) -> f64 {
    let coarse = 0.5 * (passage.survival(even) + passage.survival(odd));
    passage.survival(0.5 * (even + odd)) - coarse
}
