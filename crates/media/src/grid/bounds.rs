//! Bounds of what interpolation can return, for every cell of 4, 8, 16, ... voxels.

use super::topology::{NODE_ENTRIES, NODE_LEVEL_OFFSETS, NODE_LOG2, RootLevel};
use super::{BRICK_EDGE, Entry, Interpolation, Topology, Voxel};

/// Widens a range by what rounding in the interpolation can add: a few units in the last place.
/// Constant ranges stay as they are, since interpolation between equal values is exact.
pub(super) fn widen(min: f32, max: f32) -> (f32, f32) {
    const MARGIN: f32 = 1.0 / 2_097_152.0;
    if min == max { (min, max) } else { (min * (1.0 - MARGIN), max * (1.0 + MARGIN)) }
}

/// Smallest and largest value in each 4^3 cell of a brick, over the interpolation's stencil.
///
/// Axis by axis: planes are joined to two of all their elements at once, then rows, then what is
/// left; in the order of [`Voxel::Key`], which vector units compare without unpacking.
pub(super) fn sub_cell_ranges<V: Voxel>(
    brick: &[V],
    interpolation: Interpolation,
) -> ([f32; 8], [f32; 8]) {
    let reach = match interpolation {
        Interpolation::Nearest => 4,
        Interpolation::Trilinear => 5,
    };
    const PLANE: usize = BRICK_EDGE * BRICK_EDGE;
    let mut low = [0.0f32; 8];
    let mut high = [0.0f32; 8];
    for x in 0..2 {
        let (mut plane_min, mut plane_max) =
            ([V::Key::default(); PLANE], [V::Key::default(); PLANE]);
        let first = &brick[4 * x * PLANE..][..PLANE];
        for ((min, max), v) in plane_min.iter_mut().zip(&mut plane_max).zip(first) {
            (*min, *max) = (v.key(), v.key());
        }
        for k in 4 * x + 1..4 * x + reach {
            let plane = &brick[k * PLANE..][..PLANE];
            for ((min, max), v) in plane_min.iter_mut().zip(&mut plane_max).zip(plane) {
                let key = v.key();
                *min = if key < *min { key } else { *min };
                *max = if key > *max { key } else { *max };
            }
        }
        for y in 0..2 {
            let row = |plane: &[V::Key; PLANE], k: usize| -> [V::Key; BRICK_EDGE] {
                std::array::from_fn(|z| plane[k * BRICK_EDGE + z])
            };
            let (mut row_min, mut row_max) = (row(&plane_min, 4 * y), row(&plane_max, 4 * y));
            for k in 4 * y + 1..4 * y + reach {
                let (mins, maxs) = (row(&plane_min, k), row(&plane_max, k));
                for z in 0..BRICK_EDGE {
                    row_min[z] = if mins[z] < row_min[z] { mins[z] } else { row_min[z] };
                    row_max[z] = if maxs[z] > row_max[z] { maxs[z] } else { row_max[z] };
                }
            }
            for z in 0..2 {
                let (mut min, mut max) = (row_min[4 * z], row_max[4 * z]);
                for k in 4 * z + 1..4 * z + reach {
                    min = if row_min[k] < min { row_min[k] } else { min };
                    max = if row_max[k] > max { row_max[k] } else { max };
                }
                let cell = x << 2 | y << 1 | z;
                (low[cell], high[cell]) = widen(V::of_key(min), V::of_key(max));
            }
        }
    }
    (low, high)
}

/// Range of the union of ranges.
fn union(ranges: impl Iterator<Item = (f32, f32)>) -> (f32, f32) {
    ranges.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), (min, max)| (a.min(min), b.max(max)))
}

/// Fills the ranges of all entries from those of the bricks: tables in `order` (children before
/// parents), then the root.
pub(super) fn fill_entry_ranges(
    topology: &Topology,
    entries: &mut [Entry],
    entry_min: &mut [f32],
    tables: &[(u32, u32)],
    sub_min: &[[f32; 8]],
    sub_max: &[[f32; 8]],
) {
    let brick_range = |child: u32| {
        let brick = child as usize;
        union(sub_min[brick].iter().copied().zip(sub_max[brick].iter().copied()))
    };
    // Tables, finest first: (index, log2 size of their children).
    let mut order: Vec<(u32, u32)> = tables.to_vec();
    order.sort_by_key(|&(index, log2)| (log2, index));
    for (index, child_log2) in order {
        let base = topology.root_entries + index as usize * NODE_ENTRIES;
        for i in base..base + NODE_LEVEL_OFFSETS[1] {
            let child = entries[i].child;
            let (min, max) = if child_log2 == super::BRICK_LOG2 {
                brick_range(child)
            } else {
                table_range(topology, entries, entry_min, child)
            };
            entries[i].max = max;
            entry_min[i] = min;
        }
        for level in 1..NODE_LEVEL_OFFSETS.len() {
            let n = 1i32 << (NODE_LOG2 as usize - level);
            let fine = RootLevel { offset: base + NODE_LEVEL_OFFSETS[level - 1], dims: [2 * n; 3] };
            let coarse = RootLevel { offset: base + NODE_LEVEL_OFFSETS[level], dims: [n; 3] };
            reduce(entries, entry_min, fine, coarse);
        }
    }
    let root = topology.levels[0];
    let cells = root.dims.iter().map(|&n| n as usize).product::<usize>();
    for i in 0..cells {
        let child = entries[i].child;
        let (min, max) = if topology.root_log2 == super::BRICK_LOG2 {
            brick_range(child)
        } else {
            table_range(topology, entries, entry_min, child)
        };
        entries[i].max = max;
        entry_min[i] = min;
    }
    for pair in topology.levels.windows(2) {
        reduce(entries, entry_min, pair[0], pair[1]);
    }
}

fn table_range(
    topology: &Topology,
    entries: &[Entry],
    entry_min: &[f32],
    table: u32,
) -> (f32, f32) {
    let last = topology.root_entries
        + table as usize * NODE_ENTRIES
        + NODE_LEVEL_OFFSETS[NODE_LEVEL_OFFSETS.len() - 1];
    union((last..last + 8).map(|i| (entry_min[i], entries[i].max)))
}

/// Fills a coarse level from the next finer one.
fn reduce(entries: &mut [Entry], entry_min: &mut [f32], fine: RootLevel, coarse: RootLevel) {
    for x in 0..coarse.dims[0] {
        for y in 0..coarse.dims[1] {
            for z in 0..coarse.dims[2] {
                let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
                for corner in 0..8 {
                    let cell = [
                        2 * x + (corner >> 2 & 1),
                        2 * y + (corner >> 1 & 1),
                        2 * z + (corner & 1),
                    ];
                    if (0..3).all(|axis| cell[axis] < fine.dims[axis]) {
                        let i = fine.index(cell);
                        min = min.min(entry_min[i]);
                        max = max.max(entries[i].max);
                    }
                }
                let i = coarse.index([x, y, z]);
                entries[i] = Entry { max, ..Entry::to(0) };
                entry_min[i] = min;
            }
        }
    }
}
