#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod block_z;
pub mod chart;
mod compare;
mod difference;
mod error;
pub mod experiment;
mod flip;
mod pair;
mod profile;

pub use crate::block_z::{BlockZ, block_z_test};
pub use crate::compare::{
    CompareSettings, Comparison, ERROR_BLOCK, ErrorSource, REL_MSE_EPSILON, compare, compare_with,
};
pub use crate::difference::{difference_image, difference_view};
pub use crate::error::Error;
pub use crate::flip::{Flip, flip, flip_rgb8};
pub use crate::profile::{Profile, ProfileCase, ProfileRay};
