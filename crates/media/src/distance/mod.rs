//! Free-flight samplers: where the next real collision is.

mod delta;

pub use delta::{Flight, delta_tracking};
