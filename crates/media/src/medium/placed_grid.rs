//! A grid placed in the world: transforms, clipping of rays, and rays through its bounds.

use super::{AnyGridRay, Span};
use crate::Error;
use crate::grid::{Voxel, VoxelGrid, Voxels};
use crate::majorant::{AnyPartition, GridRay, Line, Lowest, Partition, WideRay, distance};
use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;
use std::sync::Arc;

/// A grid with its place in the world.
#[derive(Debug, Clone)]
pub(crate) struct PlacedGrid {
    grid: Arc<VoxelGrid>,
    /// Whether rays are walked in parts.
    wide: bool,
    world_to_local: DAffine3,
    local_to_world: DAffine3,
}

impl PlacedGrid {
    /// # Errors
    /// If the transform is singular or not finite.
    pub(crate) fn new(grid: Arc<VoxelGrid>, index_to_world: DAffine3) -> Result<PlacedGrid, Error> {
        let determinant = index_to_world.matrix3.determinant();
        let finite = index_to_world.is_finite() && determinant.is_normal();
        let local_to_world = index_to_world * DAffine3::from_translation(grid.local_to_index());
        let world_to_local = local_to_world.inverse();
        if !finite || !world_to_local.is_finite() {
            return Err(Error::invalid(
                "the volume's transform is singular or not finite",
                "check the scale of the grid, the node and the job",
            ));
        }
        Ok(PlacedGrid { wide: grid.is_wide(), grid, world_to_local, local_to_world })
    }

    #[inline(always)]
    pub(crate) fn grid(&self) -> &Arc<VoxelGrid> {
        &self.grid
    }

    #[inline(always)]
    pub(crate) fn is_wide(&self) -> bool {
        self.wide
    }

    pub(crate) fn local_to_world(&self) -> &DAffine3 {
        &self.local_to_world
    }

    pub(crate) fn index_to_world(&self) -> DAffine3 {
        self.local_to_world * DAffine3::from_translation(-self.grid.local_to_index())
    }

    /// Edge of a voxel in the world; the geometric mean where edges differ.
    pub(crate) fn voxel_length(&self) -> f32 {
        libm::cbrt(self.local_to_world.matrix3.determinant().abs()) as f32
    }

    #[inline(always)]
    pub(crate) fn to_local(&self, p_world: DVec3) -> DVec3 {
        self.world_to_local.transform_point3(p_world)
    }

    #[inline(always)]
    pub(crate) fn to_index(&self, p_world: DVec3) -> DVec3 {
        self.to_local(p_world) + self.grid.local_to_index()
    }

    pub(crate) fn vector_to_local(&self, vector: DVec3) -> DVec3 {
        self.world_to_local.transform_vector3(vector)
    }

    /// The box of local coordinates outside which the field is the background.
    #[inline(always)]
    pub(crate) fn support(&self) -> Bounds3 {
        let [low, high] = self.grid.support.map(|corner| DVec3::from_array(corner.map(f64::from)));
        Bounds3::new(low, high)
    }

    /// The box in the world that holds the support; `None` if it is empty.
    pub(crate) fn bounds_world(&self) -> Option<Bounds3> {
        (!self.grid.is_empty()).then(|| self.support().moved(&self.local_to_world))
    }

    /// The part of the ray `origin + t direction`, t in [0, t_max], inside the support; `direction`
    /// is a unit vector.
    #[inline(always)]
    pub(crate) fn span(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<Span> {
        let o = self.to_local(origin);
        // In double precision: the origin may be far off.
        let d = self.world_to_local.matrix3 * direction.as_dvec3();
        // Also refuses NaN, which the clipping would pass over.
        if !(d.length_squared() > 0.0) {
            return None;
        }
        let (t0, t1) = self.support().clip(o, d, 0.0, t_max)?;
        let line = Line { p: o + d * t0, d, length: t1 - t0 };
        Some(Span { t_enter: t0, length: line.length as f32, direction, line })
    }

    /// World distance from the ray's origin at parameter `t` of a field of this span.
    #[inline]
    pub(crate) fn world_distance(&self, span: &Span, t: f32) -> f64 {
        let t = f64::from(t);
        let t = if self.wide { distance(&self.grid, &span.line, t) } else { t };
        span.t_enter + t
    }

    /// The ray field of a span, compiled for voxels and partition. `scales`: raw value to
    /// extinction and raw bound to majorant. For grids that are not wide.
    #[inline(always)]
    pub(crate) fn ray<'a, V: Voxel, P: Partition>(
        &'a self,
        voxels: &'a [V],
        partition: P,
        scales: [f32; 2],
        span: &Span,
    ) -> GridRay<'a, V, P> {
        GridRay::new(self.grid.view(voxels), partition, scales, Lowest, span.line)
    }

    /// The ray field of a span on any partition, whatever the voxel type and the width.
    #[inline(always)]
    pub(crate) fn any_ray<'a>(
        &'a self,
        partition: AnyPartition<'a>,
        scales: [f32; 2],
        span: &Span,
    ) -> AnyGridRay<'a> {
        if self.wide {
            return self.wide_ray(partition, scales, span);
        }
        // The default structure is compiled by itself.
        match (&self.grid.voxels, partition) {
            (Voxels::Half(voxels), AnyPartition::Adaptive(cells)) => {
                AnyGridRay::Half(self.ray(voxels, cells, scales, span))
            }
            (Voxels::Single(voxels), AnyPartition::Adaptive(cells)) => {
                AnyGridRay::Single(self.ray(voxels, cells, scales, span))
            }
            (Voxels::Half(voxels), other) => {
                AnyGridRay::HalfOther(self.ray(voxels, other, scales, span))
            }
            (Voxels::Single(voxels), other) => {
                AnyGridRay::SingleOther(self.ray(voxels, other, scales, span))
            }
        }
    }

    #[inline(never)]
    fn wide_ray<'a>(
        &'a self,
        partition: AnyPartition<'a>,
        scales: [f32; 2],
        span: &Span,
    ) -> AnyGridRay<'a> {
        AnyGridRay::Wide(Box::new(WideRay::new(&self.grid, partition, scales, span.line)))
    }
}
