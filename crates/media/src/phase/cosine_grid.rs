//! The mean cosine of Henyey-Greenstein by a grid.

use super::henyey_greenstein::MAX_G;
use crate::Error;
use crate::clamped::Clamped;
use crate::grid::{Interpolation, VoxelGrid, VoxelGridOptions};
use crate::index_map::snapped;
use glam::{DAffine3, DVec3};
use pileus_vdb::Tree;

/// A mean cosine per point of index space, interpolated trilinearly, in [-0.999, 0.999].
#[derive(Debug, Clone)]
pub struct CosineGrid {
    /// The mean cosine plus one: grids hold no negative numbers.
    plus_one: VoxelGrid,
    /// From the index space it is asked in to its own.
    to_index: DAffine3,
    clamped: Clamped,
}

impl CosineGrid {
    /// `scale * value + offset` of a grid of numbers, clamped per voxel; values that are not finite
    /// count as 0. `to_index` maps the index space of the medium that asks to that of this tree.
    ///
    /// # Errors
    /// If `scale` or `offset` is not finite; else as [`VoxelGrid::from_tree`].
    pub fn new(
        tree: &Tree<f32>,
        scale: f32,
        offset: f32,
        to_index: DAffine3,
    ) -> Result<CosineGrid, Error> {
        if !(scale.is_finite() && offset.is_finite()) {
            return Err(Error::invalid(
                format!("the mean cosine is {scale} times the grid plus {offset}"),
                "give finite numbers",
            ));
        }
        let cosines = tree.clone().map(|value| scale * value + offset);
        let clamped = Clamped::numbers(&cosines, (-1.0, 1.0));
        let plus_one = tree.clone().map(|value| {
            let value = if value.is_finite() { value } else { 0.0 };
            1.0 + (scale * value + offset).clamp(-MAX_G, MAX_G)
        });
        let options = VoxelGridOptions { interpolation: Interpolation::Trilinear };
        let plus_one = VoxelGrid::from_tree(&plus_one, &options)?;
        Ok(CosineGrid { plus_one, to_index: snapped(to_index), clamped })
    }

    /// The mean cosines that were not in [-1, 1].
    pub fn clamped(&self) -> Clamped {
        self.clamped
    }

    /// Smallest and largest mean cosine of all space.
    pub fn range(&self) -> (f32, f32) {
        let (low, high) = self.plus_one.range();
        let background = self.plus_one.background();
        (low.min(background) - 1.0, high.max(background) - 1.0)
    }

    /// The mean cosine at a point of the asking medium's index space.
    #[inline(never)]
    pub fn at_index(&self, p_index: DVec3) -> f32 {
        let value = self.plus_one.interpolate(self.to_index.transform_point3(p_index)) - 1.0;
        (value as f32).clamp(-MAX_G, MAX_G)
    }
}
