//! How three channels share one path: one file per way.

mod grey;
mod spectral;
mod split;

pub(crate) use grey::Grey;
pub(crate) use spectral::Spectral;
pub(crate) use split::Split;

use super::collisions::Collisions;
use super::{Collision, FlightEnd};
use glam::Vec3;
use pileus_media::{Spectrum, Tally};
use rand_core::Rng;

/// How channels share flights and shadow rays.
pub(crate) trait ChannelMode: Copy + Send + Sync {
    /// Probability of null decisions: of all channels at once, or of each.
    type Nulls: Spectrum + Send + Sync;
    /// A flight under way.
    type Flight;
    /// Ends of flights of channels that did not end with the first.
    type Decoupled: Default + IntoIterator<Item = FlightEnd<Self::Nulls>>;
    /// Whether extinction is the same for all channels.
    const GREY: bool;
    /// Whether the channels of a path may decouple.
    const DECOUPLES: bool;

    /// Begins a flight with throughput `beta`.
    fn begin(self, beta: Vec3) -> Self::Flight;

    /// The throughput of a flight under way, zero for channels that have ended.
    fn throughput(self, flight: &Self::Flight) -> Vec3;

    /// Share of a medium's extinction whose collisions the channels under way need, in [0, 1];
    /// `ratio`: of the channels' extinction to the strongest one's. Zero: the medium is clear for
    /// them.
    fn share(self, flight: &Self::Flight, ratio: Vec3) -> f32;

    /// Decides tentative collisions in order, until none is left or no channel is under way;
    /// whether that is so. `decision`: a stratified uniform number for the first.
    fn fly<C: Collisions, R: Rng>(
        self,
        flight: &mut Self::Flight,
        collisions: C,
        decision: Option<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> bool;

    /// Multiplies the throughput by the weight of a flight of its own through one medium.
    fn weigh(self, flight: &mut Self::Flight, weight: Vec3);

    /// Multiplies the null probability of the channels under way.
    fn count_nulls(self, flight: &mut Self::Flight, probability: f32);

    /// Ends the flight of the channels under way with `last`.
    fn end(
        self,
        flight: Self::Flight,
        last: Option<Collision>,
        decoupled: &mut Self::Decoupled,
    ) -> FlightEnd<Self::Nulls>;

    /// For shadow rays of a path with throughput `beta` through a medium: the share of its
    /// extinction to walk, and the channels' ratios to that; `None` if it is clear for all of them.
    fn shadow_ratios(self, beta: Vec3, ratio: Vec3) -> Option<(f32, Vec3)>;
}

/// Ends of flights where channels do not decouple: none.
pub(crate) type NeverDecoupled<N> = [FlightEnd<N>; 0];

/// A flight of all channels together.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CoupledFlight {
    before: Vec3,
    beta: Vec3,
    null_probability: f32,
    collision: Option<Collision>,
}

impl CoupledFlight {
    #[inline(always)]
    fn new(beta: Vec3) -> CoupledFlight {
        CoupledFlight { before: beta, beta, null_probability: 1.0, collision: None }
    }

    #[inline(always)]
    fn end(self, last: Option<Collision>) -> FlightEnd<f32> {
        let CoupledFlight { before, beta, null_probability, collision } = self;
        FlightEnd { before, beta, null_probability, collision: collision.or(last) }
    }
}
