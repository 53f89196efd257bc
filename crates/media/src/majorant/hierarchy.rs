//! The hierarchy of powers of two that every grid carries: cells of 4, 8, 16, ... voxels, the level
//! chosen by the walk.

use super::partition::{Cell, NO_BRICK, Partition};
use crate::grid::{BRICK_LOG2, Entry, Topology, VoxelGrid, entry_index, sub_cell};

/// Finest cell of the bounds: 4 voxels.
pub(crate) const FINEST_LOG2: u32 = 2;

/// A cell is entered whole if at most this many tentative collisions are expected along its edge;
/// else its parts are.
///
/// Time per path is flat within the noise of 10 % between 0.5 and 4 on the three peer clouds.
const COLLISIONS_PER_CELL: f32 = 1.0;

/// Cells of 4, 8, 16, ... voxels: the largest around a point in which at most one tentative
/// collision is expected, or 4. Nothing is built for it, and a change of scale rebuilds nothing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hierarchy<'a> {
    entries: &'a [Entry],
    entry_min: &'a [f32],
    sub_max: &'a [[f32; 8]],
    sub_min: &'a [[f32; 8]],
    topology: &'a Topology,
    /// Largest product of raw bound and cell size (voxels) that is entered whole.
    limit: f32,
}

/// A cell's bound and, up to brick size, its brick.
struct Bound {
    max: f32,
    brick: u32,
}

impl<'a> Hierarchy<'a> {
    /// For raw bounds that are scaled to majorants per voxel by `per_voxel`.
    #[inline(always)]
    pub(crate) fn new(grid: &'a VoxelGrid, per_voxel: f32) -> Hierarchy<'a> {
        Hierarchy {
            entries: &grid.entries,
            entry_min: &grid.entry_min,
            sub_max: &grid.sub_max,
            sub_min: &grid.sub_min,
            topology: &grid.topology,
            limit: COLLISIONS_PER_CELL / per_voxel,
        }
    }

    #[inline(always)]
    fn entry(&self, ijk: [i32; 3], log2: u32) -> Entry {
        self.entries[entry_index(self.topology, self.entries, ijk, log2)]
    }

    #[inline(always)]
    fn bound(&self, ijk: [i32; 3], log2: u32) -> Bound {
        if log2 >= BRICK_LOG2 {
            let entry = self.entry(ijk, log2);
            return Bound { max: entry.max, brick: entry.child };
        }
        let brick = self.entry(ijk, BRICK_LOG2).child;
        Bound { max: self.sub_max[brick as usize][sub_cell(ijk)], brick }
    }

    /// Whether a cell of `2^log2` voxels with bound `max` is entered whole.
    #[inline(always)]
    fn fits(&self, max: f32, log2: u32) -> bool {
        max * f32::from_bits((127 + log2) << 23) <= self.limit
    }
}

impl Partition for Hierarchy<'_> {
    #[inline(always)]
    fn cell(&self, ijk: [i32; 3], last: u32) -> Cell {
        let mut log2 = last.max(FINEST_LOG2);
        let mut bound = self.bound(ijk, log2);
        if self.fits(bound.max, log2) {
            let top = self.topology.top_log2();
            while log2 < top {
                let above = self.bound(ijk, log2 + 1);
                if !self.fits(above.max, log2 + 1) {
                    break;
                }
                log2 += 1;
                bound = above;
            }
        } else {
            while log2 > FINEST_LOG2 {
                log2 -= 1;
                bound = self.bound(ijk, log2);
                if self.fits(bound.max, log2) {
                    break;
                }
            }
        }
        let size = 1i32 << log2;
        let low = ijk.map(|c| c & -size);
        Cell {
            low,
            high: low.map(|c| c.saturating_add(size)),
            max: bound.max,
            brick: if log2 <= BRICK_LOG2 { bound.brick } else { NO_BRICK },
            key: log2,
        }
    }

    fn min(&self, cell: &Cell) -> f32 {
        if cell.key < BRICK_LOG2 {
            self.sub_min[cell.brick as usize][sub_cell(cell.low)]
        } else {
            self.entry_min[entry_index(self.topology, self.entries, cell.low, cell.key)]
        }
    }
}
