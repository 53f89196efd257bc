//! Transmittance of a ray: one file per estimator.

mod delta;
mod ratio;
mod regular;

pub use delta::delta_transmittance;
pub use ratio::{RatioEstimate, ratio_tracking, ratio_tracking_with_roulette};
pub use regular::optical_depth;
