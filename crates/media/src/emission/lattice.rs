//! What a field emits, on a coarse lattice: the basis of aiming at it.

use super::cells::Cells;
use glam::{DAffine3, DVec3};

/// Cells along the longest side of the lattice, at most.
const ACROSS: i64 = 16;

/// Cubes of index space with their share of the power, over the box of all that may emit.
#[derive(Debug, Clone, Default)]
pub(super) struct Lattice {
    /// Lowest corner, index space.
    origin: DVec3,
    /// Edge of a cell, index units.
    edge: f64,
    /// Cells along each axis.
    size: [usize; 3],
    /// Share of the power, z fastest; positive where there may be emission, of sum one.
    power: Vec<f32>,
}

impl Lattice {
    pub(super) fn new(cells: &Cells) -> Lattice {
        let (mut low, mut high) = ([i64::MAX; 3], [i64::MIN; 3]);
        let mut extend = |origin: [i64; 3], edge: i64| {
            for axis in 0..3 {
                low[axis] = low[axis].min(origin[axis]);
                high[axis] = high[axis].max(origin[axis] + edge);
            }
        };
        for brick in &cells.bricks {
            for_weights(&brick.weights[..], brick.cube.origin, |origin, _| extend(origin, 1));
        }
        for block in &cells.blocks {
            extend(block.cube.origin.map(i64::from), 1 << block.cube.log2);
        }
        let longest = (0..3).map(|axis| high[axis].saturating_sub(low[axis])).max().unwrap_or(0);
        if longest <= 0 {
            return Lattice::default();
        }
        let edge = (longest + ACROSS - 1) / ACROSS;
        let size = [0, 1, 2].map(|axis| ((high[axis] - low[axis] + edge - 1) / edge) as usize);
        let mut power = vec![0.0f64; size.iter().product()];
        let index = |cell: [i64; 3]| {
            let [x, y, z] = cell.map(|c| c as usize);
            (x * size[1] + y) * size[2] + z
        };
        for brick in &cells.bricks {
            for_weights(&brick.weights[..], brick.cube.origin, |origin, weight| {
                let cell = [0, 1, 2].map(|axis| (origin[axis] - low[axis]) / edge);
                power[index(cell)] += f64::from(weight);
            });
        }
        for block in &cells.blocks {
            // Its share of a cell is that of its volume.
            let (start, side) = (block.cube.origin.map(i64::from), 1i64 << block.cube.log2);
            let start = [0, 1, 2].map(|axis| start[axis] - low[axis]);
            let parts = |axis: usize| {
                let (from, to) = (start[axis], start[axis] + side);
                (from / edge..=(to - 1) / edge).map(move |cell| {
                    let inside = to.min((cell + 1) * edge) - from.max(cell * edge);
                    (cell, inside as f64 / side as f64)
                })
            };
            for (x, of_x) in parts(0) {
                for (y, of_y) in parts(1) {
                    for (z, of_z) in parts(2) {
                        power[index([x, y, z])] += block.weight * of_x * of_y * of_z;
                    }
                }
            }
        }
        let total: f64 = power.iter().sum();
        let share = |power: f64| {
            if power > 0.0 { ((power / total) as f32).max(f32::MIN_POSITIVE) } else { 0.0 }
        };
        Lattice {
            origin: DVec3::from_array(low.map(|c| c as f64)),
            edge: edge as f64,
            size,
            power: power.into_iter().map(share).collect(),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.power.is_empty()
    }

    pub(super) fn size(&self) -> [usize; 3] {
        self.size
    }

    pub(super) fn power(&self) -> &[f32] {
        &self.power
    }

    pub(super) fn bytes(&self) -> u64 {
        (self.power.len() * size_of::<f32>()) as u64
    }

    /// From lattice coordinates, in which cells are unit cubes, to index space.
    pub(super) fn to_index(&self) -> DAffine3 {
        DAffine3::from_translation(self.origin) * DAffine3::from_scale(DVec3::splat(self.edge))
    }
}

/// Visits the cells of a brick that may emit: origin and weight.
fn for_weights(weights: &[f32], origin: [i32; 3], mut visit: impl FnMut([i64; 3], f32)) {
    for (i, weight) in weights.iter().enumerate() {
        if *weight > 0.0 {
            let at = [i >> 6, i >> 3 & 7, i & 7];
            visit([0, 1, 2].map(|axis| i64::from(origin[axis]) + at[axis] as i64), *weight);
        }
    }
}
