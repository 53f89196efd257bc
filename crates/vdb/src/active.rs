//! What the active voxels of a tree span: their number, their box, their range, and each of them.

use crate::tree::{Coord, LEAF_VALUES, Leaf, Tree};

/// An active voxel, or an active tile as one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActiveValue<T> {
    /// The voxel, or the smallest corner of the tile.
    pub origin: Coord,
    /// Edge in voxels as a power of two: 0 for a voxel, else 3, 7 or 12.
    pub log2_size: u32,
    /// The value.
    pub value: T,
}

impl<T: Copy + PartialEq> Tree<T> {
    /// Number of active voxels; a tile counts with its volume. Stops at `u64::MAX`.
    pub fn active_voxel_count(&self) -> u64 {
        let leaves = self.leaves.iter().flat_map(|leaf| leaf.mask).map(|w| w.count_ones().into());
        let tiles = self.tiles.iter().filter(|tile| tile.active).map(|t| 1 << (3 * t.log2_size));
        leaves.chain(tiles).fold(0, u64::saturating_add)
    }

    /// Smallest and largest coordinate (both inside) of the box around all active voxels and tiles;
    /// none without any.
    pub fn active_bbox(&self) -> Option<(Coord, Coord)> {
        let leaves = self.leaves.iter().filter_map(leaf_bbox);
        let tiles = self.tiles.iter().filter(|tile| tile.active).map(|tile| {
            let last = (1i32 << tile.log2_size) - 1;
            (tile.origin, tile.origin.map(|axis| axis.saturating_add(last)))
        });
        leaves.chain(tiles).reduce(|(min, max), (low, high)| {
            let pick = |a: Coord, b: Coord, f: fn(i32, i32) -> i32| {
                [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
            };
            (pick(min, low, Ord::min), pick(max, high, Ord::max))
        })
    }

    /// All active voxels and tiles: leaves first, in order, then tiles.
    pub fn active_values(&self) -> impl Iterator<Item = ActiveValue<T>> {
        let voxels = self.leaves.iter().zip(self.values.chunks_exact(LEAF_VALUES)).flat_map(
            |(leaf, values)| {
                set_bits(&leaf.mask).map(move |offset| {
                    let steps = [offset >> 6, offset >> 3 & 7, offset & 7];
                    let origin = std::array::from_fn(|axis| leaf.origin[axis] + steps[axis] as i32);
                    ActiveValue { origin, log2_size: 0, value: values[offset] }
                })
            },
        );
        let tiles = self.tiles.iter().filter(|tile| tile.active).map(|tile| ActiveValue {
            origin: tile.origin,
            log2_size: tile.log2_size,
            value: tile.value,
        });
        voxels.chain(tiles)
    }
}

impl<T: Copy + PartialEq + PartialOrd> Tree<T> {
    /// Smallest and largest active value; values without order (NaN) are left out. None without
    /// any.
    pub fn min_max(&self) -> Option<(T, T)> {
        #[expect(clippy::eq_op, reason = "NaN is what differs from itself")]
        let ordered = self.active_values().map(|active| active.value).filter(|v| v == v);
        ordered.fold(None, |range, value| match range {
            None => Some((value, value)),
            Some((min, max)) => {
                Some((if value < min { value } else { min }, if value > max { value } else { max }))
            }
        })
    }
}

/// Positions of the set bits of a leaf's mask.
fn set_bits(mask: &[u64; 8]) -> impl Iterator<Item = usize> + '_ {
    mask.iter().enumerate().flat_map(|(index, word)| {
        let mut left = *word;
        std::iter::from_fn(move || {
            let bit = (left != 0).then(|| left.trailing_zeros() as usize)?;
            left &= left - 1;
            Some(64 * index + bit)
        })
    })
}

fn leaf_bbox(leaf: &Leaf) -> Option<(Coord, Coord)> {
    let all = leaf.mask.iter().fold(0, |all, word| all | word);
    if all == 0 {
        return None;
    }
    // Which slices along each axis hold anything: words are x, bytes of them y, bits of those z.
    let mut slices = [0u8; 3];
    for (x, word) in leaf.mask.iter().enumerate() {
        slices[0] |= u8::from(*word != 0) << x;
    }
    for (y, byte) in all.to_le_bytes().into_iter().enumerate() {
        slices[1] |= u8::from(byte != 0) << y;
        slices[2] |= byte;
    }
    let low = std::array::from_fn(|a| leaf.origin[a] + slices[a].trailing_zeros() as i32);
    let high = std::array::from_fn(|a| leaf.origin[a] + 7 - slices[a].leading_zeros() as i32);
    Some((low, high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::Tile;

    #[test]
    fn a_box_of_voxels() {
        let mut values = vec![0.0; 27];
        values[0] = -2.0;
        values[26] = f32::NAN;
        values[13] = 5.0;
        let tree = Tree::from_dense(0.0, [-1, 7, 100], [3, 3, 3], &values);
        assert_eq!(tree.active_voxel_count(), 3);
        assert_eq!(tree.active_bbox(), Some(([-1, 7, 100], [1, 9, 102])));
        assert_eq!(tree.min_max(), Some((-2.0, 5.0)));
        let first = tree.active_values().next().unwrap();
        assert_eq!(first, ActiveValue { origin: [-1, 7, 100], log2_size: 0, value: -2.0 });
        assert_eq!(tree.active_values().count(), 3);
    }

    #[test]
    fn tiles_count_with_their_volume() {
        let corner = i32::MAX - 4095;
        let tree = Tree::from_leaves(0u8, []).with_tiles([
            Tile { origin: [corner; 3], log2_size: 12, value: 3, active: true },
            Tile { origin: [0; 3], log2_size: 7, value: 9, active: false },
        ]);
        assert_eq!(tree.active_voxel_count(), 1 << 36);
        assert_eq!(tree.active_bbox(), Some(([corner; 3], [i32::MAX; 3])));
        assert_eq!(tree.min_max(), Some((3, 3)));
    }

    #[test]
    fn nothing_active() {
        let tree = Tree::from_leaves(1i64, [([0; 3], [5; LEAF_VALUES], [0; 8])]);
        assert_eq!((tree.active_voxel_count(), tree.active_bbox()), (0, None));
        assert_eq!(tree.min_max(), None);
    }
}
