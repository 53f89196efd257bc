//! Transmittance under a law that is not exponential: exact, or by a telescoping series [Misso et
//! al. 2022].
//!
//! A law does not multiply over stretches of a ray: both estimators treat the ray as a whole.
//! Mixtures of exponential laws have a third way, all other estimators on a
//! [`Scaled`](crate::Scaled) field, see [`Law::rate`](crate::law::Law::rate).

use super::comb::comb;
use super::debiased_ray_marching::{DEBIASED_TEETH, DEEPER};
use crate::channels::Channels;
use crate::field::{ExactField, RayField};
use crate::law::Passage;
use crate::stretch::Stretch;
use crate::tally::Tally;
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

/// The transmittance under a law of a ray that ends at a place: exact, at the cost of every voxel
/// on the way.
pub fn exact_under_law<F: ExactField, C: Channels>(
    field: &F,
    passage: Passage<'_>,
    channels: C,
    tally: &mut Tally,
) -> C::Value {
    survival(passage, channels, field.optical_depth(tally))
}

/// How a telescoping series chooses its levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Telescope {
    /// Teeth of the coarsest comb, at least one.
    pub teeth: u32,
    /// Probability of going one level deeper, in (0, 1): level `j` has `(1 - deeper) deeper^j`.
    pub deeper: f32,
}

impl Default for Telescope {
    /// Teeth and probability that debiased ray marching of the exponential law has: eight,
    /// `2^(-3/2)`.
    fn default() -> Telescope {
        Telescope { teeth: DEBIASED_TEETH, deeper: DEEPER }
    }
}

impl Telescope {
    /// Eight teeth, and levels `j` of a probability in proportion to `2^(-exponent j)`.
    pub fn with_exponent(exponent: f64) -> Telescope {
        let deeper = exp(-exponent * std::f64::consts::LN_2) as f32;
        Telescope { deeper, ..Telescope::default() }
    }
}

/// An unbiased estimate of the transmittance under any law; it may exceed one or be negative.
///
/// Level `j` is the law of a comb of `teeth 2^j`. One coarse comb is returned with one difference
/// of neighbouring levels over the probability of that level; the even and the odd teeth of the
/// finer comb are the two coarse ones, so that the differences telescope exactly and are of second
/// order. Work is `2^j`: finite in the mean for `deeper < 1/2`. Where the mean squares of
/// differences fall by `2^-b` a level the variance is finite for `deeper > 2^-b`: `b` is four for
/// combs that converge at first order (edges, unmatched ends) under a law of bounded curvature and
/// more on smooth rays; two where the depth lies at a kink of the survival, zero where it lies at a
/// jump (from a particle under a law with an atom). Before a comb resolves a feature differences do
/// not fall at all: a slow tail.
pub fn debiased_under_law<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    passage: Passage<'_>,
    channels: C,
    telescope: Telescope,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    let (stretch, field) = Stretch::whole(field);
    tally.majorant_steps += field.steps();
    if stretch.depth == 0.0 {
        return C::Value::ONE;
    }
    if !(stretch.length < f32::INFINITY) {
        // Constant extinction without end, by the contract of fields.
        return survival(passage, channels, f64::INFINITY);
    }
    let Telescope { teeth, deeper } = telescope;
    let coarse = comb(&field, &stretch, teeth, uniform(rng), tally);
    let mut level = 0;
    let mut probability = f64::from(1.0 - deeper);
    while uniform(rng) < deeper {
        level += 1;
        probability *= f64::from(deeper);
    }
    let (a, b) = neighbours(&field, &stretch, teeth, level, rng, tally);
    channels.of(1.0).map(|r| {
        let r = f64::from(r);
        let first = passage.survival(r * f64::from(coarse));
        (first + difference(passage, r * a, r * b) / probability) as f32
    })
}

/// The difference of the levels `level + 1` and `level` of [`debiased_under_law`], for the field's
/// own channel and a ray of finite length: what a choice of levels is judged by.
pub fn telescope_difference<F: RayField, R: Rng + ?Sized>(
    field: F,
    passage: Passage<'_>,
    teeth: u32,
    level: u32,
    rng: &mut R,
    tally: &mut Tally,
) -> f64 {
    let (stretch, field) = Stretch::whole(field);
    if stretch.depth == 0.0 || !(stretch.length < f32::INFINITY) {
        return 0.0;
    }
    let (a, b) = neighbours(&field, &stretch, teeth, level, rng, tally);
    difference(passage, a, b)
}

/// Depths by the even and by the odd teeth of the comb one level finer: with its offset `u` the
/// even ones have the offset `u / 2`, the odd ones `(u + 1) / 2`, in units of their distance.
fn neighbours<F: RayField, R: Rng + ?Sized>(
    field: &F,
    stretch: &Stretch,
    teeth: u32,
    level: u32,
    rng: &mut R,
    tally: &mut Tally,
) -> (f64, f64) {
    let teeth = teeth.saturating_mul(1u32.checked_shl(level).unwrap_or(u32::MAX));
    let u = uniform(rng);
    let even = comb(field, stretch, teeth, 0.5 * u, tally);
    let odd = comb(field, stretch, teeth, 0.5 * (u + 1.0), tally);
    (f64::from(even), f64::from(odd))
}

/// The finer comb's value less the mean of the two coarse ones'.
fn difference(passage: Passage<'_>, even: f64, odd: f64) -> f64 {
    let coarse = 0.5 * (passage.survival(even) + passage.survival(odd));
    passage.survival(0.5 * (even + odd)) - coarse
}
