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

pub use adaptive::Adaptive;
pub(crate) use cost::leaf_cost;
pub use cost::{COLLISION_COST, STEP_COST, StructureCost};
pub use hierarchy::Hierarchy;
pub use partition::{Cell, Partition};
pub use structure::{AnyPartition, MajorantStructure, Majorants};
pub(crate) use walk::Line;
pub use walk::{Corner, GridRay, Lowest};
pub use wide::WideRay;
pub(crate) use wide::distance;
