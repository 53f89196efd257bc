//! Extinction from a grid.

use super::{AnyGridRay, PlacedGrid, Span};
use crate::Error;
use crate::field::ExactField;
use crate::grid::{Voxel, VoxelGrid, Voxels};
use crate::majorant::{Adaptive, MajorantStructure, Majorants};
use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;
use std::sync::Arc;

/// Extinction from a grid placed in the world, with the bounds that rays walk through. Cheap to
/// copy for instances: voxels and bounds are shared.
#[derive(Debug, Clone)]
pub struct GridShape {
    placed: PlacedGrid,
    /// Raw value to extinction of the strongest channel, 1/length.
    sigma_t_scale: f32,
    /// Raw bound to majorant, 1/length.
    majorant_scale: f32,
    majorants: Arc<Majorants>,
}

impl GridShape {
    /// Places `grid`, with the extinction `sigma_t_scale * value`.
    ///
    /// # Errors
    /// If the transform is singular or not finite, if the extinction is out of range, or if the
    /// background is not zero.
    pub(crate) fn new(
        grid: Arc<VoxelGrid>,
        index_to_world: DAffine3,
        sigma_t_scale: f32,
    ) -> Result<GridShape, Error> {
        if grid.background() != 0.0 {
            return Err(Error::unsupported(
                format!(
                    "the grid's background is {}, so that it fills all space",
                    grid.background()
                ),
                "set the background to 0 and add a homogeneous volume for what lies around",
            ));
        }
        // Flights divide by the majorant and multiply it with cell sizes: keep both far from
        // overflow.
        if !(f64::from(sigma_t_scale) * f64::from(grid.range().1) < 1e30) {
            let largest = grid.range().1;
            return Err(Error::invalid(
                format!("the largest extinction, {sigma_t_scale} x {largest}, is out of range"),
                "lower the density scale, or clean the grid",
            ));
        }
        Ok(GridShape {
            placed: PlacedGrid::new(grid, index_to_world)?,
            sigma_t_scale,
            majorant_scale: sigma_t_scale,
            majorants: Arc::new(Majorants::ADAPTIVE),
        })
    }

    pub(super) fn with_majorants(
        &self,
        structure: MajorantStructure,
        factor: f32,
    ) -> Result<GridShape, Error> {
        let majorant_scale = self.sigma_t_scale * factor;
        let grid = self.voxels();
        let largest = f64::from(majorant_scale) * f64::from(grid.range().1);
        if !(factor > 0.0 && largest < 1e30) {
            return Err(Error::invalid(
                format!("majorants scaled by {factor}"),
                "give a positive number that keeps them in range",
            ));
        }
        let per_voxel = majorant_scale * self.placed.voxel_length();
        let majorants = Arc::new(Majorants::new(grid, structure, per_voxel)?);
        Ok(GridShape { majorant_scale, majorants, ..self.clone() })
    }

    /// The voxels, in the units of the file: extinction over
    /// [`sigma_t_scale`](Self::sigma_t_scale).
    #[inline(always)]
    pub fn voxels(&self) -> &Arc<VoxelGrid> {
        self.placed.grid()
    }

    /// The voxels in the precision that they are stored in.
    #[inline(always)]
    pub(super) fn stored(&self) -> &Voxels {
        &self.voxels().voxels
    }

    pub(crate) fn placed(&self) -> &PlacedGrid {
        &self.placed
    }

    /// The map from the grid's index space to the world.
    pub fn index_to_world(&self) -> DAffine3 {
        self.placed.index_to_world()
    }

    #[inline(always)]
    pub(super) fn to_index(&self, p_world: DVec3) -> DVec3 {
        self.placed.to_index(p_world)
    }

    pub(super) fn local_to_index(&self) -> DVec3 {
        self.voxels().local_to_index()
    }

    /// Factor from a voxel's value to the extinction of the strongest channel, 1/length.
    #[inline(always)]
    pub fn sigma_t_scale(&self) -> f32 {
        self.sigma_t_scale
    }

    /// Upper bound of the extinction of the strongest channel, 1/length.
    pub fn largest_sigma_t(&self) -> f64 {
        f64::from(self.sigma_t_scale) * f64::from(self.voxels().range().1)
    }

    /// Extinction of the strongest channel at a point in the world, 1/length.
    #[inline]
    pub fn sigma_t_at(&self, p_world: DVec3) -> f64 {
        self.voxels().interpolate(self.to_index(p_world)) * f64::from(self.sigma_t_scale)
    }

    /// The majorant structure.
    pub fn majorants(&self) -> &Majorants {
        &self.majorants
    }

    /// Optical depth of the largest majorant along the longest edge of a voxel: what methods of
    /// tentative collisions may have to look up in one.
    pub fn majorant_depth_per_voxel(&self) -> f64 {
        let m = self.placed.local_to_world().matrix3;
        let longest = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
        f64::from(self.majorant_scale) * f64::from(self.voxels().range().1) * longest
    }

    /// The box in the world that holds all extinction; `None` if there is none.
    pub fn bounds_world(&self) -> Option<Bounds3> {
        self.placed.bounds_world()
    }

    /// The part of the ray `origin + t direction`, t in [0, t_max], that may meet extinction;
    /// `direction` is a unit vector.
    #[inline(always)]
    pub fn span(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<Span> {
        self.placed.span(origin, direction, t_max)
    }

    /// Whether the grid is so wide that its rays are walked in parts: more than 2^13 voxels along
    /// an axis, which single precision cannot count from one corner. [`ray`](GridShape::ray) is not
    /// for them.
    #[inline(always)]
    pub fn is_wide(&self) -> bool {
        self.placed.is_wide()
    }

    /// World distance from the ray's origin at parameter `t` of a field of this span.
    #[inline]
    pub(super) fn world_distance(&self, span: &Span, t: f32) -> f64 {
        self.placed.world_distance(span, t)
    }

    /// The extinction of the strongest channel along a span, times `factor`, which is positive and
    /// may exceed one, for a grid stored as `V`: compiled for it and for the majorant structure
    /// that every grid has, for kernels that know their grid. Majorants are on cells that suit the
    /// factor. For the grids of [`Medium::default_grid`](crate::Medium::default_grid) alone.
    #[inline(always)]
    pub fn ray<'a, V: Voxel>(
        &'a self,
        voxels: &'a [V],
        span: &Span,
        factor: f32,
    ) -> impl ExactField + use<'a, V> {
        let partition = Adaptive::new(self.voxels(), self.per_voxel(span, factor));
        self.placed.ray(voxels, partition, self.scales(factor), span)
    }

    /// The extinction along a span, times `factor`, whatever the voxel type and the structure.
    #[inline(always)]
    pub(super) fn any_ray(&self, span: &Span, factor: f32) -> AnyGridRay<'_> {
        let partition = self.majorants.partition(self.voxels(), self.per_voxel(span, factor));
        self.placed.any_ray(partition, self.scales(factor), span)
    }

    /// Raw value to extinction and raw bound to majorant.
    #[inline(always)]
    fn scales(&self, factor: f32) -> [f32; 2] {
        [factor * self.sigma_t_scale, factor * self.majorant_scale]
    }

    /// Raw bound to majorant per voxel along a span.
    #[inline(always)]
    fn per_voxel(&self, span: &Span, factor: f32) -> f32 {
        factor * self.majorant_scale / span.line.d.as_vec3().length()
    }

    /// Calls `kernel` with the voxels in their type: the one place where precision is chosen.
    #[inline(always)]
    pub fn with_voxels<K: VoxelKernel>(&self, kernel: K) -> K::Output {
        match self.stored() {
            Voxels::Half(voxels) => kernel.run(voxels),
            Voxels::Single(voxels) => kernel.run(voxels),
        }
    }
}

/// Code that is compiled for each voxel type.
pub trait VoxelKernel {
    /// What it returns.
    type Output;
    /// Runs on voxels of type `V`.
    fn run<V: Voxel>(self, voxels: &[V]) -> Self::Output;
}
