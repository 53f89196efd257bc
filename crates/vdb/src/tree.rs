//! The sparse tree of one grid, flattened: leaves of 8x8x8 values and constant tiles.

/// Index coordinate of a voxel.
pub type Coord = [i32; 3];

/// Number of values of a leaf (8 x 8 x 8).
pub const LEAF_VALUES: usize = 512;

/// A leaf node: where it is and which of its voxels are active.
///
/// Its values stand in [`Tree::values`] at `index * 512 ..`, z fastest: the value of voxel `(x, y, z)` is at
/// `(x & 7) << 6 | (y & 7) << 3 | (z & 7)`, bit `offset & 63` of `mask[offset >> 6]` tells whether it is active.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Leaf {
    /// Smallest index coordinate of the leaf, a multiple of 8 per axis.
    pub origin: Coord,
    /// Active mask, bit per voxel.
    pub mask: [u64; 8],
}

/// A constant region: a tile of an internal or root node.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile<T> {
    /// Smallest index coordinate of the tile.
    pub origin: Coord,
    /// Edge length in voxels as a power of two: 3 (8), 7 (128) or 12 (4096).
    pub log2_size: u32,
    /// Value of every voxel in it.
    pub value: T,
    /// Whether its voxels count as active.
    pub active: bool,
}

/// All values of a grid. Voxels that no leaf and no tile covers have the background value and are inactive.
///
/// Leaves and tiles are sorted by origin (x, then y, then z) and do not overlap. Inactive tiles that hold the background
/// value are left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Tree<T> {
    pub(crate) background: T,
    pub(crate) leaves: Vec<Leaf>,
    pub(crate) values: Vec<T>,
    pub(crate) tiles: Vec<Tile<T>>,
}

impl<T> Tree<T> {
    /// Value outside all leaves and tiles.
    pub fn background(&self) -> &T {
        &self.background
    }
    /// Leaves, sorted by origin.
    pub fn leaves(&self) -> &[Leaf] {
        &self.leaves
    }
    /// Values of all leaves, 512 per leaf in the order of [`Tree::leaves`].
    pub fn values(&self) -> &[T] {
        &self.values
    }
    /// Values of leaf `index`; panics if there is no such leaf.
    pub fn leaf_values(&self, index: usize) -> &[T] {
        &self.values[index * LEAF_VALUES..(index + 1) * LEAF_VALUES]
    }
    /// Constant regions, sorted by origin.
    pub fn tiles(&self) -> &[Tile<T>] {
        &self.tiles
    }
}
