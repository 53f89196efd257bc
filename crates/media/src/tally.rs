//! What trackers count while they run.

/// Events of free flights and transmittance walks; plain sums, merged in any order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// Evaluations of the extinction field.
    pub lookups: u64,
    /// Majorant cells visited.
    pub majorant_steps: u64,
    /// Real collisions of free flights.
    pub collisions: u64,
    /// Null collisions of free flights.
    pub null_collisions: u64,
    /// Lookups that exceeded their majorant: zero unless a bound is wrong.
    pub violations: u64,
}

impl Tally {
    /// Counts a lookup that found `sigma_t` where `bound` is the field's majorant, and a violation
    /// if it exceeds that; hands the extinction through.
    #[inline(always)]
    pub fn looked_up(&mut self, sigma_t: f32, bound: f32) -> f32 {
        self.lookups += 1;
        self.violations += u64::from(sigma_t > bound);
        sigma_t
    }

    /// Adds the counts of `other`.
    pub fn merge(&mut self, other: &Tally) {
        self.lookups += other.lookups;
        self.majorant_steps += other.majorant_steps;
        self.collisions += other.collisions;
        self.null_collisions += other.null_collisions;
        self.violations += other.violations;
    }
}
