#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod channels;
mod clamped;
mod collisions;
mod color;
pub mod distance;
mod emission;
mod error;
mod field;
mod grid;
mod index_map;
mod majorant;
mod medium;
mod method;
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
pub use emission::{
    BlackbodyRadiance, COLDEST_KELVIN, ColorRamp, EmissionDirections, EmissionField, EmissionPoint,
    EmissionReport, EmissionSource, EmissionView, HOTTEST_KELVIN, blackbody, rgb_of_xyz,
    xyz_of_spectrum,
};
pub use error::Error;
pub use field::{ExactField, MajorantSegment, RayField};
pub use grid::{BuildReport, GridView, Half, Interpolation, Voxel, VoxelGrid, VoxelGridOptions};
pub use majorant::{
    Adaptive, AnyPartition, COLLISION_COST, Cell, Corner, GridRay, Hierarchy, Lowest,
    MajorantStructure, Majorants, Partition, STEP_COST, StructureCost, WideRay,
};
pub use medium::{
    Albedo, AnyGridRay, AnyRay, BoxShape, FieldKernel, GridShape, HomogeneousRay, Medium, Optics,
    Shape, Span, VoxelKernel,
};
pub use method::{
    Expectation, Facts, Named, Transmittances, Work, from_name_or_auto, name_or_auto,
};
pub use phase::{Phase, PhaseAt};
pub use pileus_math::{Bounds3, Spectrum, random};
pub use scaled::Scaled;
pub use tally::Tally;
pub use transmittance::optical_depth;
