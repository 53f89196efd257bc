//! A grid of colours, looked up where a path scatters.

use crate::Error;
use crate::clamped::Clamped;
use crate::grid::{Interpolation, VoxelGrid, VoxelGridOptions};
use crate::index_map::{box_over, snapped};
use glam::{DVec3, Vec3};
use pileus_math::Bounds3;
use pileus_vdb::Tree;

/// A colour per point of index space, interpolated trilinearly and clamped to [0, 1] per channel.
#[derive(Debug, Clone)]
pub struct ColorGrid {
    /// One grid for all channels, or one each.
    channels: Vec<VoxelGrid>,
    /// From the index space it is asked in to its own, if they differ.
    to_index: glam::DAffine3,
    clamped: Clamped,
}

impl ColorGrid {
    /// Colours of a vector grid. `to_index` maps the index space of the medium that asks to that of
    /// this tree.
    ///
    /// # Errors
    /// If the tree spans more than 2^31 voxels along an axis.
    pub fn from_vec3_tree(tree: &Tree<[f32; 3]>, to_index: glam::DAffine3) -> Result<Self, Error> {
        let clamped = Clamped::vectors(tree, (0.0, 1.0));
        let channels = (0..3)
            .map(|channel| ColorGrid::channel(&tree.clone().map(|v| v[channel])))
            .collect::<Result<_, _>>()?;
        Ok(ColorGrid { channels, to_index: snapped(to_index), clamped })
    }

    /// Greys of a scalar grid. `to_index` maps the index space of the medium that asks to that of
    /// this tree.
    ///
    /// # Errors
    /// If the tree spans more than 2^31 voxels along an axis.
    pub fn from_float_tree(tree: &Tree<f32>, to_index: glam::DAffine3) -> Result<Self, Error> {
        let clamped = Clamped::numbers(tree, (0.0, 1.0));
        let channels = vec![ColorGrid::channel(tree)?];
        Ok(ColorGrid { channels, to_index: snapped(to_index), clamped })
    }

    fn channel(tree: &Tree<f32>) -> Result<VoxelGrid, Error> {
        VoxelGrid::from_tree(tree, &VoxelGridOptions { interpolation: Interpolation::Trilinear })
    }

    /// The colour, if it is the same everywhere: of a grid without values, its background.
    pub fn constant(&self) -> Option<Vec3> {
        let constant = self.channels.iter().all(VoxelGrid::is_empty);
        constant.then(|| self.at_index(DVec3::ZERO))
    }

    /// The numbers that were not in [0, 1], over all channels.
    pub fn clamped(&self) -> Clamped {
        self.clamped
    }

    /// Smallest value of each channel over a box of the asking medium's index space: never too
    /// large.
    pub(crate) fn least_over(&self, bounds: Bounds3) -> Vec3 {
        let bounds = box_over(&self.to_index, bounds);
        let least = |channel: &VoxelGrid| channel.range_over(bounds).0;
        let color = match self.channels.as_slice() {
            [grey] => Vec3::splat(least(grey)),
            [r, g, b] => Vec3::new(least(r), least(g), least(b)),
            _ => Vec3::ONE,
        };
        color.clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// Whether every channel is constant over the box.
    pub(crate) fn is_constant_over(&self, bounds: Bounds3) -> bool {
        let bounds = box_over(&self.to_index, bounds);
        self.channels.iter().all(|channel| {
            let (min, max) = channel.range_over(bounds);
            min == max
        })
    }

    /// The colour at a point of the asking medium's index space.
    pub fn at_index(&self, p_index: DVec3) -> Vec3 {
        let p = self.to_index.transform_point3(p_index);
        let value = |channel: &VoxelGrid| channel.interpolate(p) as f32;
        let color = match self.channels.as_slice() {
            [grey] => Vec3::splat(value(grey)),
            [r, g, b] => Vec3::new(value(r), value(g), value(b)),
            _ => Vec3::ONE,
        };
        color.clamp(Vec3::ZERO, Vec3::ONE)
    }
}
