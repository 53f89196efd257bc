//! Direct light.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelSample;
use crate::path_record::PathRecord;

/// Radiance that was scattered once, wherever it came from.
pub static DIRECT: Layer = Layer {
    name: "direct",
    meaning: "radiance scattered once",
    channels: &["direct.R", "direct.G", "direct.B"],
    reconstruction: Reconstruction::Mean(
        |_: &PixelSample, path: &PathRecord, values: &mut [f32]| {
            values.copy_from_slice(&path.direct);
        },
    ),
};
