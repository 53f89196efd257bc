//! Bounds of the emission on a grid of their own: cells of one voxel where it varies, tiles where
//! it does not.
//!
//! Cell `i` of the bounds spans `[i, i + 1]` of the source's index space, whatever the transforms
//! of its grids. The descent goes from cubes around everything to cubes of 8 voxels, as far as
//! there may be light: its time and memory go with the bricks of the grids, not with the space they
//! span.

use super::source::{Bound, EmissionSource};
use crate::Error;
use crate::grid::{Interpolation, VoxelGrid, VoxelGridOptions};
use glam::{DMat3, DVec3, Vec3};
use pileus_math::{Bounds3, luminance};
use pileus_vdb::{LEAF_VALUES, Tile, Tree};
use rayon::prelude::*;
use std::collections::{BTreeSet, HashSet};

/// Sizes of constant regions as powers of two, as OpenVDB has them, and that of a brick.
const TILES: [u32; 3] = [3, 7, 12];
/// Base 2 logarithm of a brick's edge.
const BRICK: u32 = 3;

/// Least share of the bound in a cell's weight: what quadrature misses is still found.
const LEAST_WEIGHT: f32 = 1.0 / 256.0;

/// What building an emission field took.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct EmissionReport {
    /// Wall time, seconds.
    pub seconds: f64,
    /// Bricks of 8^3 cells that may emit.
    pub bricks: u64,
    /// Larger or constant cubes that may emit.
    pub tiles: u64,
    /// Bytes of bounds and of tables for sampling, beside the grids.
    pub bytes: u64,
}

/// A cube of `2^log2` cells, its origin a multiple of that.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Cube {
    pub(super) origin: [i32; 3],
    pub(super) log2: u32,
}

impl Cube {
    pub(super) fn low(self) -> DVec3 {
        DVec3::from_array(self.origin.map(f64::from))
    }

    pub(super) fn edge(self) -> f64 {
        f64::from(1u32 << self.log2)
    }

    fn volume(self) -> f64 {
        self.edge() * self.edge() * self.edge()
    }

    fn bounds(self) -> Bounds3 {
        Bounds3::new(self.low(), self.low() + self.edge())
    }

    fn children(self) -> impl Iterator<Item = Cube> {
        let half = 1i32 << (self.log2 - 1);
        (0..8).map(move |corner| {
            let step = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let origin = [0, 1, 2].map(|axis| self.origin[axis] + step[axis] * half);
            Cube { origin, log2: self.log2 - 1 }
        })
    }

    /// The cube of `2^log2` cells around it.
    fn around(self, log2: u32) -> Cube {
        Cube { origin: self.origin.map(|c| c >> log2 << log2), log2 }
    }
}

/// A brick: bounds and weights of its cells, z fastest.
pub(super) struct Brick {
    pub(super) cube: Cube,
    pub(super) bounds: Box<[f32; LEAF_VALUES]>,
    /// Luminance integrated over the cell, index units, and at least a share of the bound.
    pub(super) weights: Box<[f32; LEAF_VALUES]>,
    /// Luminance integrated over the brick, index units.
    pub(super) power: f64,
}

/// A cube that is constant, or was not looked into.
pub(super) struct Block {
    pub(super) cube: Cube,
    pub(super) bound: f32,
    pub(super) weight: f64,
    pub(super) power: f64,
}

/// All cubes that may emit.
#[derive(Default)]
pub(super) struct Cells {
    pub(super) bricks: Vec<Brick>,
    pub(super) blocks: Vec<Block>,
}

impl Cells {
    pub(super) fn new(source: &EmissionSource) -> Cells {
        let (mut varied, blocks) = descend(source);
        varied.sort_unstable();
        let bricks = varied.into_par_iter().filter_map(|cube| brick(source, cube)).collect();
        let mut blocks: Vec<Block> =
            blocks.into_par_iter().map(|(cube, bound)| block(source, cube, bound)).collect();
        blocks.sort_unstable_by_key(|block| block.cube);
        Cells { bricks, blocks }
    }

    /// Luminance integrated over everything, index units.
    pub(super) fn power(&self) -> f64 {
        self.bricks.iter().map(|brick| brick.power).sum::<f64>()
            + self.blocks.iter().map(|block| block.power).sum::<f64>()
    }

    /// The bounds as a grid: voxel `i` holds the bound of cell `i`.
    pub(super) fn bounds(&self) -> Result<VoxelGrid, Error> {
        let leaves = self.bricks.iter().map(|brick| {
            let mut mask = [0u64; 8];
            for (i, bound) in brick.bounds.iter().enumerate() {
                mask[i >> 6] |= u64::from(*bound > 0.0) << (i & 63);
            }
            (brick.cube.origin, *brick.bounds, mask)
        });
        let tiles = self.blocks.iter().map(|block| Tile {
            origin: block.cube.origin,
            log2_size: block.cube.log2,
            value: block.bound,
            active: true,
        });
        let tree = Tree::from_leaves(0.0, leaves).with_tiles(tiles);
        VoxelGrid::from_tree(&tree, &VoxelGridOptions { interpolation: Interpolation::Nearest })
    }

    /// Mean of the bound's integral over all lines parallel to the axes of index space that meet a
    /// brick or block, per world length.
    pub(super) fn mean_along_lines(&self, index_to_world: &DMat3) -> f64 {
        let cubes = || {
            let bricks = self.bricks.iter().map(|brick| brick.cube);
            bricks.chain(self.blocks.iter().map(|block| block.cube))
        };
        // Cubes are aligned: seen along an axis, one hides another or does not touch it. Larger
        // ones first.
        let mut sizes: Vec<u32> = cubes().map(|cube| cube.log2).collect();
        sizes.sort_unstable_by(|a, b| b.cmp(a));
        sizes.dedup();
        let m = [index_to_world.x_axis, index_to_world.y_axis, index_to_world.z_axis];
        let mut area = 0.0;
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut seen = HashSet::new();
            let mut met = 0.0;
            for (k, &log2) in sizes.iter().enumerate() {
                for cube in cubes().filter(|cube| cube.log2 == log2) {
                    let at = |log2: u32| (log2, cube.origin[u] >> log2, cube.origin[v] >> log2);
                    let hidden = sizes[..k].iter().any(|&larger| seen.contains(&at(larger)));
                    if !hidden && seen.insert(at(log2)) {
                        met += cube.edge() * cube.edge();
                    }
                }
            }
            area += met * m[u].cross(m[v]).length() / 3.0;
        }
        let bricks = self.bricks.iter().map(|brick| {
            // Walks know bounds of 4^3 cells at the finest.
            let mut parts = [0.0f32; 8];
            for (i, bound) in brick.bounds.iter().enumerate() {
                let part = &mut parts[i >> 8 << 2 | (i >> 5 & 1) << 1 | (i >> 2 & 1)];
                *part = part.max(*bound);
            }
            64.0 * parts.map(f64::from).iter().sum::<f64>()
        });
        let blocks = self.blocks.iter().map(|b| f64::from(b.bound) * b.cube.volume());
        let sum = bricks.sum::<f64>() + blocks.sum::<f64>();
        sum * index_to_world.determinant().abs() / area
    }
}

/// Bricks in which the emission varies, and blocks with their bounds.
fn descend(source: &EmissionSource) -> (Vec<Cube>, Vec<(Cube, Bound)>) {
    let Some(Bounds3 { low, high }) = source.support() else { return (Vec::new(), Vec::new()) };
    let first = low.floor().to_array().map(|c| c as i64);
    let last = high.ceil().to_array().map(|c| c as i64 - 1);
    // Cubes of which two along an axis cover everything; below 2^30, so that origins and edges stay
    // in range.
    let mut log2 = BRICK;
    while log2 < 29 && (0..3).any(|axis| (last[axis] >> log2) - (first[axis] >> log2) > 1) {
        log2 += 1;
    }
    let mut active = Vec::new();
    for x in first[0] >> log2..=last[0] >> log2 {
        for y in first[1] >> log2..=last[1] >> log2 {
            for z in first[2] >> log2..=last[2] >> log2 {
                let origin = [x, y, z].map(|c| (c << log2) as i32);
                active.push(Cube { origin, log2 });
            }
        }
    }
    // Grids of very different resolution could ask for any number of bricks: no more than the grids
    // themselves have, times a few.
    let budget = source.bricks().saturating_mul(4).saturating_add(1 << 13);
    let mut blocks = Vec::new();
    loop {
        let bounds: Vec<_> = active.par_iter().map(|cube| source.bound(cube.bounds())).collect();
        let mut varied = Vec::new();
        for (cube, bound) in active.iter().zip(bounds) {
            if bound.max > 0.0 && bound.constant && TILES.contains(&log2) {
                blocks.push((*cube, bound));
            } else if bound.max > 0.0 {
                varied.push(*cube);
            }
        }
        // Larger cubes than the largest tile each hold a tile or a leaf of the file: they are no
        // more than those.
        if varied.len() as u64 > budget
            && let Some(size) = TILES.into_iter().find(|tile| *tile >= log2)
        {
            let cubes: BTreeSet<Cube> = varied.iter().map(|cube| cube.around(size)).collect();
            blocks.extend(cubes.into_iter().map(|cube| {
                let Bound { max, constant } = source.bound(cube.bounds());
                // Few distinct bounds, so that the tables that lead to them are shared.
                (cube, Bound { max: power_of_two_above(max), constant })
            }));
            return (Vec::new(), blocks);
        }
        if log2 == BRICK {
            return (varied, blocks);
        }
        log2 -= 1;
        active = varied.into_iter().flat_map(Cube::children).collect();
    }
}

/// The least power of two that is not below a positive number.
fn power_of_two_above(value: f32) -> f32 {
    let bits = value.to_bits();
    let mantissa = (1 << 23) - 1;
    if bits & mantissa == 0 {
        value
    } else {
        f32::from_bits((bits & !mantissa).saturating_add(1 << 23))
    }
}

/// Luminance at the nodes of a Gauss rule of two points per axis, mean over them: exact over a cell
/// for products of three linear interpolations.
fn mean_luminance(source: &EmissionSource, low: DVec3, edge: f64) -> f32 {
    const NODES: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
    let mut sum = Vec3::ZERO;
    for corner in 0..8 {
        let node = [corner >> 2 & 1, corner >> 1 & 1, corner & 1].map(|i: usize| NODES[i]);
        sum += source.at(low + edge * DVec3::from_array(node));
    }
    luminance(sum) / 8.0
}

/// Bounds and weights of a brick's cells; `None` if there is no light in it.
fn brick(source: &EmissionSource, cube: Cube) -> Option<Brick> {
    let mut bounds = Box::new([0.0f32; LEAF_VALUES]);
    let mut weights = Box::new([0.0f32; LEAF_VALUES]);
    let mut power = 0.0;
    for (i, (bound, weight)) in bounds.iter_mut().zip(weights.iter_mut()).enumerate() {
        let low = cube.low() + DVec3::from_array([i >> 6, i >> 3 & 7, i & 7].map(|c| c as f64));
        *bound = source.bound(Bounds3::new(low, low + 1.0)).max;
        if *bound > 0.0 {
            let luminance = mean_luminance(source, low, 1.0);
            power += f64::from(luminance);
            *weight = luminance.max(LEAST_WEIGHT * *bound).max(f32::MIN_POSITIVE);
        }
    }
    bounds.iter().any(|bound| *bound > 0.0).then_some(Brick { cube, bounds, weights, power })
}

/// Weight of a constant cube, or by samples of one that was not looked into.
fn block(source: &EmissionSource, cube: Cube, bound: Bound) -> Block {
    let parts = if bound.constant { 1 } else { 4 };
    let edge = cube.edge() / f64::from(parts);
    let mut sum = 0.0;
    for i in 0..parts * parts * parts {
        let part = [i / parts / parts, i / parts % parts, i % parts].map(f64::from);
        sum += f64::from(mean_luminance(source, cube.low() + edge * DVec3::from_array(part), edge));
    }
    let power = sum * edge * edge * edge;
    let least = f64::from(LEAST_WEIGHT * bound.max) * cube.volume();
    Block { cube, bound: bound.max, weight: power.max(least).max(f64::MIN_POSITIVE), power }
}
