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
    type Flight: FlightUnderWay<Nulls = Self::Nulls, Decoupled = Self::Decoupled>;
    /// Ends of flights of channels that did not end with the first.
    type Decoupled: Default + IntoIterator<Item = FlightEnd<Self::Nulls>>;
    /// Whether extinction is the same for all channels.
    const GREY: bool;
    /// Whether the channels of a path may decouple.
    const DECOUPLES: bool;

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

    /// For shadow rays of a path with throughput `beta` through a medium: the share of its
    /// extinction to walk, and the channels' ratios to that; `None` if it is clear for all of them.
    fn shadow_ratios(self, beta: Vec3, ratio: Vec3) -> Option<(f32, Vec3)>;
}

/// A flight under way, of one channel or of all.
pub(crate) trait FlightUnderWay {
    /// Probability of null decisions: of all channels at once, or of each.
    type Nulls;
    /// Ends of flights of channels that did not end with the first.
    type Decoupled;

    /// Begins a flight with throughput `beta`.
    fn begin(beta: Vec3) -> Self;

    /// Its throughput, zero for channels that have ended.
    fn throughput(&self) -> Vec3;

    /// Distance at which the last channel has ended in a collision; `None` if any is under way.
    fn t_end(&self) -> Option<f64>;

    /// Multiplies the throughput by the weight of a flight of its own through one medium.
    fn weigh(&mut self, weight: Vec3);

    /// Multiplies the null probability of the channels under way.
    fn count_nulls(&mut self, probability: f32);

    /// Ends the flight of the channels under way with `last`.
    fn end(
        self,
        last: Option<Collision>,
        decoupled: &mut Self::Decoupled,
    ) -> FlightEnd<Self::Nulls>;
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

impl FlightUnderWay for CoupledFlight {
    type Nulls = f32;
    type Decoupled = NeverDecoupled<f32>;

    #[inline(always)]
    fn begin(beta: Vec3) -> CoupledFlight {
        CoupledFlight { before: beta, beta, null_probability: 1.0, collision: None }
    }

    #[inline(always)]
    fn throughput(&self) -> Vec3 {
        self.beta
    }

    #[inline(always)]
    fn t_end(&self) -> Option<f64> {
        self.collision.map(|collision| collision.t)
    }

    #[inline(always)]
    fn weigh(&mut self, weight: Vec3) {
        self.beta *= weight;
    }

    #[inline(always)]
    fn count_nulls(&mut self, probability: f32) {
        self.null_probability *= probability;
    }

    #[inline(always)]
    fn end(self, last: Option<Collision>, _: &mut NeverDecoupled<f32>) -> FlightEnd<f32> {
        let CoupledFlight { before, beta, null_probability, collision } = self;
        FlightEnd { before, beta, null_probability, collision: collision.or(last) }
    }
}
