//! Indirect light.

use super::background::BACKGROUND;
use super::definition::{Layer, Reconstruction};
use super::direct::DIRECT;
use super::emission::EMISSION;

/// Radiance that was scattered more than once: the picture without background, emission and direct
/// light, which are kept for it. The four add up to the picture.
pub static INDIRECT: Layer = Layer {
    name: "indirect",
    meaning: "radiance scattered more than once: beauty without background, emission and direct",
    channels: &["indirect.R", "indirect.G", "indirect.B"],
    reconstruction: Reconstruction::Remainder(&[&BACKGROUND, &EMISSION, &DIRECT]),
};
