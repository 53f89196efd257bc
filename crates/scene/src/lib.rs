#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod assemble;
pub mod bsdf;
pub mod by_name;
pub mod camera;
mod emission;
pub mod environment;
mod environment_file;
pub mod error;
mod file;
mod files;
pub mod flake_spec;
mod flakes;
pub mod gltf;
mod gltf_accessor;
mod gltf_buffer;
mod gltf_instances;
mod gltf_material;
mod gltf_mesh;
mod gltf_phase;
mod gltf_pose;
mod gltf_texture;
mod gltf_volume;
mod hint;
mod image_guard;
pub mod json;
mod law;
pub mod light;
pub mod option;
mod phase;
pub mod phase_spec;
mod radiance_hdr;
pub mod schema_rule;
mod sky;
pub mod surface;
pub mod uri;
pub mod volume;
mod volume_rules;
pub mod volume_spec;
pub mod whole;

pub use assemble::{CameraRequest, Loaded, Scene, SceneRequest};
pub use bsdf::{Bsdf, BsdfSample};
pub use by_name::ByName;
pub use camera::Camera;
pub use environment::{EnvSample, Environment, EnvironmentImage};
pub use error::{Error, Place};
pub use hint::Hint;
pub use light::{Light, Point, Spot, Sun};
pub use sky::{ClearSky, SkyFault, default_sky};
pub use surface::{
    EmissiveTriangle, GlassRule, Hit, Interaction, Interior, Obstacle, SurfaceParameters, Surfaces,
};
pub use volume::{Volume, VolumeSource};
pub use volume_spec::VolumeSpec;
