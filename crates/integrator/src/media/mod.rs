//! The media of a scene as the path kernel sees them: free flights and transmittance, one implementation per kind of scene.

mod index;
mod overlapping;
mod single_chromatic;
mod single_grey;
mod under_law;

pub(crate) use index::{MediaIndex, Met};
pub(crate) use overlapping::Overlapping;
pub(crate) use single_chromatic::SingleChromatic;
pub(crate) use single_grey::{AnyStructure, DefaultStructure, SingleGrey, SingleGrid, Structures};
pub(crate) use under_law::UnderLaw;

use glam::{DVec3, Vec3};
use pileus_media::distance::DistanceSampler;
use pileus_media::transmittance::Estimator;
use pileus_media::{PhaseAt, Spectrum, Tally};
use rand_core::Rng;
use smallvec::SmallVec;

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
#[derive(Debug, Clone, Copy)]
pub(crate) struct Collision {
    pub(crate) t: f64,
    pub(crate) medium: usize,
}

/// The medium at one of whose particles a ray starts; `None` for cameras, surfaces and bodies. It matters under laws that are not exponential.
pub(crate) type Start = Option<usize>;

/// A ray from where it starts to a distance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Leg<'a> {
    pub(crate) ray: &'a Ray,
    pub(crate) start: Start,
    pub(crate) t_max: f64,
}

/// What a free flight carries through its null collisions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Flown<N> {
    /// Path throughput, albedo included.
    pub(crate) beta: Vec3,
    /// Probability of all null decisions since the flight began: the density of the same walk under light sampling, over its density
    /// under path sampling, is one over this.
    pub(crate) null_probability: N,
}

/// Where a flight ended for some of the channels that began it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ending<N> {
    /// One for these channels, zero for others.
    pub(crate) channels: Vec3,
    /// As in [`Flown`].
    pub(crate) null_probability: N,
    /// The collision; none: they got to the flight's end.
    pub(crate) collision: Option<Collision>,
}

/// Where a flight ended for those channels that did not end with the first, for media whose channels part: three channels end at three points at most.
pub(crate) type Parted<N> = SmallVec<[Ending<N>; 2]>;

/// The same for media whose channels do not part.
pub(crate) type Together = [Ending<f32>; 0];

/// What a shadow ray found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shadow {
    /// Unbiased estimate of the transmittance per channel.
    pub(crate) transmittance: Vec3,
    /// Density of the same walk under path sampling over its density here, per channel of the throughput.
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
    /// Whether weights count the densities along the way through a medium, grey or not: of null collisions, which trackers and ratio tracking share, or of the
    /// escape, which regular tracking knows. Others leave them out, on both sides.
    ///
    /// With several channels a shadow ray knows the null probability of each; the density of a flight is their mean by the throughput at its start. Delta tracking
    /// decides by the plain mean at every collision, and the product of those means is none of a product per channel.
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
    /// Probability of null decisions: of all channels at once, or of each.
    type Nulls: Spectrum + Send;
    /// Whether the channels of a path may part.
    const PARTS: bool = false;
    /// What gets the endings of parted channels.
    type Others: Default + IntoIterator<Item = Ending<Self::Nulls>>;
    /// Whether it matters where a ray starts: else nobody keeps account of it.
    const LAWS: bool = false;

    /// Flies to the next real collision before the end of the leg; `None` when the ray gets there. `first`: stratified majorant depth of the first collision, and
    /// a stratified uniform number for what it is taken for.
    ///
    /// Where channels part, throughput and collision are those of some channels, and `others` gets the rest.
    fn flight<R: Rng>(
        &self,
        leg: Leg<'_>,
        first: Option<[f32; 2]>,
        flown: &mut Flown<Self::Nulls>,
        others: &mut Self::Others,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision>;

    /// An estimate of the transmittance of a leg that ends at a place which is correlated with no medium, for the channels that have throughput in `beta`.
    /// Walks whose product falls below `threshold` are played roulette.
    fn transmittance<R: Rng>(
        &self,
        leg: Leg<'_>,
        threshold: f32,
        beta: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow;

    /// Calls `visit` with scattering coefficient per channel, 1/length, and phase function of every medium at a point, for light that arrives along `incoming`.
    fn scattering<R: Rng>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
        visit: impl FnMut(Vec3, PhaseAt<'_>),
    );

    /// The part of a ray up to `t_max` that may hold extinction.
    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)>;

    /// Phase function and albedo at a collision of a ray along `incoming`.
    fn properties<R: Rng>(
        &self,
        collision: &Collision,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> (PhaseAt<'_>, Vec3);
}
