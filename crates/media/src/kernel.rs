//! What kernels know of a medium: code that is compiled for each shape and each voxel type, as the
//! renderer's and the experiments' is. All else asks [`Medium`](crate::Medium).

pub use crate::grid::Voxel;
pub use crate::medium::{BoxShape, GridShape, Shape, VoxelKernel};
