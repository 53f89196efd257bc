//! Bounds of what interpolation can return, for every cell of 4, 8, 16, ... voxels.

use super::topology::{NODE_ENTRIES, NODE_LEVEL_OFFSETS, NODE_LOG2, RootLevel};
use super::{BRICK_EDGE, BRICK_VALUES, Entry, Interpolation, Topology, Voxel};
use rayon::prelude::*;

/// Widens a range by what rounding in the interpolation can add: a few units in the last place. Constant ranges stay as they are,
/// since interpolation between equal values is exact.
fn widen(min: f32, max: f32) -> (f32, f32) {
    const MARGIN: f32 = 1.0 / 2_097_152.0;
    if min == max { (min, max) } else { (min * (1.0 - MARGIN), max * (1.0 + MARGIN)) }
}

/// Smallest and largest value in each 4^3 cell of each brick, over the interpolation's stencil.
pub(super) fn sub_cell_ranges<V: Voxel>(
    voxels: &[V],
    interpolation: Interpolation,
) -> (Vec<[f32; 8]>, Vec<[f32; 8]>) {
    let reach = match interpolation {
        Interpolation::Nearest => 4,
        Interpolation::Trilinear => 5,
    };
    voxels
        .par_chunks_exact(BRICK_VALUES)
        .map(|brick| {
            let mut low = [0.0f32; 8];
            let mut high = [0.0f32; 8];
            for cell in 0..8 {
                let [x0, y0, z0] = [cell >> 2 & 1, cell >> 1 & 1, cell & 1].map(|bit| bit * 4);
                let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
                for x in x0..x0 + reach {
                    for y in y0..y0 + reach {
                        let row = (x * BRICK_EDGE + y) * BRICK_EDGE + z0;
                        for v in &brick[row..row + reach] {
                            let v = v.to_f32();
                            min = min.min(v);
                            max = max.max(v);
                        }
                    }
                }
                (low[cell], high[cell]) = widen(min, max);
            }
            (low, high)
        })
        .unzip()
}

/// Range of the union of ranges.
fn union(ranges: impl Iterator<Item = (f32, f32)>) -> (f32, f32) {
    ranges.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), (min, max)| (a.min(min), b.max(max)))
}

/// Fills the ranges of all entries from those of the bricks: tables in `order` (children before parents), then the root.
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
                entries[i] = Entry { child: 0, max };
                entry_min[i] = min;
            }
        }
    }
}
