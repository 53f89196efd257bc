//! Directions towards a field of emission, by what is seen from a point.
//!
//! A point of the field is drawn, uniform in a cell of a coarse lattice, and its direction taken.
//! What the direction is worth is then a matter of the whole line: the density of the direction is
//! that of all points on it, `INT q(t) t^2 dt` for a density `q` per volume, which is a sum over
//! the cells on the line. Cells are drawn by what they emit and let out towards the point: the
//! optical depth to the outside is tabulated along the 26 directions to the neighbours of a cell.

use super::field::EmissionField;
use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;
use pileus_math::elementary::exp;
use rayon::prelude::*;

/// Blocks of cells along an axis, at most: what a choice looks at first.
const BLOCKS_ACROSS: usize = 4;
const BLOCKS: usize = BLOCKS_ACROSS * BLOCKS_ACROSS * BLOCKS_ACROSS;

/// Directions to the neighbours of a cell, and one class for points that are within the cells.
const CLASSES: usize = 27;
const AMID: usize = 13;

/// No block: nothing emits in a cell.
const NOTHING: u8 = u8::MAX;

/// The tangent of half the angle between two of eight directions in a plane.
const TAN_EIGHTH: f32 = 0.414_213_57;

/// Samples directions towards a field. Immutable.
#[derive(Debug, Clone)]
pub struct EmissionDirections {
    lattice_to_world: DAffine3,
    world_to_lattice: DAffine3,
    /// Volume of a cell in the world.
    cell_volume: f64,
    size: [usize; 3],
    blocks: Vec<Block>,
    /// Block of every cell, or [`NOTHING`]; z fastest.
    block_of: Vec<u8>,
    /// What every cell lets out, one array of all cells per class.
    weights: Vec<f32>,
    /// Cells in the order of blocks.
    cells: Vec<u32>,
    /// Weights of all cells of a block up to and with each, one array of `cells` per class.
    cumulative: Vec<f32>,
}

/// A cube of cells.
#[derive(Debug, Clone)]
struct Block {
    /// Where its power is, in the world and on the lattice.
    centre: DVec3,
    centre_lattice: DVec3,
    /// Mean square of the distance of its power from there, world.
    spread2: f32,
    /// What it lets out, by class.
    weights: [f32; CLASSES],
    /// Range of the list of cells that belong to it.
    cells: std::ops::Range<usize>,
}

/// How a point sees a field: what directions are drawn by.
#[derive(Debug, Clone)]
pub struct EmissionView {
    p: DVec3,
    /// Class, and factor on the weights of its cells, of every block.
    class: [u8; BLOCKS],
    factor: [f32; BLOCKS],
    /// Sum of the weights of all cells.
    total: f32,
}

impl EmissionView {
    /// Whether anything is seen: else there are no directions.
    pub fn sees(&self) -> bool {
        self.total > 0.0 && self.total.is_finite()
    }
}

/// Class of a direction on the lattice: the neighbour nearest to it.
#[inline(always)]
fn class(v: Vec3) -> usize {
    let least = TAN_EIGHTH * v.abs().max_element();
    let step = |c: f32| if c > least { 2 } else { usize::from(c >= -least) };
    9 * step(v.x) + 3 * step(v.y) + step(v.z)
}

/// The neighbour that a class stands for.
fn neighbour(class: usize) -> [i32; 3] {
    [class / 9, class / 3 % 3, class % 3].map(|c| c as i32 - 1)
}

impl EmissionDirections {
    /// Tables for a field in media of extinction `sigma_t` (1/length, at a point in the world);
    /// `None` if nothing emits. Extinction is looked up at eight points of every cell of the
    /// lattice and of a quarter more on every side; what it is changes noise alone.
    pub fn new(
        field: &EmissionField,
        sigma_t: impl Fn(DVec3) -> f64 + Sync,
    ) -> Option<EmissionDirections> {
        let lattice = field.lattice();
        if lattice.is_empty() {
            return None;
        }
        let size = lattice.size();
        let lattice_to_world = field.index_to_world() * lattice.to_index();
        let depth = Depths::new(size, &lattice_to_world, sigma_t);
        let power = lattice.power();
        let weights: Vec<f32> = (0..CLASSES)
            .into_par_iter()
            .flat_map_iter(|class| {
                let let_out = depth.let_out(class);
                power.iter().zip(let_out).map(|(power, let_out)| power * let_out)
            })
            .collect();
        let mut directions = EmissionDirections {
            lattice_to_world,
            world_to_lattice: lattice_to_world.inverse(),
            cell_volume: lattice_to_world.matrix3.determinant().abs(),
            size,
            blocks: Vec::new(),
            block_of: vec![NOTHING; power.len()],
            weights,
            cells: Vec::new(),
            cumulative: Vec::new(),
        };
        directions.gather(power);
        Some(directions)
    }

    /// Blocks, their cells and sums.
    fn gather(&mut self, power: &[f32]) {
        let edge = self.size.map(|n| n.div_ceil(BLOCKS_ACROSS));
        let mut in_blocks = vec![Vec::new(); BLOCKS];
        for (cell, power) in power.iter().enumerate() {
            if *power > 0.0 {
                let [x, y, z] = self.position(cell);
                let [x, y, z] = [x / edge[0], y / edge[1], z / edge[2]];
                in_blocks[(x * BLOCKS_ACROSS + y) * BLOCKS_ACROSS + z].push(cell);
            }
        }
        for cells in in_blocks.into_iter().filter(|cells| !cells.is_empty()) {
            let middle =
                |cell: usize| DVec3::from_array(self.position(cell).map(|c| c as f64 + 0.5));
            let share = |cell: usize| f64::from(power[cell]);
            let total: f64 = cells.iter().map(|cell| share(*cell)).sum();
            let centre_lattice =
                cells.iter().map(|cell| middle(*cell) * share(*cell)).sum::<DVec3>() / total;
            let m = self.lattice_to_world.matrix3;
            // A cube of edge one has a twelfth along each axis.
            let own = [m.x_axis, m.y_axis, m.z_axis].map(|axis| axis.length_squared() / 12.0);
            let off = cells
                .iter()
                .map(|cell| (m * (middle(*cell) - centre_lattice)).length_squared() * share(*cell))
                .sum::<f64>();
            let start = self.cells.len();
            let all = self.block_of.len();
            let weights = std::array::from_fn(|class| {
                cells.iter().map(|cell| self.weights[class * all + cell]).sum()
            });
            for cell in &cells {
                self.block_of[*cell] = self.blocks.len() as u8;
            }
            self.cells.extend(cells.iter().map(|cell| *cell as u32));
            self.blocks.push(Block {
                centre: self.lattice_to_world.transform_point3(centre_lattice),
                centre_lattice,
                spread2: (off / total + own.iter().sum::<f64>()) as f32,
                weights,
                cells: start..self.cells.len(),
            });
        }
        for class in 0..CLASSES {
            let weights = &self.weights[class * self.block_of.len()..];
            for block in &self.blocks {
                let mut sum = 0.0;
                for cell in &self.cells[block.cells.clone()] {
                    sum += weights[*cell as usize];
                    self.cumulative.push(sum);
                }
            }
        }
    }

    /// Where a cell is on the lattice.
    fn position(&self, cell: usize) -> [usize; 3] {
        let [_, y, z] = self.size;
        [cell / (y * z), cell / z % y, cell % z]
    }

    /// How `p` sees the field. A function of `p` alone.
    pub fn view(&self, p: DVec3) -> EmissionView {
        let mut view = EmissionView { p, class: [0; BLOCKS], factor: [0.0; BLOCKS], total: 0.0 };
        let p_lattice = self.world_to_lattice.transform_point3(p);
        for (i, block) in self.blocks.iter().enumerate() {
            let distance2 = (p - block.centre).as_vec3().length_squared();
            let class = if distance2 > block.spread2 {
                class((p_lattice - block.centre_lattice).as_vec3())
            } else {
                AMID
            };
            // The mean square of the distance.
            let factor = 1.0 / (distance2 + block.spread2);
            view.class[i] = class as u8;
            view.factor[i] = factor;
            view.total += factor * block.weights[class];
        }
        view
    }

    /// A direction from the view's point towards the field; `None` if it sees nothing.
    ///
    /// The first two numbers make one of 48 bits, which selects block and cell and then, stretched,
    /// the place along x.
    pub fn sample(&self, view: &EmissionView, u: [f32; 4]) -> Option<Vec3> {
        let u = u.map(f64::from);
        let mut x = (u[0] + u[1] / 16_777_216.0) * f64::from(view.total);
        let mut found = None;
        for (i, block) in self.blocks.iter().enumerate() {
            let weight = f64::from(view.factor[i] * block.weights[usize::from(view.class[i])]);
            if weight > 0.0 {
                found = Some((i, x, weight));
                if x < weight {
                    break;
                }
                x -= weight;
            }
        }
        let (i, x, weight) = found?;
        let (block, class) = (&self.blocks[i], usize::from(view.class[i]));
        let start = class * self.cells.len();
        let cumulative = &self.cumulative[start + block.cells.start..start + block.cells.end];
        let total = f64::from(*cumulative.last()?);
        let target = (x / weight).clamp(0.0, 1.0 - f64::EPSILON) * total;
        let place = cumulative.partition_point(|sum| f64::from(*sum) <= target);
        let place = place.min(cumulative.len() - 1);
        let before = place.checked_sub(1).map_or(0.0, |i| f64::from(cumulative[i]));
        let rest = (target - before) / (f64::from(cumulative[place]) - before);
        let corner = self.position(self.cells[block.cells.start + place] as usize);
        let within = DVec3::new(rest.clamp(0.0, 1.0), u[2], u[3]);
        let corner = DVec3::from_array(corner.map(|c| c as f64));
        let to = self.lattice_to_world.transform_point3(corner + within) - view.p;
        let wi = to.normalize_or_zero().as_vec3();
        // Also refuses NaN, of a view that is none.
        (wi.length_squared() > 0.5).then_some(wi)
    }

    /// Density of [`sample`](EmissionDirections::sample) in a direction, 1/sr. Exact but for
    /// rounding.
    pub fn pdf(&self, view: &EmissionView, wi: Vec3) -> f32 {
        let o = self.world_to_lattice.transform_point3(view.p);
        let d = self.world_to_lattice.transform_vector3(wi.as_dvec3());
        let inverse = d.recip();
        let lattice = Bounds3::new(DVec3::ZERO, DVec3::from_array(self.size.map(|n| n as f64)));
        let Some((mut t, t_end)) = lattice.clip(o, d, 0.0, f64::INFINITY) else { return 0.0 };
        if !(t_end.is_finite() && view.total > 0.0) {
            return 0.0;
        }
        let start = o + d * t;
        let [ny, nz] = [self.size[1], self.size[2]];
        let stride = [ny * nz, nz, 1];
        let (mut cell, mut index) = ([0usize; 3], 0);
        let mut next = [f64::INFINITY; 3];
        for axis in 0..3 {
            // Casts saturate.
            cell[axis] = (start[axis] as usize).min(self.size[axis] - 1);
            index += cell[axis] * stride[axis];
            if d[axis] != 0.0 {
                let face = cell[axis] + usize::from(d[axis] > 0.0);
                next[axis] = (face as f64 - o[axis]) * inverse[axis];
            }
        }
        let step = inverse.abs().to_array();
        let all = self.block_of.len();
        let mut sum = 0.0f64;
        loop {
            let axis = if next[0] < next[1] {
                if next[0] < next[2] { 0 } else { 2 }
            } else if next[1] < next[2] {
                1
            } else {
                2
            };
            let end = next[axis].clamp(t, t_end);
            let block = self.block_of[index];
            if block != NOTHING {
                let class = usize::from(view.class[usize::from(block)]);
                let weight = view.factor[usize::from(block)] * self.weights[class * all + index];
                // The difference of cubes.
                sum += f64::from(weight) * (end - t) * (end * end + end * t + t * t);
            }
            t = end;
            next[axis] += step[axis];
            if d[axis] > 0.0 {
                cell[axis] += 1;
                if cell[axis] >= self.size[axis] {
                    break;
                }
                index += stride[axis];
            } else {
                if cell[axis] == 0 {
                    break;
                }
                cell[axis] -= 1;
                index -= stride[axis];
            }
        }
        (sum / (3.0 * self.cell_volume * f64::from(view.total))) as f32
    }

    /// Bytes that the tables take.
    pub fn bytes(&self) -> u64 {
        let floats = self.weights.len() + self.cumulative.len() + self.cells.len();
        (4 * floats + self.block_of.len() + self.blocks.len() * size_of::<Block>()) as u64
    }
}

/// Extinction on the lattice and around it.
struct Depths {
    /// Cells of the lattice, and that many more on every side.
    size: [usize; 3],
    margin: [usize; 3],
    /// Mean extinction of every cell with those around, 1/length.
    sigma_t: Vec<f32>,
    /// Length of the step to the neighbour of each class, world.
    steps: [f32; CLASSES],
}

impl Depths {
    fn new(
        size: [usize; 3],
        lattice_to_world: &DAffine3,
        sigma_t: impl Fn(DVec3) -> f64 + Sync,
    ) -> Depths {
        let most = size.into_iter().max().unwrap_or(0);
        let margin = [most.div_ceil(4); 3];
        let around = [0, 1, 2].map(|axis| size[axis] + 2 * margin[axis]);
        let sigma_t = (0..around.iter().product::<usize>())
            .into_par_iter()
            .map(|i| {
                let at = [i / (around[1] * around[2]), i / around[2] % around[1], i % around[2]];
                let corner = [0, 1, 2].map(|axis| at[axis] as f64 - margin[axis] as f64);
                let mut sum = 0.0;
                for part in 0..8 {
                    let part = [part >> 2 & 1, part >> 1 & 1, part & 1].map(|i| [0.25, 0.75][i]);
                    let p = DVec3::from_array(corner) + DVec3::from_array(part);
                    sum += sigma_t(lattice_to_world.transform_point3(p));
                }
                (sum / 8.0) as f32
            })
            .collect();
        let step = |class| {
            let along = DVec3::from_array(neighbour(class).map(f64::from));
            lattice_to_world.transform_vector3(along).length() as f32
        };
        Depths { size, margin, sigma_t, steps: std::array::from_fn(step) }
    }

    /// What each cell of the lattice lets out of its light towards a neighbour and on: the mean
    /// transmittance within it, by that of everything beyond. Amid the cells nothing but the first
    /// is known.
    fn let_out(&self, class: usize) -> Vec<f32> {
        let around = [0, 1, 2].map(|axis| self.size[axis] + 2 * self.margin[axis]);
        let index = |at: [usize; 3]| (at[0] * around[1] + at[1]) * around[2] + at[2];
        let along = neighbour(class);
        let within = if class == AMID { self.steps[AMID + 1] } else { self.steps[class] };
        let mut beyond = vec![0.0f32; self.sigma_t.len()];
        if class != AMID {
            // A cell's neighbour comes before it.
            let order = |axis: usize, i: usize| {
                if along[axis] > 0 { around[axis] - 1 - i } else { i }
            };
            for x in 0..around[0] {
                for y in 0..around[1] {
                    for z in 0..around[2] {
                        let at = [order(0, x), order(1, y), order(2, z)];
                        let next: [i64; 3] =
                            [0, 1, 2].map(|axis| at[axis] as i64 + i64::from(along[axis]));
                        if (0..3).all(|axis| next[axis] >= 0 && next[axis] < around[axis] as i64) {
                            let next = index(next.map(|c| c as usize));
                            beyond[index(at)] =
                                beyond[next] + self.sigma_t[next] * self.steps[class];
                        }
                    }
                }
            }
        }
        let mut let_out = Vec::with_capacity(self.size.iter().product());
        for x in 0..self.size[0] {
            for y in 0..self.size[1] {
                for z in 0..self.size[2] {
                    let [mx, my, mz] = self.margin;
                    let i = index([x + mx, y + my, z + mz]);
                    let own = self.sigma_t[i] * within;
                    let mean = if own > 1e-3 { (1.0 - exp(-own)) / own } else { 1.0 };
                    let_out.push(mean * exp(-beyond[i]));
                }
            }
        }
        let_out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smoke of one extinction: the closed form of what a slab of cells lets out, towards a face
    /// and along a diagonal.
    #[test]
    fn what_is_let_out_is_the_closed_form() {
        let edge = 0.5f64;
        let to_world = DAffine3::from_scale(DVec3::splat(edge));
        let depths = Depths::new([4, 5, 6], &to_world, |_| 0.8);
        assert_eq!(depths.margin, [2; 3]);
        for (class, length) in [(22, 1.0f32), (4, 1.0), (26, 3f32.sqrt()), (AMID, 1.0)] {
            let own = 0.8 * 0.5 * length;
            let mean = (1.0 - (-own).exp()) / own;
            for (i, let_out) in depths.let_out(class).into_iter().enumerate() {
                let at = [i / 30, i / 6 % 5, i % 6];
                // Cells to the end of the table.
                let beyond = match class {
                    22 => 5 - at[0],
                    4 => at[0] + 2,
                    26 => (5 - at[0]).min(6 - at[1]).min(7 - at[2]),
                    _ => 0,
                };
                let exact = mean * (-own * beyond as f32).exp();
                assert!((let_out / exact - 1.0).abs() < 1e-5, "{class} {at:?}: {let_out} {exact}");
            }
        }
    }

    #[test]
    fn classes_are_the_nearest_neighbours() {
        for class_of in (0..CLASSES).filter(|class| *class != AMID) {
            let v = Vec3::from_array(neighbour(class_of).map(|c| c as f32));
            assert_eq!(class(3.0 * v), class_of);
            assert_eq!(class(v + Vec3::new(0.1, -0.2, 0.15)), class_of);
        }
    }
}
