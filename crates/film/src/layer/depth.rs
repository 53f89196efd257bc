//! Depth.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelSample;
use crate::path_record::PathRecord;

/// Distance of the first event along the camera's axis, scene units: the mean over what was met,
/// which is the mean of the transmittance-weighted depth of a medium. Where nothing was met, 1e10.
pub static DEPTH: Layer = Layer {
    name: "depth",
    meaning: "distance of the first event along the view axis, scene units (of a panorama from the camera), weighted by transmittance; 1e10 where there is none",
    channels: &["depth.Z"],
    reconstruction: Reconstruction::WeightedMean {
        take: |_: &PixelSample, path: &PathRecord, values: &mut [f32]| {
            values.copy_from_slice(&[path.depth, path.weight]);
        },
        nothing: 1e10,
    },
};
