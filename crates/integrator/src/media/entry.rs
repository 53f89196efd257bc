//! Where a ray meets a medium of a list, and the field that it walks there.

use super::merged::has_to_be_walked;
use super::{Ray, StartCorrelation};
use glam::{DVec3, Vec3};
use pileus_media::flakes::{FlakeRay, Flakes};
use pileus_media::law::{self, Law, Passage};
use pileus_media::{
    AnyGridRay, ExactField, FieldKernel, GridMedium, HomogeneousMedium, HomogeneousRay,
    MajorantSegment, Medium, RayField, Scaled, Span, Tally,
};
use rand_core::Rng;

/// A field of any kind of medium.
pub(super) enum AnyRay<'a> {
    Grid(AnyGridRay<'a>),
    Homogeneous(HomogeneousRay),
    GridOfFlakes(FlakeRay<'a, AnyGridRay<'a>>),
    HomogeneousFlakes(FlakeRay<'a, HomogeneousRay>),
}

impl RayField for AnyRay<'_> {
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        match self {
            AnyRay::Grid(ray) => ray.next_segment(),
            AnyRay::Homogeneous(ray) => ray.next_segment(),
            AnyRay::GridOfFlakes(ray) => ray.next_segment(),
            AnyRay::HomogeneousFlakes(ray) => ray.next_segment(),
        }
    }
    fn minorant(&self) -> f32 {
        match self {
            AnyRay::Grid(ray) => ray.minorant(),
            AnyRay::Homogeneous(ray) => ray.minorant(),
            AnyRay::GridOfFlakes(ray) => ray.minorant(),
            AnyRay::HomogeneousFlakes(ray) => ray.minorant(),
        }
    }
    fn sigma_t(&self, t: f32) -> f32 {
        match self {
            AnyRay::Grid(ray) => ray.sigma_t(t),
            AnyRay::Homogeneous(ray) => ray.sigma_t(t),
            AnyRay::GridOfFlakes(ray) => ray.sigma_t(t),
            AnyRay::HomogeneousFlakes(ray) => ray.sigma_t(t),
        }
    }
    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        match self {
            AnyRay::Grid(ray) => ray.sigma_t_anywhere(t),
            AnyRay::Homogeneous(ray) => ray.sigma_t_anywhere(t),
            AnyRay::GridOfFlakes(ray) => ray.sigma_t_anywhere(t),
            AnyRay::HomogeneousFlakes(ray) => ray.sigma_t_anywhere(t),
        }
    }
    fn distance(&self, t: f64) -> f64 {
        match self {
            AnyRay::Grid(ray) => ray.distance(t),
            AnyRay::GridOfFlakes(ray) => ray.distance(t),
            AnyRay::Homogeneous(_) | AnyRay::HomogeneousFlakes(_) => t,
        }
    }
    fn steps(&self) -> u64 {
        match self {
            AnyRay::Grid(ray) => ray.steps(),
            AnyRay::Homogeneous(ray) => ray.steps(),
            AnyRay::GridOfFlakes(ray) => ray.steps(),
            AnyRay::HomogeneousFlakes(ray) => ray.steps(),
        }
    }
}

impl ExactField for AnyRay<'_> {
    fn optical_depth(&self, tally: &mut Tally) -> f64 {
        match self {
            AnyRay::Grid(ray) => ray.optical_depth(tally),
            AnyRay::Homogeneous(ray) => ray.optical_depth(tally),
            AnyRay::GridOfFlakes(ray) => ray.optical_depth(tally),
            AnyRay::HomogeneousFlakes(ray) => ray.optical_depth(tally),
        }
    }
    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        match self {
            AnyRay::Grid(ray) => ray.t_at_depth(depth, tally),
            AnyRay::Homogeneous(ray) => ray.t_at_depth(depth, tally),
            AnyRay::GridOfFlakes(ray) => ray.t_at_depth(depth, tally),
            AnyRay::HomogeneousFlakes(ray) => ray.t_at_depth(depth, tally),
        }
    }
}

/// What of a medium a ray meets.
enum Met<'a> {
    Grid(&'a GridMedium, Span),
    /// With distance and length.
    Homogeneous(&'a HomogeneousMedium, f64, f32),
}

/// Where a ray meets a medium: what is known before it is walked.
pub(super) struct Entry<'a> {
    number: usize,
    medium: &'a Medium,
    met: Met<'a>,
    /// Microflakes, with the ray's direction.
    flakes: Option<(&'a Flakes, Vec3)>,
    /// Factor on the extinction: the rate of one of the exponentials that the transmittance function is a mixture of, 1 for an exponential one.
    rate: f32,
}

/// The transmittance function of a medium as seen from where a ray starts.
pub(super) fn passage(law: &Law, start: StartCorrelation, medium: usize) -> Passage<'_> {
    let correlated = start == Some(medium);
    Passage {
        law,
        start: if correlated { law::Start::Correlated } else { law::Start::Uncorrelated },
    }
}

impl<'a> Entry<'a> {
    /// Where `ray` meets medium number `number` before `t_max`; `None` if it does not.
    #[inline(always)]
    pub(super) fn new(
        number: usize,
        medium: &'a Medium,
        ray: &Ray,
        t_max: f64,
    ) -> Option<Entry<'a>> {
        let met = match medium {
            Medium::Grid(grid) => Met::Grid(grid, grid.span(ray.origin, ray.direction, t_max)?),
            Medium::Homogeneous(medium) => {
                let (t_enter, length) = medium.span(ray.origin, ray.direction, t_max)?;
                Met::Homogeneous(medium, t_enter, length)
            }
        };
        let flakes = medium.phase().flakes().map(|flakes| (flakes, ray.direction));
        Some(Entry { number, medium, met, flakes, rate: 1.0 })
    }

    /// Number of the medium.
    #[inline(always)]
    pub(super) fn medium(&self) -> usize {
        self.number
    }

    /// Extinction per channel relative to the strongest.
    #[inline(always)]
    pub(super) fn ratio(&self) -> Vec3 {
        self.medium.relative_extinction()
    }

    /// The part before `t_max` on the ray; `None` if it begins behind.
    pub(super) fn clipped(self, ray: &Ray, t_max: f64) -> Option<Entry<'a>> {
        let rate = self.rate;
        Some(Entry { rate, ..Entry::new(self.number, self.medium, ray, t_max)? })
    }

    /// Draws the rate of a medium whose transmittance function is a mixture of exponentials.
    #[inline]
    pub(super) fn draw_rate<R: Rng + Clone>(&mut self, passage: Passage<'_>, rng: &mut R) {
        self.rate = passage.rate(rng).unwrap_or(1.0);
    }

    /// Whether the medium has no exact depths.
    #[inline]
    pub(super) fn has_to_be_walked(&self) -> bool {
        self.flakes.is_some() && has_to_be_walked(self.medium)
    }

    /// Where the ray enters.
    #[inline(always)]
    pub(super) fn t(&self) -> f64 {
        match &self.met {
            Met::Grid(_, span) => span.t_enter,
            Met::Homogeneous(_, t, _) => *t,
        }
    }

    /// Where the ray leaves.
    #[inline]
    pub(super) fn t_exit(&self) -> f64 {
        match &self.met {
            Met::Grid(_, span) => span.t_exit(),
            Met::Homogeneous(_, t, length) => t + f64::from(*length),
        }
    }

    /// Where on the ray the parameter `t` of the field is.
    #[inline]
    pub(super) fn at(&self, t: f32) -> f64 {
        match &self.met {
            Met::Grid(grid, span) => grid.world_distance(span, t),
            Met::Homogeneous(_, t_enter, _) => t_enter + f64::from(t),
        }
    }

    /// The field of a share of the extinction.
    #[inline(never)]
    pub(super) fn field(&self, share: f32) -> Scaled<AnyRay<'a>> {
        let field = match (&self.met, self.flakes) {
            (Met::Grid(grid, span), None) => AnyRay::Grid(grid.any_ray(span)),
            (Met::Homogeneous(medium, _, length), None) => AnyRay::Homogeneous(medium.ray(*length)),
            (Met::Grid(grid, span), Some((flakes, direction))) => {
                let density = grid.any_ray(span);
                AnyRay::GridOfFlakes(grid.flake_ray(density, flakes, direction, span))
            }
            (Met::Homogeneous(medium, _, length), Some((flakes, direction))) => {
                let density = medium.ray(*length);
                // The flakes are the same everywhere: where the ray runs does not matter.
                let ray = FlakeRay::new(density, flakes, direction, [DVec3::ZERO; 2]);
                AnyRay::HomogeneousFlakes(ray)
            }
        };
        Scaled::new(field, share * self.rate)
    }

    /// Calls `kernel` with the field of a share of the extinction, compiled for the kinds that are common.
    #[inline(always)]
    pub(super) fn with_field<K: FieldKernel>(&self, share: f32, kernel: K) -> K::Output {
        match (&self.met, self.flakes) {
            (Met::Grid(grid, span), None) => grid.with_ray(span, share * self.rate, kernel),
            _ => kernel.run(self.field(share)),
        }
    }
}
