//! The render grid: bricks of voxels under a table, with bounds for every cell.

mod bounds;
mod build;
mod cell_walk;
mod index_range;
mod source;
mod splits;
mod topology;
mod view;
mod voxel;

pub use build::{BuildReport, VoxelGridOptions};
pub(crate) use cell_walk::CellWalk;
pub(crate) use topology::{BRICK_LOG2, Entry, Topology, entry_index};
pub(crate) use view::{GridView, sub_cell};
pub(crate) use voxel::Half;
pub use voxel::Voxel;

use crate::method::Named;
use glam::DVec3;
use pileus_math::Bounds3;

/// Values along an edge of a brick: 8 cells and the far face, so that interpolation never leaves
/// the brick.
pub(crate) const BRICK_EDGE: usize = 9;
/// Values of a brick.
pub(crate) const BRICK_VALUES: usize = BRICK_EDGE * BRICK_EDGE * BRICK_EDGE;

/// How values between voxels are formed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// The value of the nearest voxel.
    Nearest,
    /// Linear in each axis between the eight voxels around.
    #[default]
    Trilinear,
}

/// Voxels in one of two precisions.
#[derive(Debug, Clone)]
pub(crate) enum Voxels {
    Half(Vec<Half>),
    Single(Vec<f32>),
}

/// A sparse scalar field laid out for rendering.
///
/// A value sits at its integer index coordinate; between them the field is interpolated, outside
/// the stored voxels it is the grid's background. Values are finite and not negative: others are
/// replaced by zero when the grid is built, and counted. Voxels are stored as binary16 when that
/// loses nothing, else as binary32.
///
/// Bounds of the interpolated field are kept in raw units for cells of 4, 8, 16, ... voxels;
/// scaling happens at use, so that look edits rebuild nothing.
#[derive(Debug, Clone)]
pub struct VoxelGrid {
    pub(crate) voxels: Voxels,
    /// Largest value in each of the eight 4^3 cells of a brick, by brick.
    pub(crate) sub_max: Vec<[f32; 8]>,
    /// Smallest value in each of the eight 4^3 cells of a brick, by brick.
    pub(crate) sub_min: Vec<[f32; 8]>,
    pub(crate) entries: Vec<Entry>,
    /// Smallest value in the cell of each entry.
    pub(crate) entry_min: Vec<f32>,
    pub(crate) topology: Topology,
    /// Index coordinate of the local origin.
    pub(crate) origin: [i32; 3],
    /// Support in local voxels: the field is the background outside.
    pub(crate) support: [[i32; 3]; 2],
    pub(crate) background: f32,
    pub(crate) interpolation: Interpolation,
    pub(crate) report: BuildReport,
}

impl Named for Interpolation {
    const ALL: &'static [Interpolation] = &[Interpolation::Nearest, Interpolation::Trilinear];
    const TITLE: &'static str = "Interpolation";
    const QUESTION: &'static str = "How values between voxels are formed";
    const LATER: &'static [&'static str] = &["tricubic"];

    fn name(self) -> &'static str {
        match self {
            Interpolation::Nearest => "nearest",
            Interpolation::Trilinear => "trilinear",
        }
    }

    fn about(self) -> &'static str {
        match self {
            Interpolation::Nearest => "The value of the nearest voxel.",
            Interpolation::Trilinear => "Linear along each axis.",
        }
    }
}

impl VoxelGrid {
    /// How the grid was built and what it takes.
    pub fn report(&self) -> &BuildReport {
        &self.report
    }

    /// How values between voxels are formed.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// Value outside all stored voxels.
    pub fn background(&self) -> f32 {
        self.background
    }

    /// Smallest and largest value of the whole field.
    pub fn range(&self) -> (f32, f32) {
        if self.is_empty() {
            return (self.background, self.background);
        }
        // The coarsest level: one cell, but for the widest grids.
        let first = self.topology.levels.last().map_or(0, |level| level.offset);
        (first..self.topology.root_entries)
            .fold((self.background, self.background), |(min, max), i| {
                (min.min(self.entry_min[i]), max.max(self.entries[i].max))
            })
    }

    /// Whether the field is constant.
    pub fn is_empty(&self) -> bool {
        self.support[0] == self.support[1]
    }

    /// The box in index space outside which the field is the background; `None` if it is constant.
    pub fn bounds_index(&self) -> Option<Bounds3> {
        if self.is_empty() {
            return None;
        }
        let offset = self.local_to_index();
        let corner = |c: [i32; 3]| DVec3::from_array(c.map(f64::from)) + offset;
        Some(Bounds3::new(corner(self.support[0]), corner(self.support[1])))
    }

    /// What to add to local coordinates (in which cell `i` spans `[i, i + 1)`) for index
    /// coordinates.
    pub(crate) fn local_to_index(&self) -> DVec3 {
        let shift = match self.interpolation {
            Interpolation::Nearest => -0.5,
            Interpolation::Trilinear => 0.0,
        };
        DVec3::from_array(self.origin.map(f64::from)) + shift
    }

    /// The stored value at an index coordinate.
    pub fn value(&self, ijk: [i32; 3]) -> f32 {
        let mut local = [0i32; 3];
        for axis in 0..3 {
            let c = i64::from(ijk[axis]) - i64::from(self.origin[axis]);
            if c < 0 || c >= i64::from(self.topology.extent[axis]) {
                return self.background;
            }
            local[axis] = c as i32;
        }
        self.local_value(local)
    }

    /// The stored value of a local voxel, which must lie within the extent.
    pub(crate) fn local_value(&self, ijk: [i32; 3]) -> f32 {
        match &self.voxels {
            Voxels::Half(v) => self.view(v).voxel(ijk),
            Voxels::Single(v) => self.view(v).voxel(ijk),
        }
    }

    /// The interpolated value at a point in index space, in double precision: exact but for
    /// rounding.
    pub fn interpolate(&self, p_index: DVec3) -> f64 {
        let p = p_index - self.local_to_index();
        let extent = DVec3::from_array(self.topology.extent.map(f64::from));
        if !(p.cmpge(DVec3::ZERO).all() && p.cmplt(extent).all()) {
            return f64::from(self.background);
        }
        self.interpolate_local(p.to_array().map(|c| c as i32), p)
    }

    /// The interpolated value at a local point, in double precision: exact but for rounding. The
    /// point must lie within the extent but for rounding; it is clamped to it.
    pub(crate) fn interpolate_within(&self, p: DVec3) -> f64 {
        let extent = self.topology.extent;
        let p = p.clamp(DVec3::ZERO, DVec3::from_array(extent.map(f64::from)));
        let ijk = [0, 1, 2].map(|axis: usize| (p[axis] as i32).min(extent[axis] - 1));
        self.interpolate_local(ijk, p)
    }

    /// The interpolated value at local point `p` of the cell of local voxel `ijk`, which must lie
    /// within the extent.
    pub(crate) fn interpolate_local(&self, ijk: [i32; 3], p: DVec3) -> f64 {
        match &self.voxels {
            Voxels::Half(v) => self.view(v).interpolate_f64(ijk, p),
            Voxels::Single(v) => self.view(v).interpolate_f64(ijk, p),
        }
    }

    /// Smallest and largest value in the cell of `2^log2` voxels (2 and coarser) around local voxel
    /// `ijk`.
    pub(crate) fn cell_range(&self, ijk: [i32; 3], log2: u32) -> (f32, f32) {
        if log2 < BRICK_LOG2 {
            let entry = self.entries[entry_index(&self.topology, &self.entries, ijk, BRICK_LOG2)];
            let sub = view::sub_cell(ijk);
            let brick = entry.child as usize;
            (self.sub_min[brick][sub], self.sub_max[brick][sub])
        } else {
            let index = entry_index(&self.topology, &self.entries, ijk, log2);
            (self.entry_min[index], self.entries[index].max)
        }
    }

    /// Smallest and largest value that interpolation can return in the cells `low..high`, which
    /// must lie within the extent: exact but for a margin of rounding. The time goes with the
    /// surface of the box.
    pub(crate) fn box_range(&self, low: [i32; 3], high: [i32; 3]) -> (f32, f32) {
        let mut range = (f32::INFINITY, f32::NEG_INFINITY);
        let top = self.topology.top_log2();
        if let Some(level) = self.topology.levels.last() {
            for x in 0..level.dims[0] {
                for y in 0..level.dims[1] {
                    for z in 0..level.dims[2] {
                        self.box_range_in(top, [x, y, z], low, high, &mut range);
                    }
                }
            }
        }
        range
    }

    /// Extends `range` by the part of the box in cell `at` of `2^log2` voxels.
    fn box_range_in(
        &self,
        log2: u32,
        at: [i32; 3],
        low: [i32; 3],
        high: [i32; 3],
        range: &mut (f32, f32),
    ) {
        let first = at.map(|c| i64::from(c) << log2);
        let past = first.map(|c| c + (1i64 << log2));
        let extent = self.topology.extent;
        let within = |axis: usize| {
            first[axis] < i64::from(high[axis])
                && past[axis] > i64::from(low[axis])
                && first[axis] < i64::from(extent[axis])
        };
        if !(0..3).all(within) {
            return;
        }
        let ijk = first.map(|c| c as i32);
        let whole = (0..3).all(|axis| {
            first[axis] >= i64::from(low[axis])
                && past[axis].min(i64::from(extent[axis])) <= i64::from(high[axis])
        });
        let (min, max) = self.cell_range(ijk, log2);
        // Nothing in the cell can widen the range: no need to look closer.
        if min >= range.0 && max <= range.1 {
            return;
        }
        if whole || min == max {
            *range = (range.0.min(min), range.1.max(max));
        } else if log2 > 2 {
            for corner in 0..8 {
                let step = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
                let child = [0, 1, 2].map(|axis| 2 * at[axis] + step[axis]);
                self.box_range_in(log2 - 1, child, low, high, range);
            }
        } else {
            let reach = i32::from(self.interpolation == Interpolation::Trilinear);
            let a = [0, 1, 2].map(|axis| low[axis].max(ijk[axis]));
            let b = [0, 1, 2].map(|axis| high[axis].min(ijk[axis] + 4) + reach);
            let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
            for x in a[0]..b[0] {
                for y in a[1]..b[1] {
                    for z in a[2]..b[2] {
                        let value = match &self.voxels {
                            Voxels::Half(v) => self.view(v).corner(ijk, [x, y, z]),
                            Voxels::Single(v) => self.view(v).corner(ijk, [x, y, z]),
                        };
                        (least, most) = (least.min(value), most.max(value));
                    }
                }
            }
            let (least, most) = bounds::widen(least, most);
            *range = (range.0.min(least), range.1.max(most));
        }
    }

    pub(crate) fn view<'a, V: Voxel>(&'a self, voxels: &'a [V]) -> GridView<'a, V> {
        GridView {
            voxels,
            sub_max: &self.sub_max,
            entries: &self.entries,
            topology: &self.topology,
            interpolation: self.interpolation,
        }
    }
}
