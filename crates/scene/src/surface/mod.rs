//! Surfaces: what a material says at a point.

mod parameters;

pub use parameters::SurfaceParameters;
