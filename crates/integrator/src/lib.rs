#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod camera_ray;
mod cost;
mod counters;
mod dispatch;
mod error;
mod kernel;
mod layers;
mod lights;
mod media;
mod passes;
mod plan;
mod prepass;
mod renderer;
mod sampler;
mod settings;

pub use cost::PathCost;
pub use counters::Counters;
pub use error::{Error, Parameter, Remedy};
pub use passes::{Monitor, Unmonitored};
pub use plan::{Channels, Events, KernelAxes, PhaseFunctions, Plan, PlannedVolume, World};
pub use prepass::{Prepass, RecordedRays};
pub use renderer::Renderer;
pub use sampler::PathSampler;
pub use settings::{DEFAULT_MAX_EVENTS, LightSampling, RenderSettings, ShadowRoulette};
