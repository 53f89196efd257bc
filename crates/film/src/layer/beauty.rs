//! Radiance.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelMoments;

/// Radiance in linear Rec. 709 primaries, multiplied by alpha as EXR demands; black where no sample
/// counted.
pub static BEAUTY: Layer = Layer {
    name: "beauty",
    meaning: "radiance, linear Rec. 709 primaries",
    channels: &["R", "G", "B"],
    reconstruction: Reconstruction::Replicated(radiance),
};

fn radiance(pixel: &PixelMoments, values: &mut [f32]) {
    for (channel, value) in values.iter_mut().enumerate() {
        *value = pixel.mean_of(channel) as f32;
    }
}
