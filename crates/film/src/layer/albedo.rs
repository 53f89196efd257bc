//! Albedo.

use super::definition::{Layer, Reconstruction};
use crate::moments::PixelSample;
use crate::path_record::PathRecord;

/// Albedo at the first event: single-scattering albedo or base colour. The plain mean over the
/// samples, black for those that met nothing: what denoisers take.
pub static ALBEDO: Layer = Layer {
    name: "albedo",
    meaning: "albedo of the first event, volumes included",
    channels: &["albedo.R", "albedo.G", "albedo.B"],
    reconstruction: Reconstruction::Mean(
        |_: &PixelSample, path: &PathRecord, values: &mut [f32]| {
            values.copy_from_slice(&path.albedo);
        },
    ),
};
