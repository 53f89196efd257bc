//! The background.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelSample;
use crate::path_record::PathRecord;

/// Radiance of the environment that is seen directly.
pub static BACKGROUND: Layer = Layer {
    name: "background",
    meaning: "radiance of the environment seen directly",
    channels: &["background.R", "background.G", "background.B"],
    reconstruction: Reconstruction::Mean(
        |_: &PixelSample, path: &PathRecord, values: &mut [f32]| {
            values.copy_from_slice(&path.background);
        },
    ),
};
