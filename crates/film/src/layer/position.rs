//! Positions.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelSample;
use crate::path_record::PathRecord;

/// Place of the first event in the world, scene units: the mean over what was met. Zero where
/// nothing was.
pub static POSITION: Layer = Layer {
    name: "position",
    meaning: "place of the first event in the world, scene units, weighted by transmittance",
    channels: &["position.X", "position.Y", "position.Z"],
    reconstruction: Reconstruction::WeightedMean {
        take: |_: &PixelSample, path: &PathRecord, values: &mut [f32]| {
            let [x, y, z] = path.position;
            values.copy_from_slice(&[x, y, z, path.weight]);
        },
        nothing: 0.0,
    },
};
