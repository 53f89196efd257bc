//! Transmittance under a law that is not exponential: exact, or by a telescoping series [Misso et al. 2022].
//!
//! A law does not multiply over stretches of a ray: both estimators treat the ray as a whole. Mixtures of exponential laws have a third way, all other
//! estimators on a [`Scaled`](crate::Scaled) field, see [`Law::rate`](crate::law::Law::rate).

use super::comb::comb;
use super::debiased_ray_marching::{DEBIASED_TEETH, DEEPER};
use crate::channels::{Channels, Spectrum};
use crate::field::{ExactField, RayField};
use crate::law::Passage;
use crate::random::uniform;
use crate::stretch::Stretch;
use crate::tally::Tally;
use rand_core::Rng;

/// The survival of all channels at a depth of the field.
fn survival<C: Channels>(passage: Passage<'_>, channels: C, depth: f64) -> C::Value {
    // A channel without extinction sees nothing of an infinite depth.
    channels
        .of(1.0)
        .map(|r| if r > 0.0 { passage.survival(f64::from(r) * depth) as f32 } else { 1.0 })
}

/// The transmittance under a law of a ray that ends at a place: exact, at the cost of every voxel on the way.
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
    /// As debiased ray marching of the exponential law: eight teeth, `2^(-3/2)`.
    fn default() -> Telescope {
        Telescope { teeth: DEBIASED_TEETH, deeper: DEEPER }
    }
}

/// An unbiased estimate of the transmittance under any law; it may exceed one or be negative.
///
/// Level `j` is the law of a comb of `teeth 2^j`. One coarse comb is returned with one difference of neighbouring levels over the probability of that
/// level; the even and the odd teeth of the finer comb are the two coarse ones, so that the differences telescope exactly and are of second order. Work is `2^j`:
/// finite in the mean for `deeper < 1/2`. Where the squares of differences fall by `2^-b` a level the variance is finite for `deeper > 2^-b`: `b = 2`
/// on edges of the extinction and `b = 4` on smooth rays under a law of bounded curvature, less by a half to one at the kink of the linear law; before a comb resolves a feature
/// differences do not fall at all. From a particle under a law with an atom the survival itself jumps, and `b` is one half at best.
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
    let mut fine_teeth = teeth;
    let mut probability = f64::from(1.0 - deeper);
    while uniform(rng) < deeper {
        fine_teeth = fine_teeth.saturating_mul(2);
        probability *= f64::from(deeper);
    }
    let u = uniform(rng);
    let a = f64::from(comb(&field, &stretch, fine_teeth, 0.5 * u, tally));
    let b = f64::from(comb(&field, &stretch, fine_teeth, 0.5 * (u + 1.0), tally));
    channels.of(1.0).map(|r| {
        let at = |depth: f64| passage.survival(f64::from(r) * depth);
        let difference = at(0.5 * (a + b)) - 0.5 * (at(a) + at(b));
        (at(f64::from(coarse)) + difference / probability) as f32
    })
}
