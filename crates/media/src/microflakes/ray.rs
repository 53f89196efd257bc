//! A ray through a medium of microflakes.

use super::Microflakes;
use crate::field::{ExactField, MajorantSegment, RayField};
use crate::tally::Tally;
use glam::{DVec3, Vec3};

/// The ray field of a medium's density, times what its microflakes show to the ray.
#[derive(Debug, Clone)]
pub(crate) struct MicroflakeRay<'a, F> {
    density: F,
    /// Bound of the factor along the ray.
    bound: f32,
    /// Of grids: the microflakes, the ray's direction in the world, and its way through the
    /// medium's index space.
    varying: Option<(&'a Microflakes, Vec3, [DVec3; 2])>,
}

impl<'a, F: RayField> MicroflakeRay<'a, F> {
    /// `index`: where the ray starts and its direction per world unit, in the medium's index space;
    /// needed for microflakes by grid alone.
    pub(crate) fn new(
        density: F,
        microflakes: &'a Microflakes,
        direction: Vec3,
        index: [DVec3; 2],
    ) -> Self {
        MicroflakeRay {
            density,
            bound: microflakes.largest_area(direction),
            varying: microflakes.by_grid().then_some((microflakes, direction, index)),
        }
    }

    #[inline]
    fn factor(&self, t: f32) -> f32 {
        match &self.varying {
            None => self.bound,
            Some((microflakes, direction, [p, d])) => {
                let t = self.density.distance(f64::from(t));
                microflakes.projected_area(|| *p + *d * t, *direction)
            }
        }
    }
}

impl<F: RayField> RayField for MicroflakeRay<'_, F> {
    #[inline]
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        let segment = self.density.next_segment()?;
        Some(MajorantSegment { majorant: segment.majorant * self.bound, ..segment })
    }

    fn minorant(&self) -> f32 {
        if self.varying.is_some() { 0.0 } else { self.density.minorant() * self.bound }
    }

    #[inline]
    fn sigma_t(&self, t: f32) -> f32 {
        self.density.sigma_t(t) * self.factor(t)
    }

    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        self.density.sigma_t_anywhere(t) * self.factor(t)
    }

    fn distance(&self, t: f64) -> f64 {
        self.density.distance(t)
    }

    fn steps(&self) -> u64 {
        self.density.steps()
    }
}

/// Exact where the microflakes are the same everywhere. Of microflakes by grid the largest factor
/// stands for all: plans refuse exact methods there.
impl<F: ExactField> ExactField for MicroflakeRay<'_, F> {
    fn optical_depth(&self, tally: &mut Tally) -> f64 {
        self.density.optical_depth(tally) * f64::from(self.bound)
    }

    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        let bound = f64::from(self.bound);
        if !(bound > 0.0) {
            return Err(0.0);
        }
        self.density.t_at_depth(depth / bound, tally).map_err(|all| all * bound)
    }
}
