//! Normals.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelSample;
use crate::path_record::PathRecord;

/// Normal at the first event, in the world: of a medium, where density falls fastest. The plain mean
/// over the samples, zero for those that met nothing, so that edges are as smooth as the picture's.
pub static NORMAL: Layer = Layer {
    name: "normal",
    meaning: "normal of the first event in the world, of a volume minus the gradient of density",
    channels: &["normal.X", "normal.Y", "normal.Z"],
    reconstruction: Reconstruction::Mean(
        |_: &PixelSample, path: &PathRecord, values: &mut [f32]| {
            values.copy_from_slice(&path.normal);
        },
    ),
};
