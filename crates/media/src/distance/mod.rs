//! Free-flight samplers: where the next real collision is. One file per sampler, and all of them by name.

mod decomposition;
mod delta;
mod depth;
mod equiangular;
mod progressive;
mod ray_marching;
mod regular;
mod sampler;
mod spectral;
mod tracking;
mod under_law;
mod weighted_delta;

pub use decomposition::decomposition_tracking;
pub use delta::{delta_tracking, delta_tracking_by_mean};
pub use equiangular::Equiangular;
pub use progressive::{ProgressiveBounds, ProgressiveRay};
pub use ray_marching::{MARCHING_STEPS, ray_marching_flight};
pub use regular::regular_flight;
pub use sampler::DistanceSampler;
pub use spectral::{real_probability, spectral_tracking};
pub use under_law::regular_flight_under_law;
pub use weighted_delta::weighted_delta_tracking;

/// How a free flight ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flight {
    /// A real collision at this ray parameter.
    Collision(f32),
    /// The ray left the field.
    Escape,
}

/// A free flight with what the throughput is to be multiplied by.
///
/// The measure `sigma_t(t) exp(-tau(t)) dt`, with the rest `exp(-tau(end))` at the escape, is the mean of the weighted flights in every channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeightedFlight<S> {
    /// How it ended.
    pub flight: Flight,
    /// Factor on the throughput per channel; the albedo is not in it.
    pub weight: S,
    /// Probability of all decisions for null collisions on the way; for samplers that know the optical depth, on escape, the transmittance.
    pub null_probability: f32,
}
