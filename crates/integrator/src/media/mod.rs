//! The media of a scene as the path kernel sees them: where the next real collision of a flight is,
//! and what a shadow ray finds.
//!
//! Two axes are independent of each other. *Events*: tentative collisions come from one grid
//! ([`OneGrid`]) or from a merged list of media ([`Merged`]). *Channels*: three channels share one
//! extinction, are split where their events differ, or are weighted ([`channels`]).

pub(crate) mod channels;
mod collisions;
mod entry;
mod index;
mod merged;
mod no_media;
mod one_grid;
mod walks;

pub(crate) use index::{MediaIndex, MetMedia};
pub(crate) use merged::Merged;
pub(crate) use no_media::NoMedia;
pub(crate) use one_grid::{AnyPhase, IsotropicOrHenyeyGreenstein, OneGrid, PhaseAxis};
pub(crate) use walks::flies_by_depth;

use channels::ChannelMode;
use glam::{DVec3, Vec3};
use pileus_media::distance::DistanceSampler;
use pileus_media::transmittance::Estimator;
use pileus_media::{PhaseAt, Tally};
use rand_core::Rng;

/// A ray in the world; `direction` is a unit vector.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: DVec3,
    pub(crate) direction: Vec3,
}

impl Ray {
    #[inline(always)]
    pub(crate) fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction.as_dvec3() * t
    }
}

/// A real collision: where on the ray and in which medium.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Collision {
    pub(crate) t: f64,
    pub(crate) medium: usize,
}

/// The medium at one of whose scatterers a ray starts; `None` for cameras, surfaces and interior
/// media. It matters for media with a transmittance function that is not exponential [d'Eon 2018].
pub(crate) type StartCorrelation = Option<usize>;

/// A ray from where it starts to a distance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RaySegment<'a> {
    pub(crate) ray: &'a Ray,
    pub(crate) start: StartCorrelation,
    pub(crate) t_max: f64,
}

/// How a flight ended for some of the channels that began it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FlightEnd<N> {
    /// Path throughput before the flight, zero for channels that ended elsewhere.
    pub(crate) before: Vec3,
    /// Path throughput at the end, without the albedo there.
    pub(crate) beta: Vec3,
    /// Probability of all null decisions since the flight began, of one without a collision: the
    /// density of the same walk under light sampling, over its density under path sampling, is one
    /// over this. After a collision nobody asks.
    pub(crate) null_probability: N,
    /// The collision; none: they got to the segment's end.
    pub(crate) collision: Option<Collision>,
}

/// What a shadow ray found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shadow {
    /// Unbiased estimate of the transmittance per channel.
    pub(crate) transmittance: Vec3,
    /// Density of the same walk under path sampling over its density here, per channel of the
    /// throughput.
    pub(crate) null_probability: Vec3,
}

impl Shadow {
    pub(crate) const CLEAR: Shadow =
        Shadow { transmittance: Vec3::ONE, null_probability: Vec3::ONE };
}

/// How a scene's media are sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Methods {
    /// Free flights.
    pub(crate) distance: DistanceSampler,
    /// Shadow rays.
    pub(crate) transmittance: Estimator,
}

impl Methods {
    /// Whether weights count the densities along the way through a medium, grey or not: of null
    /// collisions, which trackers and ratio tracking share, or of the escape, which regular
    /// tracking knows. Others leave them out, on both sides.
    ///
    /// With several channels a shadow ray knows the null probability of each; the density of a
    /// flight is their mean by the throughput at its start. Delta tracking decides by the plain
    /// mean at every collision, and the product of those means is none of a product per channel.
    pub(crate) fn weigh_the_way(self, grey: bool) -> bool {
        match self.transmittance {
            Estimator::Ratio if !grey && self.distance == DistanceSampler::Delta => false,
            Estimator::Ratio => self.distance.decides_at_collisions(),
            Estimator::Regular => {
                matches!(self.distance, DistanceSampler::Regular | DistanceSampler::Analytic)
            }
            _ => false,
        }
    }
}

/// All media of a scene.
pub(crate) trait Media: Sync {
    /// How channels share a path.
    type Channels: ChannelMode;

    /// Flies to the next real collision before the end of the segment, with throughput `beta`.
    /// `first`: stratified majorant depth of the first collision, and a stratified uniform number
    /// for what it is taken for.
    ///
    /// Where channels decouple, what is returned is the end of some of them, and `decoupled` gets
    /// the rest.
    fn flight<R: Rng + Clone>(
        &self,
        segment: RaySegment<'_>,
        beta: Vec3,
        first: Option<[f32; 2]>,
        decoupled: &mut <Self::Channels as ChannelMode>::Decoupled,
        rng: &mut R,
        tally: &mut Tally,
    ) -> FlightEnd<<Self::Channels as ChannelMode>::Nulls>;

    /// An estimate of the transmittance of a segment that ends at a place which is correlated with
    /// no medium, for the channels that have throughput in `beta`. Walks whose product falls below
    /// `threshold` undergo Russian roulette.
    fn transmittance<R: Rng + Clone>(
        &self,
        segment: RaySegment<'_>,
        threshold: f32,
        beta: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow;

    /// Calls `visit` with scattering coefficient per channel, 1/length, and phase function of every
    /// medium at a point, for light that arrives along `incoming`.
    fn scattering<R: Rng + Clone>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
        visit: impl FnMut(Vec3, PhaseAt<'_>),
    );

    /// The interval of a ray up to `t_max` that may hold extinction.
    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)>;

    /// Phase function and albedo at a collision of a ray along `incoming`.
    fn properties<R: Rng + Clone>(
        &self,
        collision: &Collision,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> (PhaseAt<'_>, Vec3);

    /// Whether it matters where a ray starts: some medium has a transmittance function that is not
    /// exponential.
    fn starts_matter(&self) -> bool;
}
