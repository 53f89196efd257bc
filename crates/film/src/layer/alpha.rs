//! Alpha.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelMoments;

/// One minus the transmittance towards the background; zero where no sample counted. An unbiased
/// mean may leave `[0, 1]` by its noise.
pub static ALPHA: Layer = Layer {
    name: "alpha",
    meaning: "one minus the transmittance towards the background",
    channels: &["A"],
    reconstruction: Reconstruction::Replicated(alpha),
};

fn alpha(pixel: &PixelMoments, values: &mut [f32]) {
    values.fill(pixel.mean_of(3) as f32);
}
