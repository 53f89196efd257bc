//! Rays of any kind behind one type, for code that is not compiled for each.

use super::HomogeneousRay;
use crate::field::{ExactField, MajorantSegment, RayField};
use crate::grid::Half;
use crate::majorant::{AnyPartition, GridRay, WideRay};
use crate::microflakes::MicroflakeRay;
use crate::tally::Tally;
use glam::DVec3;

/// A ray through a grid of either voxel type, any width and any majorant structure.
#[derive(Debug, Clone)]
pub(crate) enum AnyGridRay<'a> {
    /// Voxels stored as binary16.
    Half(GridRay<'a, Half>),
    /// Voxels stored as binary32.
    Single(GridRay<'a, f32>),
    /// Voxels stored as binary16, on another structure than the default one.
    HalfOther(GridRay<'a, Half, AnyPartition<'a>>),
    /// Voxels stored as binary32, on another structure than the default one.
    SingleOther(GridRay<'a, f32, AnyPartition<'a>>),
    /// Through a grid that is too wide for single precision.
    Wide(Box<WideRay<'a>>),
}

/// A ray through any medium, for code that is not compiled for each kind of field:
/// [`Medium::any_ray`](crate::Medium::any_ray) makes it.
#[derive(Debug, Clone)]
pub struct AnyRay<'a>(pub(super) RayKind<'a>);

/// A ray by what it goes through.
#[derive(Debug, Clone)]
pub(super) enum RayKind<'a> {
    /// Through a grid.
    Grid(AnyGridRay<'a>),
    /// Of constant extinction.
    Box(HomogeneousRay),
    /// Through a grid of microflakes.
    GridOfMicroflakes(MicroflakeRay<'a, AnyGridRay<'a>>),
    /// Through microflakes of constant density.
    BoxOfMicroflakes(MicroflakeRay<'a, HomogeneousRay>),
}

impl AnyGridRay<'_> {
    /// The local point at ray parameter `t` of the segment handed out last, inside its cell
    /// whatever rounding says.
    #[inline]
    pub(crate) fn local_in_cell(&self, t: f32) -> DVec3 {
        match self {
            AnyGridRay::Half(ray) => ray.local_in_cell(t).as_dvec3(),
            AnyGridRay::Single(ray) => ray.local_in_cell(t).as_dvec3(),
            AnyGridRay::HalfOther(ray) => ray.local_in_cell(t).as_dvec3(),
            AnyGridRay::SingleOther(ray) => ray.local_in_cell(t).as_dvec3(),
            AnyGridRay::Wide(ray) => ray.local_in_cell(t),
        }
    }
}

/// Implements both traits of fields by those of the variants.
macro_rules! field_of_variants {
    ($any:ident: $($variant:ident),+) => {
        impl RayField for $any<'_> {
            #[inline]
            fn next_segment(&mut self) -> Option<MajorantSegment> {
                match self { $($any::$variant(ray) => ray.next_segment(),)+ }
            }

            fn minorant(&self) -> f32 {
                match self { $($any::$variant(ray) => ray.minorant(),)+ }
            }

            #[inline]
            fn sigma_t(&self, t: f32) -> f32 {
                match self { $($any::$variant(ray) => ray.sigma_t(t),)+ }
            }

            fn sigma_t_anywhere(&self, t: f32) -> f32 {
                match self { $($any::$variant(ray) => ray.sigma_t_anywhere(t),)+ }
            }

            fn distance(&self, t: f64) -> f64 {
                match self { $($any::$variant(ray) => ray.distance(t),)+ }
            }

            fn steps(&self) -> u64 {
                match self { $($any::$variant(ray) => ray.steps(),)+ }
            }
        }

        impl ExactField for $any<'_> {
            fn optical_depth(&self, tally: &mut Tally) -> f64 {
                match self { $($any::$variant(ray) => ray.optical_depth(tally),)+ }
            }

            fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
                match self { $($any::$variant(ray) => ray.t_at_depth(depth, tally),)+ }
            }
        }
    };
}

field_of_variants!(AnyGridRay: Half, Single, HalfOther, SingleOther, Wide);
field_of_variants!(RayKind: Grid, Box, GridOfMicroflakes, BoxOfMicroflakes);

impl RayField for AnyRay<'_> {
    #[inline]
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        self.0.next_segment()
    }

    #[inline]
    fn minorant(&self) -> f32 {
        self.0.minorant()
    }

    #[inline]
    fn sigma_t(&self, t: f32) -> f32 {
        self.0.sigma_t(t)
    }

    #[inline]
    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        self.0.sigma_t_anywhere(t)
    }

    #[inline]
    fn distance(&self, t: f64) -> f64 {
        self.0.distance(t)
    }

    #[inline]
    fn steps(&self) -> u64 {
        self.0.steps()
    }
}

impl ExactField for AnyRay<'_> {
    #[inline]
    fn optical_depth(&self, tally: &mut Tally) -> f64 {
        self.0.optical_depth(tally)
    }

    #[inline]
    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        self.0.t_at_depth(depth, tally)
    }
}
