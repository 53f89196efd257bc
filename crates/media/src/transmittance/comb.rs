//! Combs: equidistant samples of a stretch with one common offset.

use crate::field::RayField;
use crate::stretch::Stretch;
use crate::tally::Tally;

/// Optical depth of a stretch by `teeth` samples at equal distances, the first at `offset` in
/// [0, 1) of a distance. Unbiased for a uniform offset.
#[inline(always)]
pub(super) fn comb<F: RayField>(
    field: &F,
    stretch: &Stretch,
    teeth: u32,
    offset: f32,
    tally: &mut Tally,
) -> f32 {
    let distance = f64::from(stretch.length) / f64::from(teeth);
    let mut sum = 0.0f64;
    for tooth in 0..teeth {
        let t = stretch.at_length(((f64::from(tooth) + f64::from(offset)) * distance) as f32);
        sum += f64::from(field.sigma_t_anywhere(t));
    }
    tally.lookups += u64::from(teeth);
    (sum * distance) as f32
}
