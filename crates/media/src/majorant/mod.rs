//! Majorants along a ray: partitions of a grid into cells with bounds, and the walk through them.

mod adaptive;
mod cost;
mod hierarchy;
mod kd_tree;
mod partition;
mod structure;
mod uniform;
mod walk;
mod wide;

pub(crate) use adaptive::Adaptive;
pub use cost::StructureCost;
pub(crate) use cost::leaf_cost;
pub(crate) use partition::Partition;
pub(crate) use structure::AnyPartition;
pub use structure::{MajorantStructure, Majorants};
pub(crate) use walk::{GridRay, Line, Lowest};
pub(crate) use wide::{WideRay, distance};
