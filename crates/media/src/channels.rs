//! How the channels of a medium share the extinction of its field: grey, or in fixed ratios.

use glam::Vec3;
use pileus_math::Spectrum;

/// How channels share the extinction of a field.
pub trait Channels: Copy {
    /// What is estimated for all channels at once.
    type Value: Spectrum;
    /// Extinction, or optical depth, per channel for that of the field.
    fn of(self, sigma_t: f32) -> Self::Value;
}

/// One channel, whose extinction is the field's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grey;

impl Channels for Grey {
    type Value = f32;
    #[inline(always)]
    fn of(self, sigma_t: f32) -> f32 {
        sigma_t
    }
}

/// Three channels, whose extinctions are the field's times these factors, in [0, 1]: the field's
/// bounds hold for all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChromaticRatio(pub Vec3);

impl Channels for ChromaticRatio {
    type Value = Vec3;
    #[inline(always)]
    fn of(self, sigma_t: f32) -> Vec3 {
        self.0 * sigma_t
    }
}
