//! Transmittance of a ray: one file per estimator, and all of them by name.

mod bidirectional;
mod comb;
mod debiased_ray_marching;
mod delta;
mod estimator;
mod next_flight;
mod pseries;
mod ratio;
mod ray_marching;
mod regular;
mod residual_ratio;
mod taylor;
mod unbiased_ray_marching;
mod under_law;
mod volterra;

pub use bidirectional::{BIDIRECTIONAL_STRETCH, bidirectional};
pub use debiased_ray_marching::{DEBIASED_TEETH, debiased_ray_marching};
pub use delta::delta_transmittance;
pub use estimator::Estimator;
pub use next_flight::next_flight;
pub use pseries::{PSERIES_STRETCH, pseries_cmf, pseries_cumulative};
pub use ratio::{RatioEstimate, ratio_tracking, ratio_tracking_with_roulette};
pub use ray_marching::{MARCHING_TEETH, ray_marching};
pub use regular::optical_depth;
pub(crate) use regular::{ray_depth, ray_t_at_depth};
pub use residual_ratio::{Control, residual_ratio_tracking};
pub use taylor::{TAYLOR_STRETCH, TaylorOrder, taylor};
pub use unbiased_ray_marching::unbiased_ray_marching;
pub use under_law::{Telescope, debiased_under_law, exact_under_law, telescope_difference};
pub use volterra::{VOLTERRA_STRETCH, volterra};
