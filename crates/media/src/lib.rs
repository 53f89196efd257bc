#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod collisions;
mod color;
pub mod distance;
mod error;
mod field;
mod grid;
mod homogeneous;
mod majorant;
mod medium;
pub mod phase;
pub mod random;
mod tally;
pub mod transmittance;

pub use collisions::{Tentative, TentativeCollisions};
pub use color::ColorGrid;
pub use error::Error;
pub use field::{MajorantSegment, RayField};
pub use grid::{BuildReport, GridView, Half, Interpolation, Voxel, VoxelGrid, VoxelGridOptions};
pub use homogeneous::{HomogeneousMedium, HomogeneousRay};
pub use majorant::GridRay;
pub use medium::{Albedo, AnyGridRay, GridMedium, Medium, Span, VoxelKernel};
pub use phase::Phase;
pub use tally::Tally;
pub use transmittance::optical_depth;
