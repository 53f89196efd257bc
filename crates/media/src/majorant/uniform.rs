//! Uniform super-grids: equal cells of any size. One cell of everything is the global bound.

use super::partition::{Cell, NO_BRICK, Partition};
use crate::Error;
use crate::grid::VoxelGrid;
use rayon::prelude::*;

/// Most cells of a super-grid.
const MAX_CELLS: u64 = 1 << 26;

/// Bounds on cells of `size` voxels, dense over the grid's extent.
#[derive(Debug, Clone)]
pub(crate) struct UniformCells {
    size: [i32; 3],
    dims: [i32; 3],
    range: Vec<(f32, f32)>,
}

impl UniformCells {
    /// Cells of `size` voxels per edge.
    ///
    /// # Errors
    /// If there would be more than 2^26 of them.
    pub(crate) fn new(grid: &VoxelGrid, size: u32) -> Result<UniformCells, Error> {
        let extent = grid.topology.extent;
        let size = i32::try_from(size.max(1)).unwrap_or(i32::MAX);
        // No cell needs to be larger than everything.
        let size = extent.map(|n| size.min(n));
        let dims = [0, 1, 2].map(|axis| (extent[axis] - 1) / size[axis] + 1);
        let cells = dims.iter().try_fold(1u64, |n, &d| n.checked_mul(d.unsigned_abs().into()));
        let Some(cells) = cells.filter(|n| *n <= MAX_CELLS) else {
            return Err(Error::unsupported(
                format!("a super-grid of {} x {} x {} cells", dims[0], dims[1], dims[2]),
                "take larger cells: there may be 2^26",
            ));
        };
        let [_, ny, nz] = dims.map(|n| n as u64);
        let range = (0..cells)
            .into_par_iter()
            .map(|i| {
                let at = [(i / (ny * nz)) as i32, (i / nz % ny) as i32, (i % nz) as i32];
                let low = [0, 1, 2].map(|axis| at[axis] * size[axis]);
                let high =
                    [0, 1, 2].map(|axis| (low[axis].saturating_add(size[axis])).min(extent[axis]));
                grid.box_range(low, high)
            })
            .collect();
        Ok(UniformCells { size, dims, range })
    }

    /// Cells and their bytes.
    pub(crate) fn footprint(&self) -> (u64, u64) {
        let cells = self.range.len() as u64;
        (cells, 8 * cells)
    }
}

/// A view of the cells of a uniform super-grid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Uniform<'a>(pub(crate) &'a UniformCells);

impl Partition for Uniform<'_> {
    #[inline]
    fn cell(&self, ijk: [i32; 3], _: u32) -> Cell {
        let UniformCells { size, dims, range } = self.0;
        let at = [0, 1, 2].map(|axis| ijk[axis] / size[axis]);
        let key = (at[0] as usize * dims[1] as usize + at[1] as usize) * dims[2] as usize
            + at[2] as usize;
        let low = [0, 1, 2].map(|axis| at[axis] * size[axis]);
        let high = [0, 1, 2].map(|axis| low[axis].saturating_add(size[axis]));
        Cell { low, high, max: range[key].1, brick: NO_BRICK, key: key as u32 }
    }

    fn min(&self, cell: &Cell) -> f32 {
        self.0.range[cell.key as usize].0
    }
}
