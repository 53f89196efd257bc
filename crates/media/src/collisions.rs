//! Tentative collisions: the Poisson process of a field's majorants, from which every
//! null-collision method is made.

use crate::field::{MajorantSegment, RayField};
use crate::tally::Tally;
use pileus_math::random::exponential;
use rand_core::Rng;

/// Walks along a ray from one tentative collision to the next.
///
/// Tentative collisions are a Poisson process whose rate is the majorant: exact for any field. One
/// exponential variate is spent per collision; what is left of it carries over from cell to cell.
#[derive(Debug, Clone)]
pub struct TentativeCollisions<F> {
    field: F,
    segment: MajorantSegment,
    t: f32,
    /// Majorant optical depth to the next collision, if it has been drawn.
    remaining: Option<f32>,
}

/// A tentative collision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tentative {
    /// Where, in the ray's parameter.
    pub t: f32,
    /// Majorant there, 1/length.
    pub majorant: f32,
}

impl<F: RayField> TentativeCollisions<F> {
    /// Starts at the beginning of `field`.
    #[inline(always)]
    pub fn new(field: F) -> Self {
        TentativeCollisions { field, segment: MajorantSegment::START, t: 0.0, remaining: None }
    }

    /// Starts with a given majorant optical depth to the first collision (an exponential variate of
    /// mean one).
    #[inline(always)]
    pub fn with_first(field: F, depth: f32) -> Self {
        TentativeCollisions {
            field,
            segment: MajorantSegment::START,
            t: 0.0,
            remaining: Some(depth),
        }
    }

    /// The next tentative collision, `None` when the ray has left the field.
    #[inline(always)]
    pub fn next<R: Rng + ?Sized>(&mut self, rng: &mut R) -> Option<Tentative> {
        let mut depth = match self.remaining.take() {
            Some(depth) => depth,
            None => exponential(rng),
        };
        loop {
            let available = (self.segment.t1 - self.t) * self.segment.majorant;
            if depth < available {
                self.t = (self.t + depth / self.segment.majorant).min(self.segment.t1);
                return Some(Tentative { t: self.t, majorant: self.segment.majorant });
            }
            depth -= available;
            self.segment = self.field.next_segment()?;
            self.t = self.segment.t0;
        }
    }

    /// The next tentative collision with the majorant depth passed since the last one, or the depth
    /// from there to the ray's end.
    ///
    /// # Errors
    /// That depth, when the ray has left the field.
    #[inline(always)]
    pub(crate) fn next_with_depth<R: Rng + ?Sized>(
        &mut self,
        rng: &mut R,
    ) -> Result<(Tentative, f32), f32> {
        let drawn = self.remaining.take().unwrap_or_else(|| exponential(rng));
        let mut depth = drawn;
        loop {
            let available = (self.segment.t1 - self.t) * self.segment.majorant;
            if depth < available {
                self.t = (self.t + depth / self.segment.majorant).min(self.segment.t1);
                return Ok((Tentative { t: self.t, majorant: self.segment.majorant }, drawn));
            }
            depth -= available;
            let Some(segment) = self.field.next_segment() else {
                return Err(drawn - depth);
            };
            self.segment = segment;
            self.t = self.segment.t0;
        }
    }

    /// The next collision of a process with a share of the majorants' rate. `inverse`: one over
    /// that share, which may change from one collision to the next, since what is left of a variate
    /// was drawn for nothing but the way up to the last one.
    #[inline(always)]
    pub fn next_of_share<R: Rng + ?Sized>(
        &mut self,
        inverse: f32,
        rng: &mut R,
    ) -> Option<Tentative> {
        let drawn = self.remaining.take().unwrap_or_else(|| exponential(rng));
        self.remaining = Some(drawn * inverse);
        self.next(rng)
    }

    /// Majorant depth from here to the ray's end, which the walk takes.
    pub(crate) fn depth_to_end(&mut self) -> f32 {
        let mut depth = (self.segment.t1 - self.t) * self.segment.majorant;
        while let Some(segment) = self.field.next_segment() {
            depth += (segment.t1 - segment.t0) * segment.majorant;
        }
        (self.segment, self.t) = (MajorantSegment::START, 0.0);
        depth
    }

    /// Looks up the extinction at the collision returned last, 1/length, and counts it.
    #[inline(always)]
    pub fn sigma_t(&self, collision: Tentative, tally: &mut Tally) -> f32 {
        tally.looked_up(self.field.sigma_t(collision.t), collision.majorant)
    }

    /// Whether the segment of the last collision never ends. By the contract of fields its
    /// extinction is constant: a walk that ignores it would not come to an end.
    #[inline(always)]
    pub fn is_endless(&self) -> bool {
        self.segment.t1 == f32::INFINITY
    }

    /// The field that the walk goes through.
    #[inline(always)]
    pub fn field(&self) -> &F {
        &self.field
    }
}
