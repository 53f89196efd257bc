//! What all majorant structures have in common: a partition of space into boxes of voxels, each
//! with a bound.

/// A cell around a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cell {
    /// First local voxel per axis.
    pub(crate) low: [i32; 3],
    /// One past the last, per axis; may lie beyond the grid.
    pub(crate) high: [i32; 3],
    /// Largest raw value that interpolation can return in it.
    pub(crate) max: f32,
    /// The brick that holds all of it, or [`NO_BRICK`].
    pub(crate) brick: u32,
    /// What the partition finds it again by.
    pub(crate) key: u32,
}

/// No brick holds all of a cell.
pub(crate) const NO_BRICK: u32 = u32::MAX;

impl Cell {
    /// Before the first one.
    pub(crate) const NONE: Cell =
        Cell { low: [0; 3], high: [0; 3], max: 0.0, brick: NO_BRICK, key: 0 };
}

/// A partition of a grid's voxels into cells: every voxel is in one cell, which depends on the
/// voxel alone, not on how a walk came there.
pub(crate) trait Partition: Copy {
    /// The cell around local voxel `ijk`, which lies within the grid's extent. `last`: the key of
    /// the cell before, zero at first; it may speed up the search and does not change what is
    /// found.
    fn cell(&self, ijk: [i32; 3], last: u32) -> Cell;

    /// Smallest raw value that interpolation can return in a cell found before.
    fn min(&self, cell: &Cell) -> f32;
}
