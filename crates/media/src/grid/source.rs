//! What stands at each brick position of a tree: a leaf or a constant.

use pileus_vdb::{Coord, Tree};
use std::collections::{BTreeMap, HashMap};

/// A leaf (its index) or, with the top bit set, a constant (its index in [`Sources::constants`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Source(pub(super) u32);

const CONSTANT: u32 = 1 << 31;

impl Source {
    pub(super) const BACKGROUND: Source = Source(CONSTANT);

    /// The index of the constant, if it is one.
    pub(super) fn constant(self) -> Option<u32> {
        (self.0 & CONSTANT != 0).then_some(self.0 & !CONSTANT)
    }
}

/// Edge of the groups in which leaves are kept, as a power of two.
const GROUP_LOG2: u32 = 7;

/// Leaves and constants of a tree by position.
pub(super) struct Sources {
    /// Distinct values of constant regions; the first is the background.
    pub(super) constants: Vec<f32>,
    /// Leaves and 8^3 tiles of every 128^3 region that has any.
    groups: BTreeMap<Coord, Vec<(Coord, Source)>>,
    /// Larger tiles by size and position.
    tiles: HashMap<(u32, Coord), Source>,
    /// Cells of 2^e voxels, e = 7, 11, 15, ..., that are not constant.
    occupied: Vec<(u32, std::collections::HashSet<Coord>)>,
}

impl Sources {
    /// Sorts the leaves and tiles of `tree`; `sanitise` maps raw to stored values; cells up to
    /// `2^top_log2` voxels can be asked for.
    pub(super) fn new(tree: &Tree<f32>, sanitise: impl Fn(f32) -> f32, top_log2: u32) -> Sources {
        let background = sanitise(*tree.background());
        let mut constants = vec![background];
        let mut by_bits = HashMap::from([(background.to_bits(), 0u32)]);
        let mut groups: BTreeMap<Coord, Vec<(Coord, Source)>> = BTreeMap::new();
        let mut tiles = HashMap::new();
        for tile in tree.tiles() {
            let value = sanitise(tile.value);
            let id = *by_bits.entry(value.to_bits()).or_insert_with(|| {
                constants.push(value);
                constants.len() as u32 - 1
            });
            let source = Source(CONSTANT | id);
            if source == Source::BACKGROUND {
                continue;
            }
            if tile.log2_size == 3 {
                let group = tile.origin.map(|c| c >> GROUP_LOG2);
                groups.entry(group).or_default().push((tile.origin.map(|c| c >> 3), source));
            } else {
                let at = tile.origin.map(|c| c >> tile.log2_size);
                tiles.insert((tile.log2_size, at), source);
            }
        }
        for (index, leaf) in tree.leaves().iter().enumerate() {
            let group = leaf.origin.map(|c| c >> GROUP_LOG2);
            let source = Source(index as u32);
            groups.entry(group).or_default().push((leaf.origin.map(|c| c >> 3), source));
        }
        let mut occupied = Vec::new();
        let mut log2 = GROUP_LOG2;
        while log2 <= top_log2 {
            let mut set: std::collections::HashSet<Coord> =
                groups.keys().map(|g| g.map(|c| c >> (log2 - GROUP_LOG2))).collect();
            for &(size, at) in tiles.keys() {
                if size < log2 {
                    set.insert(at.map(|c| c >> (log2 - size)));
                }
            }
            occupied.push((log2, set));
            log2 += 4;
        }
        Sources { constants, groups, tiles, occupied }
    }

    /// The constant of the cell of `2^log2` voxels (log2 = 7, 11, ...) at `cell`, `None` if it is
    /// not constant.
    pub(super) fn constant_cell(&self, log2: u32, cell: Coord) -> Option<Source> {
        let occupied = self.occupied.iter().find(|(size, _)| *size == log2);
        if occupied.is_none_or(|(_, set)| set.contains(&cell)) {
            return None;
        }
        Some(self.tile_over(log2, cell))
    }

    fn tile_over(&self, log2: u32, cell: Coord) -> Source {
        for size in [7, 12] {
            if size >= log2
                && let Some(&source) = self.tiles.get(&(size, cell.map(|c| c >> (size - log2))))
            {
                return source;
            }
        }
        Source::BACKGROUND
    }

    /// Sources of a box of brick positions, z fastest.
    pub(super) fn block(&self, base: Coord, dims: [usize; 3]) -> Vec<Source> {
        let mut block = vec![Source::BACKGROUND; dims[0] * dims[1] * dims[2]];
        let last = |axis: usize| base[axis] + dims[axis] as i32 - 1;
        let group_bits = GROUP_LOG2 - 3;
        let at = |c: Coord| {
            let local = [0, 1, 2].map(|axis| i64::from(c[axis]) - i64::from(base[axis]));
            let inside = (0..3).all(|axis| local[axis] >= 0 && local[axis] < dims[axis] as i64);
            inside.then(|| {
                (local[0] as usize * dims[1] + local[1] as usize) * dims[2] + local[2] as usize
            })
        };
        for gx in base[0] >> group_bits..=last(0) >> group_bits {
            for gy in base[1] >> group_bits..=last(1) >> group_bits {
                for gz in base[2] >> group_bits..=last(2) >> group_bits {
                    let group = [gx, gy, gz];
                    let fill = self.tile_over(GROUP_LOG2, group);
                    if fill != Source::BACKGROUND {
                        let low = |axis: usize| (group[axis] << group_bits).max(base[axis]);
                        let high = |axis: usize| {
                            ((group[axis] << group_bits) + (1 << group_bits) - 1).min(last(axis))
                        };
                        for x in low(0)..=high(0) {
                            for y in low(1)..=high(1) {
                                for z in low(2)..=high(2) {
                                    if let Some(i) = at([x, y, z]) {
                                        block[i] = fill;
                                    }
                                }
                            }
                        }
                    }
                    for &(position, source) in self.groups.get(&group).into_iter().flatten() {
                        if let Some(i) = at(position) {
                            block[i] = source;
                        }
                    }
                }
            }
        }
        block
    }
}
