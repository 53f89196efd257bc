//! All samplers of flights by name.

use super::WeightedFlight;
use super::decomposition::decomposition_tracking;
use super::delta::delta_tracking_by_mean;
use super::ray_marching::{MARCHING_STEPS, ray_marching_flight};
use super::regular::regular_flight;
use super::spectral::spectral_tracking;
use super::weighted_delta::weighted_delta_tracking;
use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::ExactField;
use pileus_math::random::exponential;
use crate::tally::Tally;
use rand_core::Rng;

/// A way to sample the distance to the next real collision. Grey or per channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DistanceSampler {
    /// Closed form; homogeneous media only.
    Analytic,
    /// Delta tracking; with several channels their plain mean decides.
    Delta,
    /// Delta tracking with weights, for rates that need not bound the extinction.
    WeightedDelta,
    /// Delta tracking whose minorant needs no lookup.
    Decomposition,
    /// Exact inversion of the optical depth, cell by cell.
    Regular,
    /// Delta tracking, decided by the throughput-weighted mean over channels.
    Spectral,
    /// Plain ray marching: biased.
    RayMarching,
}

impl DistanceSampler {
    /// All of them.
    pub const ALL: [DistanceSampler; 7] = [
        DistanceSampler::Analytic,
        DistanceSampler::Delta,
        DistanceSampler::WeightedDelta,
        DistanceSampler::Decomposition,
        DistanceSampler::Regular,
        DistanceSampler::Spectral,
        DistanceSampler::RayMarching,
    ];

    /// The name that jobs use.
    pub const fn name(self) -> &'static str {
        match self {
            DistanceSampler::Analytic => "analytic",
            DistanceSampler::Delta => "delta",
            DistanceSampler::WeightedDelta => "weighted_delta",
            DistanceSampler::Decomposition => "decomposition",
            DistanceSampler::Regular => "regular",
            DistanceSampler::Spectral => "spectral",
            DistanceSampler::RayMarching => "ray_marching",
        }
    }

    /// The sampler of a name.
    pub fn from_name(name: &str) -> Option<DistanceSampler> {
        DistanceSampler::ALL.into_iter().find(|sampler| sampler.name() == name)
    }

    /// Whether weighted flights have the right mean, for a field whose bounds hold.
    pub fn is_unbiased(self) -> bool {
        self != DistanceSampler::RayMarching
    }

    /// Whether it is unbiased also where bounds do not hold.
    pub fn is_unbiased_without_bounds(self) -> bool {
        matches!(
            self,
            DistanceSampler::Analytic | DistanceSampler::WeightedDelta | DistanceSampler::Regular
        )
    }

    /// Whether it walks the majorants' tentative collisions and decides at each: the path densities of ratio tracking apply to it.
    pub fn decides_at_collisions(self) -> bool {
        matches!(
            self,
            DistanceSampler::Delta | DistanceSampler::Decomposition | DistanceSampler::Spectral
        )
    }

    /// Flies through `field` with throughput `beta`. `first`: an exponential variate to use first, for stratified flights.
    ///
    /// `Analytic` inverts the depth as `Regular` does, which for constant extinction is its closed form: whether a field is
    /// of that kind is the caller's to know.
    pub fn fly<F: ExactField, C: Channels, R: Rng + ?Sized>(
        self,
        field: F,
        channels: C,
        beta: C::Value,
        first: Option<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> WeightedFlight<C::Value> {
        let drawn = first.unwrap_or_else(|| exponential(rng));
        let walk = |field| TentativeCollisions::with_first(field, drawn);
        match self {
            DistanceSampler::Delta => delta_tracking_by_mean(walk(field), channels, rng, tally),
            DistanceSampler::WeightedDelta => {
                weighted_delta_tracking(walk(field), channels, beta, rng, tally)
            }
            DistanceSampler::Decomposition => {
                decomposition_tracking(walk(field), channels, beta, rng, tally)
            }
            DistanceSampler::Spectral => spectral_tracking(walk(field), channels, beta, rng, tally),
            DistanceSampler::Analytic | DistanceSampler::Regular => {
                regular_flight(&field, channels, beta, drawn, rng, tally)
            }
            DistanceSampler::RayMarching => {
                ray_marching_flight(field, channels, beta, MARCHING_STEPS, drawn, rng, tally)
            }
        }
    }
}
