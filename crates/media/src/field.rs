//! The extinction along one ray, as every tracker and estimator sees it.

use crate::tally::Tally;

/// An interval of a ray on which the extinction is bounded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MajorantSegment {
    /// Start, in the ray's parameter.
    pub t0: f32,
    /// End, not before `t0`.
    pub t1: f32,
    /// Upper bound of the extinction on it, 1/length, positive.
    pub majorant: f32,
}

impl MajorantSegment {
    /// A segment of no length at the start of a ray.
    pub const START: MajorantSegment = MajorantSegment { t0: 0.0, t1: 0.0, majorant: 0.0 };
}

/// Extinction along a ray: majorant segments in order, and values inside the segment handed out
/// last.
///
/// The segments follow each other without overlap; what lies between them has no extinction. A
/// segment of infinite length must have constant extinction. The bounds are a function of the
/// position alone, so that two walks over the same points see the same majorants: the path
/// densities of multiple importance sampling rely on it. A 1D test profile implements this trait as
/// well as a grid does.
pub trait RayField {
    /// The next segment along the ray that may hold extinction, `None` at the ray's end.
    fn next_segment(&mut self) -> Option<MajorantSegment>;

    /// Lower bound of the extinction on the segment handed out last, 1/length, not negative, not
    /// above its majorant.
    fn minorant(&self) -> f32;

    /// Extinction at ray parameter `t`, 1/length, for `t` within the segment handed out last.
    fn sigma_t(&self, t: f32) -> f32;

    /// Extinction at any ray parameter within the segments handed out so far, 1/length. Slower than
    /// [`sigma_t`](RayField::sigma_t).
    fn sigma_t_anywhere(&self, t: f32) -> f32;

    /// Distance from the ray's start, in units of its parameter, at parameter `t` within the
    /// segments handed out so far. The parameter itself, but for fields that do not count what lies
    /// between their segments.
    #[inline(always)]
    fn distance(&self, t: f64) -> f64 {
        t
    }

    /// Cells visited so far, with those that were skipped as empty.
    fn steps(&self) -> u64;
}

/// A field whose optical depth is known without randomness. To be asked before the first segment is
/// taken.
pub trait ExactField: RayField {
    /// Optical depth of the whole ray.
    fn optical_depth(&self, tally: &mut Tally) -> f64;

    /// The ray parameter up to which the optical depth is `depth`, exact but for rounding.
    ///
    /// # Errors
    /// The optical depth of the whole ray, if it is below `depth`.
    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64>;
}
