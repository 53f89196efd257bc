//! Majorants along a ray: the walk through a grid's bounds.

mod walk;

pub use walk::GridRay;
