//! The sparse tree of one grid, flattened: leaves of 8x8x8 values and constant tiles.

/// Index coordinate of a voxel.
pub type Coord = [i32; 3];

/// Number of values of a leaf (8 x 8 x 8).
pub const LEAF_VALUES: usize = 512;

/// A leaf node: where it is and which of its voxels are active.
///
/// Its values stand in [`Tree::values`] at `index * 512 ..`, z fastest: the value of voxel
/// `(x, y, z)` is at `(x & 7) << 6 | (y & 7) << 3 | (z & 7)`, bit `offset & 63` of
/// `mask[offset >> 6]` tells whether it is active.
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

/// All values of a grid. Voxels that no leaf and no tile covers have the background value and are
/// inactive.
///
/// Leaves and tiles are sorted by origin (x, then y, then z) and do not overlap. Inactive tiles
/// that hold the background value are left out.
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

impl<T: Copy + PartialEq> Tree<T> {
    /// A tree of leaves alone: origin, values (z fastest) and active mask of each, in any order.
    ///
    /// Origins are rounded down to multiples of 8; of several leaves with one origin the last
    /// stays.
    pub fn from_leaves(
        background: T,
        leaves: impl IntoIterator<Item = (Coord, [T; LEAF_VALUES], [u64; 8])>,
    ) -> Tree<T> {
        let mut sorted = std::collections::BTreeMap::new();
        for (origin, values, mask) in leaves {
            sorted.insert(origin.map(|axis| axis & !7), (values, mask));
        }
        let mut tree =
            Tree { background, leaves: Vec::new(), values: Vec::new(), tiles: Vec::new() };
        for (origin, (values, mask)) in sorted {
            tree.leaves.push(Leaf { origin, mask });
            tree.values.extend(values);
        }
        tree
    }

    /// A tree of a box of voxels that begins at `min` and has `size` voxels per axis; `values` runs
    /// over z fastest, then y. Values that differ from the background become active; leaves without
    /// any are left out.
    ///
    /// # Panics
    /// When `values` has another length than the product of `size`, or the box leaves the range of
    /// coordinates.
    pub fn from_dense(background: T, min: Coord, size: [usize; 3], values: &[T]) -> Tree<T> {
        assert_eq!(values.len(), size.iter().product::<usize>(), "one value per voxel");
        let mut leaves = std::collections::BTreeMap::new();
        for (index, value) in values.iter().enumerate() {
            if *value == background {
                continue;
            }
            let steps = [index / size[2] / size[1], index / size[2] % size[1], index % size[2]];
            let ijk: Coord = std::array::from_fn(|axis| {
                let step = i32::try_from(steps[axis]).ok();
                step.and_then(|step| min[axis].checked_add(step)).expect("a coordinate overflows")
            });
            let leaf = leaves
                .entry(ijk.map(|axis| axis & !7))
                .or_insert_with(|| ([background; LEAF_VALUES], [0u64; 8]));
            let offset = leaf_offset(ijk);
            leaf.0[offset] = *value;
            leaf.1[offset >> 6] |= 1 << (offset & 63);
        }
        Tree::from_leaves(background, leaves.into_iter().map(|(o, (v, m))| (o, v, m)))
    }

    /// This tree's leaves with these tiles instead of its own. Inactive ones that hold the background
    /// are dropped.
    ///
    /// Origins are rounded down to multiples of the tiles' size; the caller sees to it that they
    /// overlap neither each other nor leaves.
    ///
    /// # Panics
    /// When a size is none of 3, 7 and 12.
    #[must_use]
    pub fn with_tiles(mut self, tiles: impl IntoIterator<Item = Tile<T>>) -> Tree<T> {
        self.tiles = tiles.into_iter().filter(|t| t.active || t.value != self.background).collect();
        for tile in &mut self.tiles {
            assert!(
                TILE_SIZES.contains(&tile.log2_size),
                "a tile has 8, 128 or 4096 voxels an edge"
            );
            tile.origin = tile.origin.map(|axis| axis >> tile.log2_size << tile.log2_size);
        }
        self.tiles.sort_by_key(|tile| tile.origin);
        self
    }

    /// The tree with every value, also the background, replaced.
    pub fn map<U>(self, mut change: impl FnMut(T) -> U) -> Tree<U> {
        Tree {
            background: change(self.background),
            leaves: self.leaves,
            values: self.values.into_iter().map(&mut change).collect(),
            tiles: self
                .tiles
                .into_iter()
                .map(|tile| Tile {
                    origin: tile.origin,
                    log2_size: tile.log2_size,
                    value: change(tile.value),
                    active: tile.active,
                })
                .collect(),
        }
    }
}

/// Sizes a tile can have, as powers of two.
pub(crate) const TILE_SIZES: [u32; 3] = [3, 7, 12];

/// Position of a voxel among the values of its leaf.
pub(crate) fn leaf_offset(ijk: Coord) -> usize {
    let [x, y, z] = ijk.map(|axis| (axis & 7) as usize);
    x << 6 | y << 3 | z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dense_boxes_become_leaves() {
        let values: Vec<f32> = (0..3 * 4 * 5).map(|i| i as f32).collect();
        let tree = Tree::from_dense(0.0, [-2, 6, 7], [3, 4, 5], &values);
        assert_eq!(tree.leaves().len(), 8);
        assert_eq!(tree.leaves()[0].origin, [-8, 0, 0]);
        assert_eq!(tree.values().len(), 8 * LEAF_VALUES);
        assert_eq!(tree.leaf_values(0)[leaf_offset([-2, 7, 7])], 5.0);
    }

    #[test]
    fn leaves_and_tiles_are_aligned_and_sorted() {
        let leaf = |x| ([x, 0, 3], [x; LEAF_VALUES], [0; 8]);
        let tree = Tree::from_leaves(0, [leaf(9), leaf(-9), leaf(10)]);
        let origins: Vec<_> = tree.leaves().iter().map(|leaf| leaf.origin).collect();
        assert_eq!(origins, [[-16, 0, 0], [8, 0, 0]]);
        assert_eq!(tree.leaf_values(1)[0], 10);
        let tile = |x, value| Tile { origin: [x, 0, 0], log2_size: 7, value, active: false };
        let tree = tree.with_tiles([tile(300, 1), tile(-1, 2), tile(999, 0)]);
        let origins: Vec<_> = tree.tiles().iter().map(|tile| tile.origin[0]).collect();
        assert_eq!(origins, [-128, 256]);
        assert_eq!(tree.map(|v| v as f32 + 0.5).tiles()[0].value, 2.5);
    }
}
