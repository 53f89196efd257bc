#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod assemble;
pub mod bsdf;
pub mod camera;
pub mod error;
mod file;
mod files;
pub mod gltf;
pub mod json;
pub mod light;
mod spec;
pub mod surface;
pub mod uri;
pub mod volume;

pub use assemble::{CameraRequest, Focus, LensRequest, Loaded, Scene, SceneRequest};
pub use bsdf::{Bsdf, BsdfSample};
pub use camera::{Camera, Lens, Orbit, Projection};
pub use error::{Error, Place};
pub use light::environment::{EnvSample, Environment, EnvironmentImage};
pub use light::punctual::*;
pub use light::sky::{ClearSky, SkyFault, default_sky};
pub use spec::by_name::ByName;
pub use spec::volume_spec::VolumeSpec;
pub use spec::{
    Hint, by_name, microflake_spec, option, phase_spec, schema_rule, volume_spec, whole,
};
pub use surface::{
    EmissiveTriangle, GlassRule, Hit, Interaction, Interior, Obstacle, SurfaceParameters, Surfaces,
};
pub use volume::{Volume, VolumeSource};
