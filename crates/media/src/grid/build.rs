//! From a VDB tree to a render grid, in parallel.

use super::bounds::{fill_entry_ranges, sub_cell_ranges};
use super::source::{Source, Sources};
use super::splits::fill_splits;
use super::topology::{NODE_ENTRIES, NODE_LEVEL_OFFSETS, NODE_LOG2};
use super::{
    BRICK_EDGE, BRICK_LOG2, BRICK_VALUES, Entry, Half, Interpolation, Topology, Voxel, VoxelGrid,
    Voxels,
};
use crate::Error;
use pileus_vdb::{Coord, Tree};
use rayon::prelude::*;
use std::collections::HashMap;
use std::time::Instant;

/// How to build a render grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VoxelGridOptions {
    /// How values between voxels are formed.
    pub interpolation: Interpolation,
}

/// What building a render grid found and what the grid takes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BuildReport {
    /// Wall time, seconds.
    pub seconds: f64,
    /// Of these for the bounds above bricks, seconds; bricks are bounded as they are filled.
    pub seconds_bounds: f64,
    /// Bricks of 8^3 cells.
    pub bricks: u64,
    /// Stored voxels, 9^3 per brick.
    pub voxels: u64,
    /// Whether voxels are kept as binary16 (without loss).
    pub stored_as_half: bool,
    /// Bytes of voxel values.
    pub bytes_voxels: u64,
    /// Bytes of bounds.
    pub bytes_bounds: u64,
    /// Bytes of the tables that lead to the bricks.
    pub bytes_index: u64,
    /// Voxels and tiles that were not finite and count as zero.
    pub replaced_non_finite: u64,
    /// Voxels and tiles that were negative and count as zero.
    pub replaced_negative: u64,
}

/// Most bricks and tables a grid may have: both are addressed by 31 bits.
const MAX_CHILDREN: usize = 1 << 31;

/// The stored value for a raw one: extinction is finite and not negative.
fn sanitise(value: f32) -> f32 {
    if value.is_finite() && value > 0.0 { value } else { 0.0 }
}

impl VoxelGrid {
    /// Lays out `tree` for rendering, on the current rayon pool.
    ///
    /// # Errors
    /// If the tree spans more than 2^31 voxels along an axis.
    pub fn from_tree(tree: &Tree<f32>, options: &VoxelGridOptions) -> Result<VoxelGrid, Error> {
        let start = Instant::now();
        let background = sanitise(*tree.background());
        let (replaced_non_finite, replaced_negative) = count_replaced(tree);
        let half = stores_as_half(tree);
        let Some((low, high)) = non_background_box(tree, background) else {
            return Ok(VoxelGrid::constant(background, options.interpolation));
        };
        // A voxel reaches one voxel down and up under trilinear interpolation.
        let reach = match options.interpolation {
            Interpolation::Nearest => 0,
            Interpolation::Trilinear => 1,
        };
        let origin = low.map(|c| (c - reach) & !7);
        let size = [0, 1, 2].map(|axis| high[axis] + 1 - origin[axis]);
        let too_large = || {
            Error::unsupported(
                format!("the grid spans {low:?} to {high:?}, more voxels than can be addressed"),
                "split it into grids that are each below 2^30 voxels wide",
            )
        };
        let topology = Topology::new(size).ok_or_else(too_large)?;
        // The root table begins at a multiple of its own cells, so that tables and tiles align.
        let align = |c: i64| c >> topology.root_log2 << topology.root_log2;
        let origin = origin.map(align);
        let size = [0, 1, 2].map(|axis| high[axis] + 1 - origin[axis]);
        let topology = if topology.root_log2 > BRICK_LOG2 {
            Topology::with_root(size, topology.root_log2).ok_or_else(too_large)?
        } else {
            topology
        };
        let fits = |c: i64| i32::try_from(c).map_err(|_| too_large());
        let origin = [fits(origin[0])?, fits(origin[1])?, fits(origin[2])?];
        for axis in 0..3 {
            origin[axis].checked_add(topology.extent[axis]).ok_or_else(too_large)?;
        }

        let sources = Sources::new(tree, sanitise, topology.root_log2);
        let mut builder = Builder {
            tree,
            sources: &sources,
            bricks: Vec::new(),
            shared_bricks: HashMap::new(),
            tables: Vec::new(),
            table_entries: Vec::new(),
            shared_tables: HashMap::new(),
        };
        let root = builder.root(&topology, origin);
        let Builder { bricks, tables, table_entries, .. } = builder;
        if bricks.len() >= MAX_CHILDREN || tables.len() >= MAX_CHILDREN {
            return Err(too_large());
        }

        let interpolation = options.interpolation;
        let (voxels, sub_min, sub_max) = if half {
            let store = |v| Half::exact(v).unwrap_or(Half::ZERO);
            let filled = fill(tree, &sources, &bricks, interpolation, store);
            (Voxels::Half(filled.voxels), filled.sub_min, filled.sub_max)
        } else {
            let filled = fill(tree, &sources, &bricks, interpolation, |v| v);
            (Voxels::Single(filled.voxels), filled.sub_min, filled.sub_max)
        };
        let bounding = Instant::now();
        let mut entries = root;
        entries.resize(topology.root_entries, Entry::to(0));
        entries.extend_from_slice(&table_entries);
        let mut entry_min = vec![0.0f32; entries.len()];
        fill_entry_ranges(&topology, &mut entries, &mut entry_min, &tables, &sub_min, &sub_max);
        let largest = sub_max.iter().flatten().copied().fold(background, f32::max);
        fill_splits(&topology, &mut entries, &tables, &sub_max, largest);
        let seconds_bounds = bounding.elapsed().as_secs_f64();

        let support = [low.map(|c| c - reach), high.map(|c| c + 1)]
            .map(|corner| [0, 1, 2].map(|axis| (corner[axis] - i64::from(origin[axis])) as i32));
        let voxel_bytes = if half { 2 } else { 4 };
        let report = BuildReport {
            seconds: start.elapsed().as_secs_f64(),
            seconds_bounds,
            bricks: bricks.len() as u64,
            voxels: (bricks.len() * BRICK_VALUES) as u64,
            stored_as_half: half,
            bytes_voxels: (bricks.len() * BRICK_VALUES * voxel_bytes) as u64,
            bytes_bounds: (bricks.len() * 64 + entries.len() * 12) as u64,
            bytes_index: (entries.len() * 4) as u64,
            replaced_non_finite,
            replaced_negative,
        };
        Ok(VoxelGrid {
            voxels,
            sub_max,
            sub_min,
            entries,
            entry_min,
            topology,
            origin,
            support,
            background,
            interpolation: options.interpolation,
            report,
        })
    }

    fn constant(background: f32, interpolation: Interpolation) -> VoxelGrid {
        VoxelGrid {
            voxels: Voxels::Single(vec![background; BRICK_VALUES]),
            sub_max: vec![[background; 8]],
            sub_min: vec![[background; 8]],
            entries: vec![Entry { max: background, ..Entry::to(0) }],
            entry_min: vec![background],
            topology: Topology::single_brick(),
            origin: [0; 3],
            support: [[0; 3]; 2],
            background,
            interpolation,
            report: BuildReport { bricks: 1, voxels: BRICK_VALUES as u64, ..Default::default() },
        }
    }
}

fn count_replaced(tree: &Tree<f32>) -> (u64, u64) {
    let count = |bad: fn(f32) -> bool| {
        let tiles = tree.tiles().iter().filter(|tile| bad(tile.value)).count();
        let background = usize::from(bad(*tree.background()));
        let voxels = tree
            .values()
            .par_chunks(1 << 16)
            .map(|chunk| chunk.iter().filter(|&&v| bad(v)).count())
            .sum::<usize>();
        (voxels + tiles + background) as u64
    };
    (count(|v| !v.is_finite()), count(|v| v < 0.0 && v.is_finite()))
}

/// Whether every value survives binary16 unchanged.
fn stores_as_half(tree: &Tree<f32>) -> bool {
    let exact = |v: f32| Half::exact(sanitise(v)).is_some();
    exact(*tree.background())
        && tree.tiles().iter().all(|tile| exact(tile.value))
        && tree.values().par_chunks(1 << 16).all(|chunk| chunk.iter().all(|&v| exact(v)))
}

/// Smallest and largest index coordinate of values that are not the background.
fn non_background_box(tree: &Tree<f32>, background: f32) -> Option<([i64; 3], [i64; 3])> {
    type Corners = ([i64; 3], [i64; 3]);
    const NONE: Corners = ([i64::MAX; 3], [i64::MIN; 3]);
    let join = |a: Corners, b: Corners| {
        (
            [0, 1, 2].map(|axis| a.0[axis].min(b.0[axis])),
            [0, 1, 2].map(|axis| a.1[axis].max(b.1[axis])),
        )
    };
    let leaves = tree
        .leaves()
        .par_iter()
        .enumerate()
        .map(|(index, leaf)| {
            let (mut low, mut high) = ([8i64; 3], [-1i64; 3]);
            for (offset, &value) in tree.leaf_values(index).iter().enumerate() {
                if sanitise(value) != background {
                    let at = [offset >> 6, offset >> 3 & 7, offset & 7];
                    for axis in 0..3 {
                        low[axis] = low[axis].min(at[axis] as i64);
                        high[axis] = high[axis].max(at[axis] as i64);
                    }
                }
            }
            if high[0] < 0 {
                return NONE;
            }
            let at = |c: [i64; 3]| [0, 1, 2].map(|axis| c[axis] + i64::from(leaf.origin[axis]));
            (at(low), at(high))
        })
        .reduce(|| NONE, join);
    let corners = tree
        .tiles()
        .iter()
        .filter(|tile| sanitise(tile.value) != background)
        .map(|tile| {
            let low = tile.origin.map(i64::from);
            (low, low.map(|c| c + (1i64 << tile.log2_size) - 1))
        })
        .fold(leaves, join);
    (corners.0[0] <= corners.1[0]).then_some(corners)
}

/// The sources of a brick and its seven neighbours above; bit 2 of the index steps in x, bit 1 in
/// y, bit 0 in z.
type Around = [Source; 8];

struct Builder<'a> {
    tree: &'a Tree<f32>,
    sources: &'a Sources,
    bricks: Vec<Around>,
    shared_bricks: HashMap<Around, u32>,
    /// Child tables: index and log2 size of their children.
    tables: Vec<(u32, u32)>,
    table_entries: Vec<Entry>,
    shared_tables: HashMap<(u32, Around), u32>,
}

impl Builder<'_> {
    /// Entries of the root's base level.
    fn root(&mut self, topology: &Topology, origin: Coord) -> Vec<Entry> {
        let dims = topology.levels[0].dims;
        let base = origin.map(|c| c >> topology.root_log2);
        if topology.root_log2 == BRICK_LOG2 {
            return self.brick_entries(base, dims.map(|n| n as usize));
        }
        let mut entries = Vec::new();
        for x in 0..dims[0] {
            for y in 0..dims[1] {
                for z in 0..dims[2] {
                    let cell = [base[0] + x, base[1] + y, base[2] + z];
                    entries.push(Entry::to(self.table(topology.root_log2, cell)));
                }
            }
        }
        entries
    }

    /// The table for the cell of `2^log2` voxels at `cell`; shared where the cell and its
    /// neighbours above are constant.
    fn table(&mut self, log2: u32, cell: Coord) -> u32 {
        let mut around = [Source::BACKGROUND; 8];
        let mut constant = true;
        for (corner, source) in around.iter_mut().enumerate() {
            let step = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            let at = [0, 1, 2].map(|axis| cell[axis].saturating_add(step[axis] as i32));
            match self.sources.constant_cell(log2, at) {
                Some(found) => *source = found,
                None => constant = false,
            }
        }
        if constant && let Some(&table) = self.shared_tables.get(&(log2, around)) {
            return table;
        }
        let child_log2 = log2 - NODE_LOG2;
        let base = cell.map(|c| c << NODE_LOG2);
        let children = if child_log2 == BRICK_LOG2 {
            self.brick_entries(base, [1 << NODE_LOG2; 3])
        } else {
            let mut children = Vec::with_capacity(NODE_LEVEL_OFFSETS[1]);
            for x in 0..1 << NODE_LOG2 {
                for y in 0..1 << NODE_LOG2 {
                    for z in 0..1 << NODE_LOG2 {
                        let at = [base[0] + x, base[1] + y, base[2] + z];
                        children.push(Entry::to(self.table(child_log2, at)));
                    }
                }
            }
            children
        };
        let table = self.tables.len() as u32;
        self.tables.push((table, child_log2));
        self.table_entries.extend_from_slice(&children);
        self.table_entries.resize(self.tables.len() * NODE_ENTRIES, Entry::to(0));
        if constant {
            self.shared_tables.insert((log2, around), table);
        }
        table
    }

    /// Entries for a box of bricks, z fastest.
    fn brick_entries(&mut self, base: Coord, dims: [usize; 3]) -> Vec<Entry> {
        let padded = dims.map(|n| n + 1);
        let block = self.sources.block(base, padded);
        let stride = [padded[1] * padded[2], padded[2], 1];
        let around = |x: usize, y: usize, z: usize| -> Around {
            let at = x * stride[0] + y * stride[1] + z;
            std::array::from_fn(|corner| {
                block[at
                    + (corner >> 2 & 1) * stride[0]
                    + (corner >> 1 & 1) * stride[1]
                    + (corner & 1)]
            })
        };
        // Where only a neighbour is a leaf, its face may hold the constant as well.
        let (tree, sources) = (self.tree, self.sources);
        let cells: Vec<(Around, bool)> = (0..dims[0] * dims[1])
            .into_par_iter()
            .flat_map_iter(|row| {
                let (x, y) = (row / dims[1], row % dims[1]);
                (0..dims[2]).map(move |z| (x, y, z))
            })
            .map(|(x, y, z)| {
                let around = around(x, y, z);
                let flat = around.iter().any(|s| s.constant().is_none())
                    && around[0].constant().is_some_and(|c| {
                        let mut values = [0.0; BRICK_VALUES];
                        gather(tree, sources, &around, &mut values, |v| v);
                        let constant = sources.constants[c as usize];
                        values.iter().all(|&v| v == constant)
                    });
                (around, flat)
            })
            .collect();
        cells
            .into_iter()
            .map(|(around, flat)| {
                let key = if flat { [around[0]; 8] } else { around };
                let shared = key.iter().all(|s| s.constant().is_some());
                let child = match self.shared_bricks.get(&key) {
                    Some(&brick) if shared => brick,
                    _ => {
                        let brick = self.bricks.len() as u32;
                        self.bricks.push(key);
                        if shared {
                            self.shared_bricks.insert(key, brick);
                        }
                        brick
                    }
                };
                Entry::to(child)
            })
            .collect()
    }
}

/// Bricks with the bounds of their cells of 4 voxels.
struct Filled<V> {
    voxels: Vec<V>,
    sub_min: Vec<[f32; 8]>,
    sub_max: Vec<[f32; 8]>,
}

/// Fills all bricks and bounds each while it is in the cache.
fn fill<V: Voxel>(
    tree: &Tree<f32>,
    sources: &Sources,
    bricks: &[Around],
    interpolation: Interpolation,
    store: impl Fn(f32) -> V + Sync,
) -> Filled<V> {
    let mut voxels = vec![store(0.0); bricks.len() * BRICK_VALUES];
    let (sub_min, sub_max) = voxels
        .par_chunks_exact_mut(BRICK_VALUES)
        .zip(bricks)
        .map(|(brick, around)| {
            gather(tree, sources, around, brick, &store);
            sub_cell_ranges(brick, interpolation)
        })
        .unzip();
    Filled { voxels, sub_min, sub_max }
}

/// Writes the 9^3 values of one brick.
fn gather<V: Copy>(
    tree: &Tree<f32>,
    sources: &Sources,
    around: &Around,
    brick: &mut [V],
    store: impl Fn(f32) -> V,
) {
    for x in 0..BRICK_EDGE {
        for y in 0..BRICK_EDGE {
            let corner = (x >> 3) << 2 | (y >> 3) << 1;
            let row = (x * BRICK_EDGE + y) * BRICK_EDGE;
            let inner = (x & 7) << 6 | (y & 7) << 3;
            match around[corner].constant() {
                Some(c) => {
                    let value = store(sources.constants[c as usize]);
                    brick[row..row + 8].fill(value);
                }
                None => {
                    let leaf = &tree.leaf_values(around[corner].0 as usize)[inner..inner + 8];
                    for (to, &from) in brick[row..row + 8].iter_mut().zip(leaf) {
                        *to = store(sanitise(from));
                    }
                }
            }
            brick[row + 8] = match around[corner | 1].constant() {
                Some(c) => store(sources.constants[c as usize]),
                None => store(sanitise(tree.leaf_values(around[corner | 1].0 as usize)[inner])),
            };
        }
    }
}
