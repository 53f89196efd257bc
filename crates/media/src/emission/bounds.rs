//! Bounds of an emission in the world, and the rate of points that they are turned into.

use crate::Error;
use crate::grid::VoxelGrid;
use crate::majorant::{Adaptive, AnyPartition, Partition};
use crate::medium::{AnyGridRay, PlacedGrid, Span};
use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;
use std::sync::Arc;

/// A grid of bounds placed in the world. Points of line integrals are spread by a *rate*, the bound
/// of the cells around times a constant, on cells that are a function of the point alone, also
/// where voxels are longer along some axes: the rate at a point is known without a ray.
#[derive(Debug, Clone)]
pub(super) struct EmissionBounds {
    placed: PlacedGrid,
    /// Rate over bound.
    rate_factor: f32,
}

impl EmissionBounds {
    /// `index_to_world` places the index space of the emission: voxel `i` of `grid` bounds the
    /// emission in `[i, i + 1]` of it.
    ///
    /// # Errors
    /// If rates are out of range, or the transform is singular or not finite.
    pub(super) fn new(
        grid: Arc<VoxelGrid>,
        index_to_world: DAffine3,
        rate_factor: f32,
    ) -> Result<EmissionBounds, Error> {
        let largest = grid.range().1;
        // Points divide by the rate and multiply it with cell sizes: keep both far from overflow.
        if !(f64::from(rate_factor) * f64::from(largest) < 1e30) {
            return Err(Error::invalid(
                format!("the emission, up to {largest}, is concentrated in too small a space"),
                "check the scale of the grid, the node and the job",
            ));
        }
        // Voxel i of the bounds is centred in its cell.
        let cell_to_world = index_to_world * DAffine3::from_translation(DVec3::splat(0.5));
        Ok(EmissionBounds { placed: PlacedGrid::new(grid, cell_to_world)?, rate_factor })
    }

    /// Points per length for an emission of one.
    pub(super) fn rate_factor(&self) -> f32 {
        self.rate_factor
    }

    /// From local coordinates of the bounds to the index space of the emission.
    pub(super) fn local_to_index(&self) -> DVec3 {
        self.placed.grid().local_to_index() + 0.5
    }

    /// The part of the ray `origin + t direction`, t in [0, t_max], that may meet emission.
    pub(super) fn span(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<Span> {
        self.placed.span(origin, direction, t_max)
    }

    /// The rate along a span, as majorants of a ray field.
    pub(super) fn ray(&self, span: &Span) -> AnyGridRay<'_> {
        let partition = AnyPartition::Adaptive(self.cells());
        self.placed.any_ray(partition, [self.rate_factor; 2], span)
    }

    /// The rate at a point in the world, 1/length.
    pub(super) fn rate_at(&self, p_world: DVec3) -> f32 {
        let p = self.placed.to_local(p_world);
        let Bounds3 { low, high } = self.placed.support();
        if !(p.cmpge(low).all() && p.cmplt(high).all()) {
            return 0.0;
        }
        // Within the support, which lies within the extent.
        self.cells().cell(p.to_array().map(|c| c as i32), 0).max * self.rate_factor
    }

    fn cells(&self) -> Adaptive<'_> {
        Adaptive::new(self.placed.grid(), self.rate_factor * self.placed.voxel_length())
    }

    /// The box in the world that holds all emission; `None` if nothing emits.
    pub(super) fn bounds_world(&self) -> Option<Bounds3> {
        self.placed.bounds_world()
    }
}
