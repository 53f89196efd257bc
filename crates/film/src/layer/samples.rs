//! The number of samples.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelMoments;

/// How many samples count in the pixel: those asked for, without those that were dropped. Exact up
/// to 2^24, rounded to 24 binary digits beyond.
pub static SAMPLES: Layer = Layer {
    name: "samples",
    meaning: "number of samples that count in the pixel, dropped ones left out",
    channels: &["samples.Y"],
    reconstruction: Reconstruction::Derived(samples),
};

fn samples(pixel: &PixelMoments, values: &mut [f32]) {
    values.fill(pixel.count() as f32);
}
