//! Points of a volume in proportion to what they emit.

use super::cells::{Cells, Cube};
use glam::DVec3;
use pileus_vdb::LEAF_VALUES;
use std::collections::HashMap;

/// Weights of a brick's cells are whole numbers that add up to about this, so that a cell is drawn with exactly the probability that is told.
const WEIGHTS: f64 = 16_777_216.0;

/// Cubes by emitted power, bricks among them with the power of each cell.
#[derive(Debug, Clone, Default)]
pub(super) struct Regions {
    /// Bricks first, then blocks.
    cubes: Vec<Cube>,
    /// Probability of all cubes up to and with each.
    cumulative: Vec<f64>,
    /// Weights of all cells up to and with each, within a brick.
    cells: Vec<[u32; LEAF_VALUES]>,
    by_cube: HashMap<Cube, u32>,
    /// Sizes that occur, as powers of two.
    sizes: Vec<u32>,
}

/// A point in index space and its density there, per unit of index volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drawn {
    pub(super) p_index: DVec3,
    pub(super) pdf: f64,
}

impl Regions {
    pub(super) fn new(cells: &Cells) -> Regions {
        let mut regions = Regions::default();
        let mut weights = Vec::new();
        for brick in &cells.bricks {
            regions.cubes.push(brick.cube);
            let sum: f64 = brick.weights.iter().copied().map(f64::from).sum();
            weights.push(sum);
            let mut total = 0u32;
            regions.cells.push(std::array::from_fn(|i| {
                // Rounded up: what may emit can be drawn.
                total += (f64::from(brick.weights[i]) * (WEIGHTS / sum)).ceil() as u32;
                total
            }));
        }
        for block in &cells.blocks {
            regions.cubes.push(block.cube);
            weights.push(block.weight);
        }
        let total: f64 = weights.iter().sum();
        let mut sum = 0.0;
        for weight in &weights {
            sum += weight;
            regions.cumulative.push(sum / total);
        }
        if let Some(last) = regions.cumulative.last_mut() {
            *last = 1.0;
        }
        for (i, cube) in regions.cubes.iter().enumerate() {
            regions.by_cube.insert(*cube, i as u32);
            if !regions.sizes.contains(&cube.log2) {
                regions.sizes.push(cube.log2);
            }
        }
        regions
    }

    pub(super) fn is_empty(&self) -> bool {
        self.cubes.is_empty()
    }

    pub(super) fn bytes(&self) -> u64 {
        let cubes =
            self.cubes.len() * (2 * size_of::<Cube>() + size_of::<f64>() + size_of::<u32>());
        (cubes + self.cells.len() * size_of::<[u32; LEAF_VALUES]>()) as u64
    }

    fn probability(&self, region: usize) -> f64 {
        let before = region.checked_sub(1).map_or(0.0, |i| self.cumulative[i]);
        self.cumulative[region] - before
    }

    /// Weight of a brick's cell and of the cells before it.
    fn cell(cells: &[u32; LEAF_VALUES], cell: usize) -> (u32, u32) {
        let before = cell.checked_sub(1).map_or(0, |i| cells[i]);
        (cells[cell] - before, before)
    }

    /// Density of a cell of a brick or of a block, per unit of index volume.
    fn density(&self, region: usize, cell: usize) -> f64 {
        let probability = self.probability(region);
        match self.cells.get(region) {
            Some(cells) => {
                let share =
                    f64::from(Self::cell(cells, cell).0) / f64::from(cells[LEAF_VALUES - 1]);
                probability * share
            }
            None => probability / self.cubes[region].edge().powi(3),
        }
    }

    /// A point from four canonical numbers; `None` if nothing emits.
    ///
    /// The first two make one number of 48 bits, which selects cube and cell and then, stretched, the place along x: two alone would be too coarse for large grids.
    pub(super) fn sample(&self, u: [f32; 4]) -> Option<Drawn> {
        let u = u.map(f64::from);
        let x = (u[0] + u[1] / WEIGHTS).min(1.0 - f64::EPSILON);
        let region =
            self.cumulative.partition_point(|c| *c <= x).min(self.cubes.len().checked_sub(1)?);
        let before = region.checked_sub(1).map_or(0.0, |i| self.cumulative[i]);
        let rest = ((x - before) / self.probability(region)).clamp(0.0, 1.0 - f64::EPSILON);
        let cube = self.cubes[region];
        let (corner, cell, place, edge) = match self.cells.get(region) {
            Some(cells) => {
                let target = rest * f64::from(cells[LEAF_VALUES - 1]);
                let cell = cells.partition_point(|c| f64::from(*c) <= target).min(LEAF_VALUES - 1);
                let (weight, before) = Self::cell(cells, cell);
                let corner = [cell >> 6, cell >> 3 & 7, cell & 7].map(|c| c as f64);
                let place = (target - f64::from(before)) / f64::from(weight.max(1));
                (DVec3::from_array(corner), cell, place, 1.0)
            }
            None => (DVec3::ZERO, 0, rest, cube.edge()),
        };
        let place = DVec3::new(place.clamp(0.0, 1.0 - f64::EPSILON), u[2], u[3]);
        let p_index = cube.low() + corner + edge * place;
        Some(Drawn { p_index, pdf: self.density(region, cell) })
    }

    /// Density of [`sample`](Regions::sample) at a point of index space.
    pub(super) fn pdf(&self, p_index: DVec3) -> f64 {
        let floor = p_index.floor();
        // Casts saturate, and nothing emits there; NaN must not pass for the origin.
        if !floor.is_finite() {
            return 0.0;
        }
        let ijk = floor.to_array().map(|c| c as i32);
        for log2 in &self.sizes {
            let origin = ijk.map(|c| c >> log2 << log2);
            if let Some(region) = self.by_cube.get(&Cube { origin, log2: *log2 }) {
                let [x, y, z] = ijk.map(|c| (c & 7) as usize);
                return self.density(*region as usize, x << 6 | y << 3 | z);
            }
        }
        0.0
    }
}
