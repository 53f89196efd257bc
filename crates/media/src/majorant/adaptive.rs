//! The hierarchy of powers of two, merged by the cost model: a cell is entered whole where its
//! parts would cost more.

use super::hierarchy::FINEST_LOG2;
use super::partition::{Cell, NO_BRICK, Partition};
use crate::grid::{BRICK_LOG2, Entry, Topology, VoxelGrid, entry_index, sub_cell};

/// Cells of 4, 8, 16, ... voxels: around a point the largest that the cost model does not split at
/// the medium's scale. The scales above which cells are split are part of every grid: nothing is
/// built for a medium, and a change of scale rebuilds nothing.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Adaptive<'a> {
    entries: &'a [Entry],
    entry_min: &'a [f32],
    sub_max: &'a [[f32; 8]],
    sub_min: &'a [[f32; 8]],
    topology: &'a Topology,
    /// Raw bound to majorant per voxel.
    per_voxel: f32,
}

impl<'a> Adaptive<'a> {
    /// For raw bounds that are scaled to majorants per voxel by `per_voxel`.
    #[inline(always)]
    pub(crate) fn new(grid: &'a VoxelGrid, per_voxel: f32) -> Adaptive<'a> {
        Adaptive {
            entries: &grid.entries,
            entry_min: &grid.entry_min,
            sub_max: &grid.sub_max,
            sub_min: &grid.sub_min,
            topology: &grid.topology,
            per_voxel,
        }
    }

    #[inline(always)]
    fn entry(&self, ijk: [i32; 3], log2: u32) -> Entry {
        self.entries[entry_index(self.topology, self.entries, ijk, log2)]
    }

    #[inline(always)]
    fn is_split(&self, entry: Entry) -> bool {
        self.per_voxel > entry.split_above
    }
}

impl Partition for Adaptive<'_> {
    #[inline(always)]
    fn cell(&self, ijk: [i32; 3], last: u32) -> Cell {
        let mut log2 = last.max(BRICK_LOG2);
        let mut entry = self.entry(ijk, log2);
        if self.is_split(entry) {
            while log2 > BRICK_LOG2 {
                log2 -= 1;
                entry = self.entry(ijk, log2);
                if !self.is_split(entry) {
                    break;
                }
            }
            if self.is_split(entry) {
                let low = ijk.map(|c| c & -(1 << FINEST_LOG2));
                return Cell {
                    low,
                    high: low.map(|c| c + (1 << FINEST_LOG2)),
                    max: self.sub_max[entry.child as usize][sub_cell(ijk)],
                    brick: entry.child,
                    key: FINEST_LOG2,
                };
            }
        } else {
            let top = self.topology.top_log2();
            while log2 < top {
                let above = self.entry(ijk, log2 + 1);
                if self.is_split(above) {
                    break;
                }
                log2 += 1;
                entry = above;
            }
        }
        let size = 1i32 << log2;
        let low = ijk.map(|c| c & -size);
        Cell {
            low,
            high: low.map(|c| c.saturating_add(size)),
            max: entry.max,
            brick: if log2 == BRICK_LOG2 { entry.child } else { NO_BRICK },
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
