//! Split tracking: channels fly coupled until their events differ, then they decouple.
//!
//! Each channel by itself is delta tracking: weights of one, as in a grey render of it alone. What
//! is common is decided once: all channels of a flight meet the tentative collisions of the
//! strongest one's majorant, and one uniform number decides for all. Whatever a channel takes for
//! real, stronger ones take for real: what one walk costs serves all channels, and where they
//! collide at one point they scatter as one path. A sample holds three paths at most.
//!
//! Over a merged list of media it is as exact: the collisions of all media are one Poisson process
//! whose rate is the sum of their majorants, and each is classified per channel by the medium that
//! it belongs to.
//!
//! Measured against spectral MIS: `docs/charts/whole.md`.

use super::{ChannelMode, FlightUnderWay};
use crate::media::collisions::Collisions;
use crate::media::{Collision, FlightEnd};
use glam::Vec3;
use pileus_media::random::Decision;
use pileus_media::{Spectrum, Tally};
use rand_core::Rng;
use smallvec::SmallVec;

/// Channels decouple.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Split {
    /// Whether paths and shadow rays are weighted against each other: both then walk the same
    /// majorants, those of the strongest channel that began the flight. Else a flight that the
    /// strongest has left goes on with those of the next.
    pub(crate) weighted: bool,
}

/// A flight whose channels may end at different points.
#[derive(Debug, Clone)]
pub(crate) struct SplitFlight {
    before: Vec3,
    /// Throughput, weights of flights of their own included.
    beta: Vec3,
    /// One for channels under way, zero for others.
    under_way: Vec3,
    null_probability: Vec3,
    /// Ends so far: the last channel ends last.
    ended: SmallVec<[FlightEnd<Vec3>; 2]>,
}

impl SplitFlight {
    #[inline(always)]
    fn end_some(&mut self, channels: Vec3, collision: Option<Collision>) -> FlightEnd<Vec3> {
        self.under_way -= channels;
        FlightEnd {
            before: self.before * channels,
            beta: self.beta * channels,
            null_probability: self.null_probability,
            collision,
        }
    }
}

impl FlightUnderWay for SplitFlight {
    type Nulls = Vec3;
    type Decoupled = SmallVec<[FlightEnd<Vec3>; 2]>;

    #[inline(always)]
    fn begin(beta: Vec3) -> SplitFlight {
        SplitFlight {
            before: beta,
            beta,
            under_way: present(beta),
            null_probability: Vec3::ONE,
            ended: SmallVec::new(),
        }
    }

    #[inline(always)]
    fn throughput(&self) -> Vec3 {
        self.beta * self.under_way
    }

    #[inline(always)]
    fn t_end(&self) -> Option<f64> {
        if self.under_way != Vec3::ZERO {
            return None;
        }
        self.ended.last().and_then(|end| end.collision).map(|collision| collision.t)
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
    fn end(
        mut self,
        last: Option<Collision>,
        decoupled: &mut SmallVec<[FlightEnd<Vec3>; 2]>,
    ) -> FlightEnd<Vec3> {
        let under_way = self.under_way;
        let rest = (under_way != Vec3::ZERO).then(|| self.end_some(under_way, last));
        let mut ends = self.ended.into_iter().chain(rest);
        let nothing = FlightEnd {
            before: Vec3::ZERO,
            beta: Vec3::ZERO,
            null_probability: Vec3::ONE,
            collision: None,
        };
        let nearest = ends.next().unwrap_or(nothing);
        decoupled.extend(ends);
        nearest
    }
}

/// One for the channels that have throughput, zero for others.
#[inline(always)]
fn present(beta: Vec3) -> Vec3 {
    Spectrum::map(beta, |b| if b != 0.0 { 1.0 } else { 0.0 })
}

impl ChannelMode for Split {
    type Nulls = Vec3;
    type Flight = SplitFlight;
    type Decoupled = SmallVec<[FlightEnd<Vec3>; 2]>;
    const GREY: bool = false;
    const DECOUPLES: bool = true;

    #[inline(always)]
    fn share(self, flight: &SplitFlight, ratio: Vec3) -> f32 {
        let under_way = (ratio * flight.under_way).max_element();
        if self.weighted && under_way > 0.0 {
            // Also behind media in which some channels ended: shadow rays know nothing of that.
            return (ratio * present(flight.before)).max_element();
        }
        under_way
    }

    #[inline(always)]
    fn fly<C: Collisions, R: Rng>(
        self,
        flight: &mut SplitFlight,
        mut collisions: C,
        decision: Option<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> bool {
        let mut decision = decision.map(Decision::of_stratified);
        let mut inverse = 1.0;
        let mut under_way = flight.under_way;
        let mut null_probability = flight.null_probability;
        while let Some(tentative) = collisions.next_of_share(inverse, rng) {
            let sigma_t = collisions.sigma_t(tentative, tally);
            let real =
                (collisions.ratio() * under_way) * (inverse * (sigma_t / tentative.majorant));
            let mut u = decision.take().unwrap_or_else(|| Decision::new(rng));
            let collide = u.is_below_each(real, rng);
            if collide.any() {
                tally.collisions += 1;
                let channels = Vec3::select(collide, under_way, Vec3::ZERO);
                flight.null_probability = null_probability;
                let end = flight.end_some(channels, Some(collisions.place(tentative)));
                flight.ended.push(end);
                under_way = flight.under_way;
                if under_way == Vec3::ZERO {
                    break;
                }
                let strongest = (collisions.ratio() * under_way).max_element();
                if strongest <= 0.0 {
                    // None is left that could collide in this medium.
                    if !collisions.leave_medium() {
                        break;
                    }
                } else if C::ONE_MEDIUM && !self.weighted {
                    inverse = 1.0 / strongest;
                }
            } else {
                tally.null_collisions += 1;
                // Other media's collisions may have ended all channels that this one concerns: an
                // endless one would go on forever.
                if !C::ONE_MEDIUM
                    && (collisions.ratio() * under_way).max_element() <= 0.0
                    && !collisions.leave_medium()
                {
                    break;
                }
            }
            if collisions.weighted() {
                null_probability *= Vec3::ONE - real;
            }
        }
        flight.null_probability = null_probability;
        tally.majorant_steps += collisions.steps();
        flight.under_way == Vec3::ZERO
    }

    #[inline(always)]
    fn shadow_ratios(self, beta: Vec3, ratio: Vec3) -> Option<(f32, Vec3)> {
        let present = present(beta);
        let share = (ratio * present).max_element();
        // Channels that have left are as opaque as the strongest: they do not keep the walk alive.
        let ratios = Vec3::select(present.cmpgt(Vec3::ZERO), ratio / share, Vec3::ONE);
        (share > 0.0).then_some((share, ratios))
    }
}
