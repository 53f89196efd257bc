//! Where a ray meets a medium of a list, and the field that it walks there.

use super::walks::has_to_be_walked;
use super::{Ray, StartCorrelation};
use glam::Vec3;
use pileus_media::transmittance_function::{self, Passage, TransmittanceFunction};
use pileus_media::{AnyRay, FieldKernel, Medium, Span};
use rand_core::Rng;

/// Where a ray meets a medium: what is known before it is walked.
pub(super) struct Entry<'a> {
    number: usize,
    medium: &'a Medium,
    span: Span,
    /// Factor on the extinction: the rate of one of the exponentials that the transmittance
    /// function is a mixture of, 1 for an exponential one.
    rate: f32,
}

/// The transmittance function of a medium as seen from where a ray starts.
pub(super) fn passage(
    function: &TransmittanceFunction,
    start: StartCorrelation,
    medium: usize,
) -> Passage<'_> {
    let correlated = start == Some(medium);
    Passage {
        function,
        start: if correlated {
            transmittance_function::StartCorrelation::Correlated
        } else {
            transmittance_function::StartCorrelation::Uncorrelated
        },
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
        let span = medium.span(ray.origin, ray.direction, t_max)?;
        Some(Entry { number, medium, span, rate: 1.0 })
    }

    /// Number of the medium.
    #[inline(always)]
    pub(super) fn medium(&self) -> usize {
        self.number
    }

    /// Extinction per channel relative to the strongest.
    #[inline(always)]
    pub(super) fn ratio(&self) -> Vec3 {
        self.medium.chromatic_ratio()
    }

    /// The part before `t_max` on the ray; `None` if it begins behind.
    #[inline]
    pub(super) fn before(self, t_max: f64) -> Option<Entry<'a>> {
        Some(Entry { span: self.span.before(t_max)?, ..self })
    }

    /// Draws the rate of a medium whose transmittance function is a mixture of exponentials.
    #[inline]
    pub(super) fn draw_rate<R: Rng + Clone>(&mut self, passage: Passage<'_>, rng: &mut R) {
        self.rate = passage.rate(rng).unwrap_or(1.0);
    }

    /// Whether the medium has no exact depths.
    #[inline]
    pub(super) fn has_to_be_walked(&self) -> bool {
        has_to_be_walked(self.medium)
    }

    /// Where the ray enters.
    #[inline(always)]
    pub(super) fn t(&self) -> f64 {
        self.span.t_enter
    }

    /// Where the ray leaves.
    #[inline(always)]
    pub(super) fn t_exit(&self) -> f64 {
        self.span.t_exit()
    }

    /// Where on the ray the parameter `t` of the field is.
    #[inline]
    pub(super) fn at(&self, t: f32) -> f64 {
        self.medium.world_distance(&self.span, t)
    }

    /// The field of a share of the extinction.
    #[inline]
    pub(super) fn field(&self, share: f32) -> AnyRay<'a> {
        self.medium.any_ray(&self.span, share * self.rate)
    }

    /// Calls `kernel` with the field of a share of the extinction, compiled for the kinds that are
    /// common.
    #[inline(always)]
    pub(super) fn with_field<K: FieldKernel>(&self, share: f32, kernel: K) -> K::Output {
        self.medium.with_ray(&self.span, share * self.rate, kernel)
    }
}
