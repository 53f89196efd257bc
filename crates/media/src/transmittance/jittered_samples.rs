//! Jittered equidistant samples of an interval: all have one common offset [Kettunen et al. 2021].

use crate::field::RayField;
use crate::ray_interval::RayInterval;
use crate::tally::Tally;

/// Optical depth of an interval by `samples` jittered equidistant samples, the first at `offset` in
/// [0, 1) of their distance. Unbiased for a uniform offset.
#[inline(always)]
pub(super) fn jittered_depth<F: RayField>(
    field: &F,
    interval: &RayInterval,
    samples: u32,
    offset: f32,
    tally: &mut Tally,
) -> f32 {
    let distance = f64::from(interval.length) / f64::from(samples);
    let mut sum = 0.0f64;
    for sample in 0..samples {
        let t = interval.at_length(((f64::from(sample) + f64::from(offset)) * distance) as f32);
        sum += f64::from(field.sigma_t_anywhere(t));
    }
    tally.lookups += u64::from(samples);
    (sum * distance) as f32
}
