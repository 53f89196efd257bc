//! Range of a grid over any box of its index space, in bounded time.

use super::VoxelGrid;
use pileus_math::Bounds3;

/// Most voxels per axis that are looked at one by one.
const VOXELS: i64 = 6;
/// Most cells per axis that are looked at for larger boxes.
const CELLS: i64 = 4;

impl VoxelGrid {
    /// Smallest and largest value that interpolation can return in a closed box of index space:
    /// never too narrow, exact for boxes within six voxels whose corners are voxels. At most 216
    /// lookups, whatever the size of the box.
    pub(crate) fn range_over(&self, Bounds3 { low, high }: Bounds3) -> (f32, f32) {
        if !(low.is_finite() && high.is_finite()) {
            return self.range();
        }
        let mut range = (f32::INFINITY, f32::NEG_INFINITY);
        let mut join = |(min, max): (f32, f32)| range = (range.0.min(min), range.1.max(max));
        let (mut first, mut last) = ([0i32; 3], [0i32; 3]);
        let mut reaches_outside = false;
        for axis in 0..3 {
            let origin = i64::from(self.origin[axis]);
            let end = i64::from(self.topology.extent[axis]) - 1;
            let a = (low[axis].floor() as i64).saturating_sub(origin);
            let b = (high[axis].ceil() as i64).saturating_sub(origin);
            if b < 0 || a > end {
                return (self.background, self.background);
            }
            reaches_outside |= a < 0 || b > end;
            // Within the extent, which fits.
            first[axis] = a.max(0) as i32;
            last[axis] = b.min(end) as i32;
        }
        if reaches_outside {
            join((self.background, self.background));
        }
        let fits = |log2: u32, most: i64| {
            (0..3).all(|axis| i64::from((last[axis] >> log2) - (first[axis] >> log2)) < most)
        };
        let mut log2 = 0;
        if !fits(log2, VOXELS) {
            log2 = 2;
            while log2 < self.topology.top_log2() && !fits(log2, CELLS) {
                log2 += 1;
            }
        }
        for x in first[0] >> log2..=last[0] >> log2 {
            for y in first[1] >> log2..=last[1] >> log2 {
                for z in first[2] >> log2..=last[2] >> log2 {
                    let ijk = [x << log2, y << log2, z << log2];
                    if log2 == 0 {
                        let value = self.local_value(ijk);
                        join((value, value));
                    } else {
                        join(self.cell_range(ijk, log2));
                    }
                }
            }
        }
        range
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Interpolation, VoxelGridOptions};
    use glam::DVec3;
    use pileus_vdb::{Tile, Tree};
    use proptest::prelude::*;

    fn grid(interpolation: Interpolation) -> VoxelGrid {
        let values: Vec<f32> = (0..20 * 20 * 20).map(|i| ((i * 37) % 101) as f32).collect();
        let tile = Tile { origin: [128, 0, 0], log2_size: 7, value: 7.0, active: true };
        let tree = Tree::from_dense(0.0, [-3, 5, -9], [20; 3], &values).with_tiles([tile]);
        VoxelGrid::from_tree(&tree, &VoxelGridOptions { interpolation }).unwrap()
    }

    proptest! {
        #[test]
        fn nothing_in_the_box_leaves_the_range(
            low in prop::array::uniform3(-30.0..280.0f64),
            log_size in -2.0..9.0f64,
            u in prop::array::uniform3(0.0..=1.0f64),
            nearest: bool,
        ) {
            let kind = if nearest { Interpolation::Nearest } else { Interpolation::Trilinear };
            let grid = grid(kind);
            let low = DVec3::from_array(low);
            let size = DVec3::splat(log_size.exp2());
            let (min, max) = grid.range_over(Bounds3::new(low, low + size));
            for corner in 0..8 {
                let part = DVec3::from_array([0, 1, 2].map(|axis| {
                    if corner >> axis & 1 == 1 { u[axis] } else { 1.0 - u[axis] }
                }));
                let value = grid.interpolate(low + size * part) as f32;
                prop_assert!(value >= min * (1.0 - 1e-6) && value <= max * (1.0 + 1e-6));
            }
        }
    }

    #[test]
    fn small_boxes_and_constant_regions_are_exact() {
        let grid = grid(Interpolation::Trilinear);
        let over = |low, high| grid.range_over(Bounds3::new(low, high));
        let at = |x: f64| over(DVec3::splat(x), DVec3::splat(x + 1.0));
        let corners = |x: i32| {
            let values = (0..8).map(|c| grid.value([x + (c & 1), x + (c >> 1 & 1), x + (c >> 2)]));
            values.fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(v), b.max(v)))
        };
        assert_eq!(at(6.0), corners(6));
        let inside = over(DVec3::new(160.0, 40.0, 40.0), DVec3::new(224.0, 60.0, 60.0));
        assert_eq!(inside, (7.0, 7.0));
        assert_eq!(over(DVec3::splat(-1e300), DVec3::splat(1e300)), grid.range());
        assert_eq!(over(DVec3::splat(1e9), DVec3::splat(2e9)), (0.0, 0.0));
    }
}
