//! glTF scenes with OpenVDB volumes: camera, lights, environment, placed media.
#![forbid(unsafe_code)]

pub mod camera;
pub mod environment;
pub mod error;
pub mod light;
pub mod volume;

pub use camera::Camera;
pub use environment::{EnvSample, Environment, EnvironmentImage};
pub use error::{Error, Place};
pub use light::{Light, Point, Spot, Sun};
pub use volume::Volume;

/// Everything an image is made from, immutable; nothing in it touches a file any more.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The camera, bound to the resolution of the full image.
    pub camera: Camera,
    /// The participating media; they may overlap.
    pub volumes: Vec<Volume>,
    /// Lights without extent.
    pub lights: Vec<Light>,
    /// Light from all around.
    pub environment: Environment,
    /// What the files contain and the renderer leaves out, as sentences for people.
    pub not_modelled: Vec<String>,
}
