//! Emission.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelSample;
use crate::path_record::PathRecord;

/// Radiance that surfaces and volumes emit, seen directly.
pub static EMISSION: Layer = Layer {
    name: "emission",
    meaning: "radiance of surfaces and volumes that emit, seen directly",
    channels: &["emission.R", "emission.G", "emission.B"],
    reconstruction: Reconstruction::Mean(
        |_: &PixelSample, path: &PathRecord, values: &mut [f32]| {
            values.copy_from_slice(&path.emission);
        },
    ),
};
