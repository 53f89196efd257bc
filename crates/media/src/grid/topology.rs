//! Where bricks are: a dense root table, or a shallow tree of tables when the grid spans too much
//! for one.
//!
//! Space is cut into cells of `2^e` voxels. Bricks are cells of e = 3. The root table is dense over
//! the grid's bounds at the finest e in {3, 7, 11, ...} which keeps it within [`MAX_ROOT_CELLS`]; a
//! root cell coarser than a brick points to a table of 16^3 children, and so on down. Every table
//! is followed by its mip levels, which hold the largest value of 2^3 cells each, so that a ray can
//! skip at any power of two.
//!
//! Constant regions need no case of their own: they point to a shared table or a shared brick that
//! holds the constant.

/// A table entry: what a cell points to and the largest value in it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub(crate) struct Entry {
    /// Brick (e = 3) or child table (e = 7, 11, ...); unused in mip levels.
    pub(crate) child: u32,
    /// Largest value that interpolation can return in the cell.
    pub(crate) max: f32,
    /// Majorant per voxel over raw bound above which the cell is better entered by its parts.
    pub(crate) split_above: f32,
}

impl Entry {
    /// An entry whose bounds are yet to be filled in.
    pub(crate) fn to(child: u32) -> Entry {
        Entry { child, max: 0.0, split_above: f32::INFINITY }
    }
}

/// Most cells of a root table at its base level: 16 MiB of entries.
pub(crate) const MAX_ROOT_CELLS: u64 = 1 << 21;

/// Base 2 logarithm of a brick's edge length.
pub(crate) const BRICK_LOG2: u32 = 3;
/// Base 2 logarithm of the children per edge of a table below the root.
pub(crate) const NODE_LOG2: u32 = 4;
/// Offsets of the levels of a table below the root: 16^3, 8^3, 4^3, 2^3.
pub(crate) const NODE_LEVEL_OFFSETS: [usize; 4] = [0, 4096, 4096 + 512, 4096 + 512 + 64];
/// Entries of such a table.
pub(crate) const NODE_ENTRIES: usize = 4096 + 512 + 64 + 8;

/// One level of the root table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RootLevel {
    pub(crate) offset: usize,
    pub(crate) dims: [i32; 3],
}

/// Shape of the tables.
#[derive(Debug, Clone)]
pub(crate) struct Topology {
    /// Edge of a root cell, as a power of two.
    pub(crate) root_log2: u32,
    /// The root table and its mip levels, finest first.
    pub(crate) levels: Vec<RootLevel>,
    /// Entries of the root table with its mip levels; child table `k` begins at
    /// `root_entries + k * NODE_ENTRIES`.
    pub(crate) root_entries: usize,
    /// Extent in voxels, a multiple of the root cell.
    pub(crate) extent: [i32; 3],
}

/// Coarsest cells are at most 2^30 voxels wide, so that their edge fits `i32`: the widest grids
/// have up to eight of them.
const MAX_CELL_LOG2: u32 = 30;

impl Topology {
    /// The shape for a grid of `size` voxels per axis (at least one each); `None` if the extent
    /// leaves `i32`.
    pub(crate) fn new(size: [i64; 3]) -> Option<Topology> {
        let mut root_log2 = BRICK_LOG2;
        loop {
            let cells = size.map(|s| (s.max(1) + (1i64 << root_log2) - 1) >> root_log2);
            let product = cells
                .into_iter()
                .try_fold(1u64, |product, n| product.checked_mul(n.unsigned_abs()));
            if product.is_some_and(|n| n <= MAX_ROOT_CELLS) {
                return Topology::with_root(size, root_log2);
            }
            root_log2 += NODE_LOG2;
        }
    }

    /// One brick.
    pub(crate) fn single_brick() -> Topology {
        let levels = vec![RootLevel { offset: 0, dims: [1; 3] }];
        Topology { root_log2: BRICK_LOG2, levels, root_entries: 1, extent: [8; 3] }
    }

    /// The shape with root cells of `2^root_log2` voxels.
    pub(crate) fn with_root(size: [i64; 3], root_log2: u32) -> Option<Topology> {
        let cells = size.map(|s| (s.max(1) + (1i64 << root_log2) - 1) >> root_log2);
        let mut extent = [0i32; 3];
        let mut dims = [0i32; 3];
        for axis in 0..3 {
            let n = cells[axis];
            dims[axis] = i32::try_from(n).ok()?;
            extent[axis] = i32::try_from(n << root_log2).ok()?;
        }
        let mut levels = Vec::new();
        let mut offset = 0usize;
        loop {
            levels.push(RootLevel { offset, dims });
            offset += dims.iter().map(|&n| n as usize).product::<usize>();
            let log2 = root_log2 + levels.len() as u32 - 1;
            if dims == [1, 1, 1] || log2 == MAX_CELL_LOG2 {
                break;
            }
            dims = dims.map(|n| (n + 1) >> 1);
        }
        Some(Topology { root_log2, levels, root_entries: offset, extent })
    }

    /// Coarsest cell size, as a power of two.
    pub(crate) fn top_log2(&self) -> u32 {
        self.root_log2 + self.levels.len() as u32 - 1
    }
}

impl RootLevel {
    /// Index of a cell of this level in the entry array.
    #[inline(always)]
    pub(crate) fn index(&self, cell: [i32; 3]) -> usize {
        let [x, y, z] = cell.map(|c| c as u32 as usize);
        let (ny, nz) = (self.dims[1] as u32 as usize, self.dims[2] as u32 as usize);
        self.offset + (x * ny + y) * nz + z
    }
}

/// Index of the entry of `ijk`'s cell of `2^log2` voxels; within a child table for cells finer than
/// the root's.
#[inline(always)]
pub(crate) fn entry_index(
    topology: &Topology,
    entries: &[Entry],
    ijk: [i32; 3],
    log2: u32,
) -> usize {
    if log2 >= topology.root_log2 {
        return topology.levels[(log2 - topology.root_log2) as usize].index(ijk.map(|c| c >> log2));
    }
    let mut log2_node = topology.root_log2;
    let mut entry = entries[topology.levels[0].index(ijk.map(|c| c >> log2_node))];
    loop {
        let base = topology.root_entries + entry.child as usize * NODE_ENTRIES;
        log2_node -= NODE_LOG2;
        let level = log2.max(log2_node) - log2_node;
        let bits = NODE_LOG2 - level;
        let mask = (1i32 << bits) - 1;
        let [x, y, z] = ijk.map(|c| ((c >> (log2_node + level)) & mask) as usize);
        let index = base + NODE_LEVEL_OFFSETS[level as usize] + (((x << bits) | y) << bits | z);
        if log2 >= log2_node {
            return index;
        }
        entry = entries[index];
    }
}
