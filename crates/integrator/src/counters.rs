//! What a render counted.

use pileus_media::Tally;

/// Sums over a render; merged in any order, and part of every image's metadata.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counters {
    /// Camera paths.
    pub paths: u64,
    /// Scattering events on them.
    pub bounces: u64,
    /// Paths that were cut by `max_bounces`: what they would have brought is missing.
    pub cut_by_max_bounces: u64,
    /// Paths that were cut by `max_events`: what they would have brought is missing.
    pub cut_by_max_events: u64,
    /// Shadow rays walked.
    pub shadow_rays: u64,
    /// Evaluations of the extinction field.
    pub lookups: u64,
    /// Majorant cells visited.
    pub majorant_steps: u64,
    /// Real collisions.
    pub collisions: u64,
    /// Null collisions.
    pub null_collisions: u64,
    /// Lookups above their majorant: zero unless a bound is wrong.
    pub violations: u64,
    /// Samples that `clamp` scaled down.
    pub clamped: u64,
    /// Samples that were not finite and are missing from their pixel's mean.
    pub dropped: u64,
}

impl Counters {
    /// Adds the counts of `other`.
    pub fn merge(&mut self, other: &Counters) {
        self.paths += other.paths;
        self.bounces += other.bounces;
        self.cut_by_max_bounces += other.cut_by_max_bounces;
        self.cut_by_max_events += other.cut_by_max_events;
        self.shadow_rays += other.shadow_rays;
        self.lookups += other.lookups;
        self.majorant_steps += other.majorant_steps;
        self.collisions += other.collisions;
        self.null_collisions += other.null_collisions;
        self.violations += other.violations;
        self.clamped += other.clamped;
        self.dropped += other.dropped;
    }

    /// Adds what trackers counted.
    pub(crate) fn add_tally(&mut self, tally: &Tally) {
        self.lookups += tally.lookups;
        self.majorant_steps += tally.majorant_steps;
        self.collisions += tally.collisions;
        self.null_collisions += tally.null_collisions;
        self.violations += tally.violations;
    }
}
