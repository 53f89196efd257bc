//! A participating medium placed in the scene.

use std::sync::Arc;

use pileus_media::Medium;

/// A volume of the scene: a medium in world space and where it came from.
#[derive(Debug, Clone)]
pub struct Volume {
    /// The user's name for it.
    pub name: String,
    /// The medium, in world space.
    pub medium: Arc<Medium>,
}
