//! From which extinction on a cell is better entered by its parts: the cost model, solved bottom-up
//! for all scales at once.
//!
//! Seen as a function of the scale, what splitting a cell (and its parts in turn where that pays)
//! saves is convex and negative at zero: there is one scale above which it pays. That scale is
//! stored with the cell, so that a change of look rebuilds nothing.

use super::topology::{NODE_ENTRIES, NODE_LEVEL_OFFSETS, NODE_LOG2, RootLevel};
use super::{BRICK_LOG2, Entry, Topology};
use crate::majorant::leaf_cost;
use rayon::prelude::*;

/// Scales at which the model is evaluated: majorants per voxel of 4^(k - 7) under the grid's
/// largest value. Between them it is interpolated.
const SCALES: usize = 12;
/// Cost of a cell at all scales.
type Cost = [f32; SCALES];

const FINEST_LOG2: u32 = 2;

fn scale(k: usize) -> f32 {
    f32::from_bits((127 + 2 * k as u32 - 14) << 23)
}

struct Model {
    /// One over the grid's largest value.
    inv_max: f32,
}

impl Model {
    fn leaf(&self, log2: u32, max: f32) -> Cost {
        let size = [f32::from_bits((127 + log2) << 23); 3];
        std::array::from_fn(|k| leaf_cost(size, max * self.inv_max * scale(k)))
    }

    /// The lesser of leaf and parts at every scale, and the scale (majorant per voxel over raw
    /// bound) above which parts are less.
    fn decide(&self, log2: u32, max: f32, parts: &Cost) -> (Cost, f32) {
        let leaf = self.leaf(log2, max);
        let size = [f32::from_bits((127 + log2) << 23); 3];
        // Eight parts have twice the surface; at scale zero nothing else counts.
        let (mut x, mut saved) = (0.0f32, -leaf_cost(size, 0.0));
        let mut above = f32::INFINITY;
        for k in 0..SCALES {
            let next = leaf[k] - parts[k];
            if next > 0.0 {
                above = x + (scale(k) - x) * (-saved / (next - saved));
                break;
            }
            if k + 1 == SCALES && next > saved {
                above = x + (scale(k) - x) * (-saved / (next - saved));
            }
            (x, saved) = (scale(k), next);
        }
        (std::array::from_fn(|k| leaf[k].min(parts[k])), above * self.inv_max)
    }
}

fn add(sum: &mut Cost, part: &Cost) {
    for (sum, part) in sum.iter_mut().zip(part) {
        *sum += part;
    }
}

/// Fills `split_above` of all entries; `tables`: index and log2 size of the children of every table
/// below the root.
pub(super) fn fill_splits(
    topology: &Topology,
    entries: &mut [Entry],
    tables: &[(u32, u32)],
    sub_max: &[[f32; 8]],
    largest: f32,
) {
    for entry in entries.iter_mut() {
        entry.split_above = f32::INFINITY;
    }
    if !(largest > 0.0) {
        return;
    }
    let model = Model { inv_max: 1.0 / largest };
    let bricks = |entries: &mut [Entry]| -> Vec<Cost> {
        entries
            .par_iter_mut()
            .with_min_len(256)
            .map(|entry| {
                if entry.max == 0.0 {
                    return model.leaf(BRICK_LOG2, 0.0);
                }
                // The costs of leaves of one size differ by their bounds alone.
                let sum: f32 = sub_max[entry.child as usize].iter().sum();
                let parts = model.leaf(FINEST_LOG2, 0.125 * sum).map(|cost| 8.0 * cost);
                let (cost, above) = model.decide(BRICK_LOG2, entry.max, &parts);
                entry.split_above = above;
                cost
            })
            .collect()
    };
    let mut order: Vec<(u32, u32)> = tables.to_vec();
    order.sort_by_key(|&(index, log2)| (log2, index));
    // What a table holds, in all.
    let mut table_cost: Vec<Cost> = vec![[0.0; SCALES]; tables.len()];
    let over_tables = |entries: &mut [Entry], table_cost: &[Cost], log2: u32| -> Vec<Cost> {
        entries
            .iter_mut()
            .map(|entry| {
                let parts = &table_cost[entry.child as usize];
                let (cost, above) = model.decide(log2, entry.max, parts);
                entry.split_above = above;
                cost
            })
            .collect()
    };
    for &(index, log2) in &order {
        let base = topology.root_entries + index as usize * NODE_ENTRIES;
        let own = &mut entries[base..base + NODE_ENTRIES];
        let mut fine = RootLevel { offset: 0, dims: [1 << NODE_LOG2; 3] };
        let children = &mut own[..NODE_LEVEL_OFFSETS[1]];
        let mut cost = if log2 == BRICK_LOG2 {
            bricks(children)
        } else {
            over_tables(children, &table_cost, log2)
        };
        for level in 1..NODE_LEVEL_OFFSETS.len() {
            let n = 1i32 << (NODE_LOG2 as usize - level);
            let coarse = RootLevel { offset: NODE_LEVEL_OFFSETS[level], dims: [n; 3] };
            cost = merge(&model, own, &cost, fine, coarse, log2 + level as u32);
            fine = coarse;
        }
        for part in &cost {
            add(&mut table_cost[index as usize], part);
        }
    }
    let root = topology.levels[0];
    let cells = root.dims.iter().map(|&n| n as usize).product::<usize>();
    let base = &mut entries[..cells];
    let mut cost = if topology.root_log2 == BRICK_LOG2 {
        bricks(base)
    } else {
        over_tables(base, &table_cost, topology.root_log2)
    };
    for (k, pair) in topology.levels.windows(2).enumerate() {
        let log2 = topology.root_log2 + k as u32 + 1;
        cost = merge(&model, entries, &cost, pair[0], pair[1], log2);
    }
    close(topology, entries, &order);
}

fn children([x, y, z]: [i32; 3], fine: RootLevel) -> impl Iterator<Item = [i32; 3]> {
    (0..8)
        .map(move |c| [2 * x + (c >> 2 & 1), 2 * y + (c >> 1 & 1), 2 * z + (c & 1)])
        .filter(move |at| (0..3).all(|axis| at[axis] < fine.dims[axis]))
}

fn cells_of(level: RootLevel) -> impl Iterator<Item = [i32; 3]> {
    let [nx, ny, nz] = level.dims;
    (0..nx).flat_map(move |x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])))
}

/// Decides for a level, of cells of `2^log2` voxels, from the costs of the next finer one.
fn merge(
    model: &Model,
    entries: &mut [Entry],
    fine_cost: &[Cost],
    fine: RootLevel,
    coarse: RootLevel,
    log2: u32,
) -> Vec<Cost> {
    let cells = coarse.dims.iter().map(|&n| n as usize).product::<usize>();
    let [_, ny, nz] = coarse.dims;
    entries[coarse.offset..coarse.offset + cells]
        .par_iter_mut()
        .with_min_len(256)
        .enumerate()
        .map(|(i, entry)| {
            if entry.max == 0.0 {
                return model.leaf(log2, 0.0);
            }
            let i = i as i32;
            let at = [i / (ny * nz), i / nz % ny, i % nz];
            let mut parts = [0.0; SCALES];
            for child in children(at, fine) {
                add(&mut parts, &fine_cost[fine.index(child) - fine.offset]);
            }
            let (cost, above) = model.decide(log2, entry.max, &parts);
            entry.split_above = above;
            cost
        })
        .collect()
}

/// Parts of a cell that is whole are whole: from the top down, so that a walk finds the largest
/// whole cell from any level.
fn close(topology: &Topology, entries: &mut [Entry], order: &[(u32, u32)]) {
    let pass_on = |entries: &mut [Entry], coarse: RootLevel, fine: RootLevel| {
        for at in cells_of(coarse) {
            let above = entries[coarse.index(at)].split_above;
            for child in children(at, fine) {
                let entry = &mut entries[fine.index(child)];
                entry.split_above = entry.split_above.max(above);
            }
        }
    };
    for pair in topology.levels.windows(2).rev() {
        pass_on(entries, pair[1], pair[0]);
    }
    // Shared tables are constant: all of them are whole at any scale, and stay so.
    let mut parent_of = vec![usize::MAX; order.len()];
    let root = topology.levels[0].dims.iter().map(|&n| n as usize).product::<usize>();
    if topology.root_log2 > BRICK_LOG2 {
        for (i, entry) in entries[..root].iter().enumerate() {
            parent_of[entry.child as usize] = i;
        }
    }
    for &(index, log2) in order.iter().rev() {
        let base = topology.root_entries + index as usize * NODE_ENTRIES;
        let level = |k: usize| RootLevel {
            offset: base + NODE_LEVEL_OFFSETS[k],
            dims: [1i32 << (NODE_LOG2 as usize - k); 3],
        };
        let last = NODE_LEVEL_OFFSETS.len() - 1;
        if let Some(above) = entries.get(parent_of[index as usize]).map(|e| e.split_above) {
            for at in cells_of(level(last)) {
                let entry = &mut entries[level(last).index(at)];
                entry.split_above = entry.split_above.max(above);
            }
        }
        for k in (0..last).rev() {
            pass_on(entries, level(k + 1), level(k));
        }
        if log2 > BRICK_LOG2 {
            for i in base..base + NODE_LEVEL_OFFSETS[1] {
                parent_of[entries[i].child as usize] = i;
            }
        }
    }
}
