//! Intervals of a ray: consecutive majorant segments that an estimator treats as one interval.
//!
//! Transmittances of consecutive intervals multiply, and independent estimates of them as well.
//! Where the cuts lie must not depend on random numbers. A limit on the majorant depth of an
//! interval keeps power series within single precision.

use crate::channels::Channels;
use crate::field::{MajorantSegment, RayField};
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::happens;
use rand_core::Rng;
use smallvec::SmallVec;

/// A majorant segment within an interval.
#[derive(Debug, Clone, Copy)]
struct Piece {
    t0: f32,
    t1: f32,
    majorant: f32,
    /// Majorant depth of the interval before this piece.
    depth: f32,
    /// Length of the pieces of the interval before this one.
    length: f32,
}

/// Consecutive majorant segments; what is empty between them does not count.
#[derive(Debug, Clone, Default)]
pub(crate) struct RayInterval {
    pieces: SmallVec<[Piece; 32]>,
    /// Optical depth of the majorant.
    pub(crate) depth: f32,
    /// Optical depth of the minorant.
    pub(crate) minorant_depth: f32,
    /// Total length of the segments.
    pub(crate) length: f32,
}

/// A point of an interval.
#[derive(Debug, Clone, Copy)]
struct IntervalPoint {
    t: f32,
    majorant: f32,
}

impl RayInterval {
    fn clear(&mut self) {
        self.pieces.clear();
        (self.depth, self.minorant_depth, self.length) = (0.0, 0.0, 0.0);
    }

    fn push(&mut self, segment: MajorantSegment, minorant: f32) {
        let MajorantSegment { t0, t1, majorant } = segment;
        self.pieces.push(Piece { t0, t1, majorant, depth: self.depth, length: self.length });
        self.depth += (t1 - t0) * majorant;
        self.minorant_depth += (t1 - t0) * minorant;
        self.length += t1 - t0;
    }

    /// The point up to which the majorant depth is `depth`.
    #[inline(always)]
    fn at_depth(&self, depth: f32) -> IntervalPoint {
        let index = self.pieces.partition_point(|piece| piece.depth <= depth).max(1) - 1;
        let piece = &self.pieces[index];
        let t = (piece.t0 + (depth - piece.depth) / piece.majorant).min(piece.t1);
        IntervalPoint { t, majorant: piece.majorant }
    }

    /// Extinction over majorant, per channel, at the point up to which the majorant depth is
    /// `depth`: one lookup.
    #[inline(always)]
    pub(crate) fn real_ratio<F: RayField, C: Channels>(
        &self,
        field: &F,
        depth: f32,
        channels: C,
        tally: &mut Tally,
    ) -> C::Value {
        let point = self.at_depth(depth);
        let sigma_t = tally.looked_up(field.sigma_t_anywhere(point.t), point.majorant);
        channels.of(sigma_t / point.majorant)
    }

    /// The point up to which the length of the segments is `length`.
    #[inline(always)]
    pub(crate) fn at_length(&self, length: f32) -> f32 {
        let index = self.pieces.partition_point(|piece| piece.length <= length).max(1) - 1;
        let piece = &self.pieces[index];
        (piece.t0 + (length - piece.length)).min(piece.t1)
    }

    /// First and last point.
    pub(crate) fn ends(&self) -> (f32, f32) {
        match (self.pieces.first(), self.pieces.last()) {
            (Some(first), Some(last)) => (first.t0, last.t1),
            _ => (0.0, 0.0),
        }
    }
}

impl RayInterval {
    /// All segments of a field, which is walked to its end.
    pub(crate) fn whole<F: RayField>(field: F) -> (RayInterval, F) {
        let mut intervals = RayIntervals { field, limit: f32::INFINITY, pending: None };
        let mut interval = RayInterval::default();
        intervals.next(&mut interval);
        (interval, intervals.field)
    }
}

/// Cuts a ray into intervals whose majorant depth is at most a limit.
struct RayIntervals<F> {
    field: F,
    limit: f32,
    /// A segment, with its minorant, that did not fit into the interval before.
    pending: Option<(MajorantSegment, f32)>,
}

impl<F: RayField> RayIntervals<F> {
    fn segment(&mut self) -> Option<(MajorantSegment, f32)> {
        self.pending.take().or_else(|| {
            let segment = self.field.next_segment()?;
            Some((segment, self.field.minorant()))
        })
    }

    /// Fills `interval` with the next one; false at the ray's end.
    fn next(&mut self, interval: &mut RayInterval) -> bool {
        interval.clear();
        while let Some((segment, minorant)) = self.segment() {
            let MajorantSegment { t0, t1, majorant } = segment;
            let depth = (t1 - t0) * majorant;
            if !(depth > 0.0) {
                continue;
            }
            if depth <= self.limit - interval.depth {
                interval.push(segment, minorant);
                continue;
            }
            if interval.depth > 0.0 {
                self.pending = Some((segment, minorant));
                return true;
            }
            // Deeper than a whole interval: equal parts. Infinite segments and those that rounding
            // cannot part stay whole.
            let cut = t0 + (t1 - t0) / (depth / self.limit).ceil();
            if cut > t0 && cut < t1 {
                interval.push(MajorantSegment { t1: cut, ..segment }, minorant);
                self.pending = Some((MajorantSegment { t0: cut, ..segment }, minorant));
            } else {
                interval.push(segment, minorant);
            }
            return true;
        }
        interval.depth > 0.0
    }
}

/// The product of `factor` over the intervals of `field`, each of a majorant depth of at most
/// `limit`; products below `threshold` are played roulette. Unbiased if the factors are.
#[inline(always)]
pub(crate) fn product_over_intervals<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
    limit: f32,
    threshold: f32,
    rng: &mut R,
    tally: &mut Tally,
    mut factor: impl FnMut(&F, &RayInterval, &mut R, &mut Tally) -> C::Value,
) -> C::Value {
    let mut intervals = RayIntervals { field, limit, pending: None };
    let mut interval = RayInterval::default();
    let mut product = C::Value::ONE;
    while intervals.next(&mut interval) {
        let next = if interval.depth < f32::INFINITY {
            factor(&intervals.field, &interval, rng, tally)
        } else {
            // Constant extinction without end, by the contract of fields: only channels without
            // extinction get through.
            channels.of(f32::INFINITY).map(|depth| if depth > 0.0 { 0.0 } else { 1.0 })
        };
        // Sums whose terms overflow in both directions: infinite, so that they are dropped and
        // counted as estimates without a value.
        let next = next.map(|x| if x.is_nan() { f32::INFINITY } else { x });
        product = product.times(next);
        let size = product.max_abs();
        if size == 0.0 {
            break;
        }
        if size < threshold {
            let survival = size / threshold;
            if !happens(survival, rng) {
                product = C::Value::ZERO;
                break;
            }
            product *= 1.0 / survival;
        }
    }
    tally.majorant_steps += intervals.field.steps();
    product
}
