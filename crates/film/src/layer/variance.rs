//! The variance of radiance and alpha.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelMoments;

/// The estimated variance of the pixel's mean radiance and alpha, see
/// [`PixelMoments::variance_of_mean`]: the square of its standard error.
///
/// Infinite means unknown (fewer than two samples). What is known but leaves the range of 32-bit
/// floats stays known: variances above 3.4e38 (noise above 1.8e19) are the largest finite float,
/// those below 1.4e-45 that are not zero the smallest.
///
/// Alpha's has a layer of its own: Mitsuba refuses to split an image with two alphas.
pub static VARIANCE: Layer = Layer {
    name: "variance",
    meaning: "variance of the mean of radiance and alpha, infinite where it is not known",
    channels: &["variance.R", "variance.G", "variance.B", "variance_alpha.Y"],
    reconstruction: Reconstruction::Derived(variance),
};

fn variance(pixel: &PixelMoments, values: &mut [f32]) {
    for (value, variance) in values.iter_mut().zip(pixel.variance_of_mean()) {
        *value = nearest_with_same_meaning(variance);
    }
}

/// The nearest of the floats that say the same: infinite, positive and finite, or zero.
fn nearest_with_same_meaning(v: f64) -> f32 {
    if v > 0.0 && v.is_finite() { (v as f32).clamp(f32::from_bits(1), f32::MAX) } else { v as f32 }
}
