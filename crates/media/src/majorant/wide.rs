//! Rays through grids that are too wide for single precision: walked in parts, each in coordinates
//! of its own.
//!
//! What a ray meets is cut at the faces of blocks of 2^12 voxels; blocks without extinction are
//! left out, cells that are constant stay whole. Within a part positions are counted from its
//! block's corner, so that they are as precise wherever the block lies. The ray's parameter counts
//! the lengths of the parts alone: gaps between clusters, however long, cost it no precision. Parts
//! are a function of ray and grid, found in double precision.

use super::structure::AnyPartition;
use super::walk::{GridRay, Line};
use crate::field::{ExactField, MajorantSegment, RayField};
use crate::grid::{CellWalk, Half, VoxelGrid, Voxels};
use crate::tally::Tally;
use crate::transmittance::{ray_depth, ray_t_at_depth};
use glam::DVec3;
use smallvec::SmallVec;

/// Widest extent, voxels, within which positions from the grid's lowest corner are precise in
/// `f32`: to 5e-4 voxels.
const NARROW: i32 = 1 << 13;

/// Base 2 logarithm of a block's edge, voxels: positions in it are precise to 2.5e-4 voxels.
const BLOCK_LOG2: u32 = 12;

impl VoxelGrid {
    /// Whether the grid is so wide that single precision counts its voxels from corners along a
    /// ray.
    pub(crate) fn is_wide(&self) -> bool {
        self.topology.extent.iter().any(|&extent| extent > NARROW)
    }
}

/// A part of a ray, between two faces of a block.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Part {
    /// Lowest corner of the block, local voxels.
    corner: [i32; 3],
    /// Distance along the ray from its start, of the part's ends.
    start: f64,
    end: f64,
    /// The ray's parameter at the start.
    t: f32,
}

impl Part {
    fn length(&self) -> f32 {
        (self.end - self.start) as f32
    }
}

/// The parts of a ray, in order.
#[derive(Debug, Clone)]
struct Parts<'a> {
    grid: &'a VoxelGrid,
    walk: CellWalk,
    /// The parameter passed.
    t: f32,
}

impl<'a> Parts<'a> {
    fn new(grid: &'a VoxelGrid, line: &Line) -> Parts<'a> {
        let walk = CellWalk::new((line.p, line.d), (0.0, line.length), grid.topology.extent);
        Parts { grid, walk, t: 0.0 }
    }
}

impl Iterator for Parts<'_> {
    type Item = Part;

    fn next(&mut self) -> Option<Part> {
        let top = self.grid.topology.top_log2();
        while let Some(ijk) = self.walk.voxel() {
            let mut log2 = BLOCK_LOG2.min(top);
            let (min, max) = self.grid.cell_range(ijk, log2);
            if min == max {
                while log2 < top && self.grid.cell_range(ijk, log2 + 1) == (min, max) {
                    log2 += 1;
                }
            }
            let (start, end) = self.walk.cross(log2);
            if max > 0.0 && end > start {
                let part = Part { corner: ijk.map(|c| c >> log2 << log2), start, end, t: self.t };
                self.t += part.length();
                return Some(part);
            }
        }
        None
    }
}

/// Distance from the start of `line` at the parameter `t` of a [`WideRay`] along it.
pub(crate) fn distance(grid: &VoxelGrid, line: &Line, t: f64) -> f64 {
    let mut last = None;
    for part in Parts::new(grid, line) {
        if f64::from(part.t) > t {
            break;
        }
        last = Some(part);
    }
    last.map_or(0.0, |part| within(&part, t))
}

fn within(part: &Part, t: f64) -> f64 {
    (part.start + (t - f64::from(part.t))).clamp(part.start, part.end)
}

/// A ray within a part.
#[derive(Debug, Clone)]
enum PartRay<'a> {
    Half(GridRay<'a, Half, AnyPartition<'a>, [i32; 3]>),
    Single(GridRay<'a, f32, AnyPartition<'a>, [i32; 3]>),
}

/// Calls a method of whichever it is.
macro_rules! of_part {
    ($part:expr, $ray:ident => $value:expr) => {
        match $part {
            PartRay::Half($ray) => $value,
            PartRay::Single($ray) => $value,
        }
    };
}

/// A ray through a grid of any width. Its parameter is the length of what may hold extinction: see
/// [`RayField::distance`].
#[derive(Debug, Clone)]
pub(crate) struct WideRay<'a> {
    grid: &'a VoxelGrid,
    partition: AnyPartition<'a>,
    scales: [f32; 2],
    line: Line,
    parts: Parts<'a>,
    /// Parts begun so far; the last one is walked.
    begun: SmallVec<[Part; 4]>,
    ray: Option<PartRay<'a>>,
    /// Cells visited in parts that are done.
    steps: u64,
}

impl<'a> WideRay<'a> {
    /// Along `line`, local coordinates within the grid's extent. `scales`: raw value to extinction
    /// and raw bound to majorant.
    pub(crate) fn new(
        grid: &'a VoxelGrid,
        partition: AnyPartition<'a>,
        scales: [f32; 2],
        line: Line,
    ) -> WideRay<'a> {
        let parts = Parts::new(grid, &line);
        let begun = SmallVec::new();
        WideRay { grid, partition, scales, line, parts, begun, ray: None, steps: 0 }
    }

    fn begin(&self, part: &Part) -> PartRay<'a> {
        let Line { p, d, .. } = self.line;
        let line = Line { p: p + d * part.start, d, length: part.end - part.start };
        let (grid, partition, scales) = (self.grid, self.partition, self.scales);
        match &grid.voxels {
            Voxels::Half(voxels) => {
                let view = grid.view(voxels);
                PartRay::Half(GridRay::new(view, partition, scales, part.corner, line))
            }
            Voxels::Single(voxels) => {
                let view = grid.view(voxels);
                PartRay::Single(GridRay::new(view, partition, scales, part.corner, line))
            }
        }
    }

    /// Parameter at which the part that is walked begins.
    fn offset(&self) -> f32 {
        self.begun.last().map_or(0.0, |part| part.t)
    }

    /// The local point at parameter `t` of the segment handed out last, inside its cell whatever
    /// rounding says.
    pub(crate) fn local_in_cell(&self, t: f32) -> DVec3 {
        let (Some(ray), Some(part)) = (&self.ray, self.begun.last()) else { return self.line.p };
        let p = of_part!(ray, ray => ray.local_in_cell(t - part.t));
        p.as_dvec3() + DVec3::from_array(part.corner.map(f64::from))
    }

    /// The part begun last before parameter `t`.
    fn part_at(&self, t: f64) -> Option<&Part> {
        let index = self.begun.partition_point(|part| f64::from(part.t) <= t);
        self.begun.get(index.max(1) - 1)
    }
}

impl RayField for WideRay<'_> {
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        loop {
            if let Some(ray) = &mut self.ray {
                if let Some(MajorantSegment { t0, t1, majorant }) =
                    of_part!(ray, ray => ray.next_segment())
                {
                    let offset = self.offset();
                    return Some(MajorantSegment { t0: offset + t0, t1: offset + t1, majorant });
                }
                self.steps += of_part!(ray, ray => ray.steps());
            }
            self.ray = None;
            let part = self.parts.next()?;
            self.ray = Some(self.begin(&part));
            self.begun.push(part);
        }
    }

    fn minorant(&self) -> f32 {
        self.ray.as_ref().map_or(0.0, |ray| of_part!(ray, ray => ray.minorant()))
    }

    fn sigma_t(&self, t: f32) -> f32 {
        let t = t - self.offset();
        self.ray.as_ref().map_or(0.0, |ray| of_part!(ray, ray => ray.sigma_t(t)))
    }

    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        let p = self.line.p + self.line.d * self.distance(f64::from(t));
        self.grid.interpolate_within(p) as f32 * self.scales[0]
    }

    fn distance(&self, t: f64) -> f64 {
        self.part_at(t).map_or(0.0, |part| within(part, t))
    }

    fn steps(&self) -> u64 {
        self.steps + self.ray.as_ref().map_or(0, |ray| of_part!(ray, ray => ray.steps()))
    }
}

impl ExactField for WideRay<'_> {
    fn optical_depth(&self, tally: &mut Tally) -> f64 {
        let Line { p, d, length } = self.line;
        let depth = match &self.grid.voxels {
            Voxels::Half(voxels) => {
                ray_depth(&self.grid.view(voxels), (p, d), (0.0, length), tally)
            }
            Voxels::Single(voxels) => {
                ray_depth(&self.grid.view(voxels), (p, d), (0.0, length), tally)
            }
        };
        depth * f64::from(self.scales[0])
    }

    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        let Line { p, d, length } = self.line;
        let scale = f64::from(self.scales[0]);
        let (ray, range, raw) = ((p, d), (0.0, length), depth / scale);
        let found = match &self.grid.voxels {
            Voxels::Half(voxels) => ray_t_at_depth(&self.grid.view(voxels), ray, range, raw, tally),
            Voxels::Single(voxels) => {
                ray_t_at_depth(&self.grid.view(voxels), ray, range, raw, tally)
            }
        };
        let at = found.map_err(|depth| depth * scale)?;
        // Depth grows within parts alone.
        let part = Parts::new(self.grid, &self.line).find(|part| at <= part.end);
        Ok(part.map_or(0.0, |part| part.t + (at - part.start).max(0.0) as f32))
    }
}
