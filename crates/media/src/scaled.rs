//! A field times a number: what a mixture of exponential transmittances makes of a ray.

use crate::field::{ExactField, MajorantSegment, RayField};
use crate::tally::Tally;

/// A field whose extinction and bounds are multiplied by one positive factor.
#[derive(Debug, Clone)]
pub struct Scaled<F> {
    field: F,
    factor: f32,
}

impl<F> Scaled<F> {
    /// `field` times `factor`, a positive number.
    #[inline]
    pub fn new(field: F, factor: f32) -> Scaled<F> {
        Scaled { field, factor }
    }
}

impl<F: RayField> RayField for Scaled<F> {
    #[inline]
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        let segment = self.field.next_segment()?;
        Some(MajorantSegment { majorant: segment.majorant * self.factor, ..segment })
    }

    fn minorant(&self) -> f32 {
        self.field.minorant() * self.factor
    }

    #[inline]
    fn sigma_t(&self, t: f32) -> f32 {
        self.field.sigma_t(t) * self.factor
    }

    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        self.field.sigma_t_anywhere(t) * self.factor
    }

    fn distance(&self, t: f64) -> f64 {
        self.field.distance(t)
    }

    fn steps(&self) -> u64 {
        self.field.steps()
    }
}

impl<F: ExactField> ExactField for Scaled<F> {
    fn optical_depth(&self, tally: &mut Tally) -> f64 {
        self.field.optical_depth(tally) * f64::from(self.factor)
    }

    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        let factor = f64::from(self.factor);
        self.field.t_at_depth(depth / factor, tally).map_err(|whole| whole * factor)
    }
}
