//! Value and state of single voxels.

use crate::tree::{Coord, LEAF_VALUES, TILE_SIZES, Tree, leaf_offset};

impl<T: Copy + PartialEq> Tree<T> {
    /// Value of a voxel and whether it is active. Costs up to four binary searches; see
    /// [`Tree::accessor`] for many voxels.
    pub fn value(&self, ijk: Coord) -> (T, bool) {
        self.accessor().value(ijk)
    }

    /// Looks up voxels and remembers where the last one was, which makes neighbours cheap.
    pub fn accessor(&self) -> Accessor<'_, T> {
        Accessor { tree: self, found: None }
    }
}

/// A cursor into a tree, cheap to make, one per thread.
#[derive(Debug, Clone)]
pub struct Accessor<'a, T> {
    tree: &'a Tree<T>,
    /// Origin of the last leaf-sized cell and what is there.
    found: Option<(Coord, Cell<T>)>,
}

#[derive(Debug, Clone, Copy)]
enum Cell<T> {
    Leaf(usize),
    Constant(T, bool),
}

impl<T: Copy + PartialEq> Accessor<'_, T> {
    /// Value of a voxel and whether it is active.
    pub fn value(&mut self, ijk: Coord) -> (T, bool) {
        let origin = ijk.map(|axis| axis & !7);
        let cell = match self.found {
            Some((at, cell)) if at == origin => cell,
            _ => {
                let cell = self.search(origin);
                self.found = Some((origin, cell));
                cell
            }
        };
        match cell {
            Cell::Constant(value, active) => (value, active),
            Cell::Leaf(leaf) => {
                let offset = leaf_offset(ijk);
                let value = self.tree.values[leaf * LEAF_VALUES + offset];
                (value, self.tree.leaves[leaf].mask[offset >> 6] >> (offset & 63) & 1 != 0)
            }
        }
    }

    fn search(&self, origin: Coord) -> Cell<T> {
        let tree = self.tree;
        if let Ok(leaf) = tree.leaves.binary_search_by_key(&origin, |leaf| leaf.origin) {
            return Cell::Leaf(leaf);
        }
        for log2_size in TILE_SIZES {
            let corner = origin.map(|axis| axis >> log2_size << log2_size);
            if let Ok(index) = tree.tiles.binary_search_by_key(&corner, |tile| tile.origin) {
                let tile = &tree.tiles[index];
                if tile.log2_size >= log2_size {
                    return Cell::Constant(tile.value, tile.active);
                }
            }
        }
        Cell::Constant(tree.background, false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::Tile;

    fn sample() -> Tree<i32> {
        let values = std::array::from_fn(|index| index as i32);
        Tree::from_leaves(-1, [([8, 8, 8], values, [1, 0, 0, 0, 0, 0, 0, 1 << 63])]).with_tiles([
            Tile { origin: [0, 0, 0], log2_size: 3, value: 77, active: true },
            Tile { origin: [-128, 0, 0], log2_size: 7, value: 88, active: false },
            Tile { origin: [-8192, 0, 0], log2_size: 12, value: 99, active: true },
        ])
    }

    #[test]
    fn finds_leaves_tiles_and_background() {
        let tree = sample();
        let cases = [
            ([8, 8, 8], (0, true)),
            ([8, 8, 9], (1, false)),
            ([15, 15, 15], (511, true)),
            ([9, 8, 8], (64, false)),
            ([7, 7, 7], (77, true)),
            ([8, 0, 0], (-1, false)),
            ([-1, 127, 127], (88, false)),
            ([-129, 0, 0], (-1, false)),
            ([-1, 128, 0], (-1, false)),
            ([-4097, 4095, 4095], (99, true)),
            ([-4096, 0, 0], (-1, false)),
            ([i32::MAX; 3], (-1, false)),
            ([i32::MIN; 3], (-1, false)),
        ];
        let mut accessor = tree.accessor();
        for (ijk, expected) in cases {
            assert_eq!(tree.value(ijk), expected, "{ijk:?}");
            assert_eq!(accessor.value(ijk), expected, "{ijk:?}");
        }
        for (ijk, expected) in cases.iter().rev() {
            assert_eq!(accessor.value(*ijk), *expected, "{ijk:?}");
        }
    }

    #[test]
    fn a_small_tile_does_not_answer_for_a_larger_cell() {
        // Corner (0, 0, 0) is that of the tile of 8, but (100, 0, 0) lies outside it.
        assert_eq!(sample().value([100, 0, 0]), (-1, false));
    }
}
