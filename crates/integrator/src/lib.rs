#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod cost;
mod counters;
mod error;
mod expected;
mod interior;
mod lights;
mod limits;
mod media;
mod passage;
mod path;
mod pilot;
mod plan;
mod render;
mod sampler;
mod settings;
mod thickness;
mod warnings;
mod world;

pub use cost::PathCost;
pub use counters::Counters;
pub use error::{Error, Parameter, Remedy};
pub use pilot::Pilot;
pub use plan::{Plan, PlannedVolume};
pub use render::{Monitor, Unmonitored, render, sample_pixel};
pub use sampler::PathSampler;
pub use settings::{DEFAULT_MAX_EVENTS, LightSampling, RenderSettings, ShadowRoulette};
