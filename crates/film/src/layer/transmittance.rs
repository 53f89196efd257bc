//! Transmittance.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelSample;
use crate::path_record::PathRecord;

/// Share of the background that is seen through volumes, per channel; alpha is one minus its mean
/// over channels. To both a surface is opaque, glass too; where it is cut out it is not there.
pub static TRANSMITTANCE: Layer = Layer {
    name: "transmittance",
    meaning: "background seen through volumes; behind any surface, glass too, zero",
    channels: &["transmittance.R", "transmittance.G", "transmittance.B"],
    reconstruction: Reconstruction::Mean(
        |_: &PixelSample, path: &PathRecord, values: &mut [f32]| {
            values.copy_from_slice(&path.transmittance);
        },
    ),
};
