//! The media of a scene as the path kernel sees them: free flights and transmittance, one implementation per kind of scene.

mod index;
mod overlapping;
mod single_grey;
mod under_law;

pub(crate) use index::{MediaIndex, Met};
pub(crate) use overlapping::Overlapping;
pub(crate) use single_grey::{AnyStructure, DefaultStructure, SingleGrey, Structures};
pub(crate) use under_law::UnderLaw;

use glam::{DVec3, Vec3};
use pileus_media::distance::DistanceSampler;
use pileus_media::transmittance::Estimator;
use pileus_media::{Phase, Tally};
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
#[derive(Debug, Clone, Copy)]
pub(crate) struct Collision {
    pub(crate) t: f64,
    pub(crate) medium: usize,
}

/// The medium at one of whose particles a ray starts; `None` for cameras, surfaces and bodies. It matters under laws that are not exponential.
pub(crate) type Start = Option<usize>;

/// What a free flight carries through its null collisions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Flown {
    /// Path throughput, albedo included.
    pub(crate) beta: Vec3,
    /// Probability of all null decisions since the flight began: the density of the same walk under light sampling, over its density
    /// under path sampling, is one over this.
    pub(crate) null_probability: f32,
}

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
    /// Whether weights count the densities along the way: of null collisions, which trackers and ratio tracking share, or of the
    /// escape, which regular tracking knows. Others leave them out, on both sides.
    pub(crate) fn weigh_the_way(self) -> bool {
        match self.transmittance {
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
    /// Whether it matters where a ray starts: else nobody keeps account of it.
    const LAWS: bool = false;

    /// Flies `from` a start along a ray to the next real collision before `t_max`; `None` when the ray gets there. `first`: stratified majorant depth of the first collision.
    fn flight<R: Rng>(
        &self,
        from: (&Ray, Start),
        t_max: f64,
        first: Option<f32>,
        flown: &mut Flown,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision>;

    /// An estimate of the transmittance `from` a start along a ray up to `t_max`, a place that is correlated with no medium. Walks whose product falls below `threshold` are played
    /// roulette.
    fn transmittance<R: Rng>(
        &self,
        from: (&Ray, Start),
        t_max: f64,
        threshold: f32,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow;

    /// Calls `visit` with scattering coefficient per channel, 1/length, and phase function of every medium at a point.
    fn scattering(&self, p_world: DVec3, visit: impl FnMut(Vec3, &Phase));

    /// The part of a ray up to `t_max` that may hold extinction.
    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)>;

    /// Phase function and albedo at a collision.
    fn properties(&self, collision: &Collision, p_world: DVec3) -> (Phase, Vec3);
}
