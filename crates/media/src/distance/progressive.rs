//! Progressive bounds [Misso et al. 2023]: guessed majorants that learn from what exceeds them.
//!
//! For fields whose bounds are not known. The medium is clamped to the bounds (biased, without the
//! noise of negative weights); what exceeded them is remembered and raises them for later samples.
//! The mean over samples is consistent: its bias falls as one over their number once every excess
//! has been seen. Samples depend on those before them, so that a render by this scheme could not be
//! split over machines: Pileus offers it to experiments, and bounds its grids by proof.

use crate::field::{MajorantSegment, RayField};
use std::cell::Cell;

/// Bounds on equal cells of `[0, length]`.
#[derive(Debug, Clone)]
pub struct ProgressiveBounds {
    length: f32,
    bounds: Vec<f32>,
    seen: Vec<Cell<f32>>,
}

impl ProgressiveBounds {
    /// Bounds on `cells` (at least one) equal cells, each of `guess`, 1/length, at first.
    pub fn new(length: f32, cells: usize, guess: f32) -> ProgressiveBounds {
        let cells = cells.max(1);
        ProgressiveBounds { length, bounds: vec![guess; cells], seen: vec![Cell::new(0.0); cells] }
    }

    /// Bounds per cell, 1/length.
    pub fn bounds(&self) -> &[f32] {
        &self.bounds
    }

    /// The field of extinction `sigma_t` under these bounds, clamped to them; sees and remembers
    /// what exceeds them.
    pub fn ray<S: Fn(f32) -> f32>(&self, sigma_t: S) -> impl RayField {
        ProgressiveRay { bounds: self, sigma_t, next: 0 }
    }

    /// Raises the bounds to what was seen since, times `slack` (at least 1); returns how many cells
    /// were raised.
    pub fn raise(&mut self, slack: f32) -> usize {
        let mut raised = 0;
        for (bound, seen) in self.bounds.iter_mut().zip(&self.seen) {
            let seen = seen.take();
            if seen > *bound {
                *bound = seen * slack;
                raised += 1;
            }
        }
        raised
    }

    fn cell_of(&self, t: f32) -> usize {
        let cell = t / self.length * self.bounds.len() as f32;
        (cell as usize).min(self.bounds.len() - 1)
    }
}

/// A field clamped to progressive bounds.
#[derive(Debug, Clone)]
struct ProgressiveRay<'a, S> {
    bounds: &'a ProgressiveBounds,
    sigma_t: S,
    next: usize,
}

impl<S: Fn(f32) -> f32> RayField for ProgressiveRay<'_, S> {
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        let ProgressiveBounds { length, bounds, .. } = self.bounds;
        let majorant = *bounds.get(self.next)?;
        let edge = |i: usize| length * (i as f32 / bounds.len() as f32);
        let segment = MajorantSegment { t0: edge(self.next), t1: edge(self.next + 1), majorant };
        self.next += 1;
        Some(segment)
    }

    fn minorant(&self) -> f32 {
        0.0
    }

    fn sigma_t(&self, t: f32) -> f32 {
        let sigma_t = (self.sigma_t)(t);
        // The cell of the walk: rounding at its faces must not send the value to a neighbour.
        let cell = self.next.saturating_sub(1);
        self.clamped(cell, sigma_t)
    }

    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        self.clamped(self.bounds.cell_of(t), (self.sigma_t)(t))
    }

    fn steps(&self) -> u64 {
        self.next as u64
    }
}

impl<S> ProgressiveRay<'_, S> {
    fn clamped(&self, cell: usize, sigma_t: f32) -> f32 {
        let (bound, seen) = (self.bounds.bounds[cell], &self.bounds.seen[cell]);
        if sigma_t > bound {
            seen.set(seen.get().max(sigma_t));
        }
        sigma_t.min(bound)
    }
}
