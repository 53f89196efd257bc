#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod channels;
mod clamped;
mod collisions;
mod color;
pub mod distance;
pub mod emission;
mod error;
mod field;
mod grid;
mod index_map;
pub mod kernel;
pub mod majorant;
mod medium;
pub mod method;
pub mod microflakes;
pub mod phase;
mod ray_interval;
mod scaled;
mod tally;
pub mod transmittance;
pub mod transmittance_function;

pub use channels::{Channels, ChromaticRatio, Grey};
pub use clamped::Clamped;
pub use collisions::{Tentative, TentativeCollisions};
pub use color::ColorGrid;
pub use error::Error;
pub use field::{ExactField, MajorantSegment, RayField};
pub use grid::{BuildReport, Interpolation, VoxelGrid, VoxelGridOptions};
pub use medium::{Albedo, AnyRay, FieldKernel, Medium, Optics, Span};
pub use phase::{Phase, PhaseAt};
pub use pileus_math::{Bounds3, Spectrum, random};
pub use scaled::Scaled;
pub use tally::Tally;
pub use transmittance::optical_depth;
