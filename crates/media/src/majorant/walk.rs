//! The walk: visits the cells of a partition along a ray.

use super::adaptive::Adaptive;
use super::partition::{Cell, NO_BRICK, Partition};
use crate::field::{ExactField, MajorantSegment, RayField};
use crate::grid::{GridView, Voxel};
use crate::tally::Tally;
use crate::transmittance::{ray_depth, ray_t_at_depth};
use glam::{DVec3, Vec3, Vec3A};

/// Axes whose direction is smaller than this do not bound a cell: the ray would need over 1e18
/// voxels.
const PARALLEL: f32 = 1e-18;

/// What a ray's positions are counted from: a corner of a brick, local voxels.
pub(crate) trait Corner: Copy + std::fmt::Debug {
    /// The voxel of the corner, in local voxels.
    fn voxel(self) -> [i32; 3];
}

/// The grid's lowest corner: no offset at all.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lowest;

impl Corner for Lowest {
    #[inline(always)]
    fn voxel(self) -> [i32; 3] {
        [0; 3]
    }
}

impl Corner for [i32; 3] {
    #[inline(always)]
    fn voxel(self) -> [i32; 3] {
        self
    }
}

/// The way of a ray in local coordinates: `p + t d`, t in [0, length].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    pub(crate) p: DVec3,
    /// Voxels per length.
    pub(crate) d: DVec3,
    pub(crate) length: f64,
}

/// A ray through a grid: hands out its majorant segments and looks up its extinction.
///
/// The cell around a point depends on the point, the grid and the scale only, not on how the walk
/// came there. Cell coordinates advance as integers: every step moves on by at least one cell along
/// the axis it leaves through, so that the walk ends for every ray, also along faces and through
/// corners.
#[derive(Debug, Clone)]
pub(crate) struct GridRay<'a, V, P = Adaptive<'a>, C = Lowest> {
    view: GridView<'a, V>,
    partition: P,
    /// What positions are counted from; cells and voxels are not.
    corner: C,
    /// The ray without rounding, for exact depths.
    line: Line,
    /// Raw value to extinction.
    scale: f32,
    /// Raw bound to majorant: `scale`, unless an experiment wants looser or broken bounds.
    majorant_scale: f32,
    /// Point at parameter zero, voxels from the corner.
    p0: Vec3A,
    /// Local direction, voxels per length.
    d: Vec3A,
    inv_d: Vec3A,
    /// Infinite along axes that do not bound a cell, else zero.
    parallel: Vec3A,
    /// Whether the ray ascends, per axis.
    ascending: [bool; 3],
    t: f32,
    t_end: f32,
    /// A voxel of the next cell.
    ijk: [i32; 3],
    /// The cell visited last.
    cell: Cell,
    /// Corners of the cell visited last, counted as positions are.
    low: Vec3A,
    high: Vec3A,
    steps: u64,
}

impl<'a, V: Voxel, P: Partition, C: Corner> GridRay<'a, V, P, C> {
    /// A ray along `line`, inside the extent and near `corner`.
    /// `scale`: raw value to extinction and raw bound to majorant.
    #[inline(always)]
    pub(crate) fn new(
        view: GridView<'a, V>,
        partition: P,
        [scale, majorant_scale]: [f32; 2],
        corner: C,
        line: Line,
    ) -> Self {
        let extent = view.topology.extent;
        let [x, y, z] = corner.voxel();
        let p0 = (line.p - DVec3::new(f64::from(x), f64::from(y), f64::from(z))).as_vec3();
        let d = line.d.as_vec3();
        let mut inv_d = Vec3A::ZERO;
        let mut parallel = Vec3A::ZERO;
        let mut ijk = [0; 3];
        let mut ascending = [true; 3];
        for axis in 0..3 {
            if d[axis].abs() < PARALLEL {
                parallel[axis] = f32::INFINITY;
            } else {
                inv_d[axis] = 1.0 / d[axis];
                ascending[axis] = d[axis] > 0.0;
            }
            let voxel = (p0[axis] as i32).saturating_add(corner.voxel()[axis]);
            ijk[axis] = voxel.clamp(0, extent[axis] - 1);
        }
        GridRay {
            view,
            partition,
            corner,
            line,
            scale,
            majorant_scale,
            p0: p0.into(),
            d: d.into(),
            inv_d,
            parallel,
            ascending,
            t: 0.0,
            t_end: line.length as f32,
            ijk,
            cell: Cell::NONE,
            low: Vec3A::ZERO,
            high: Vec3A::ZERO,
            steps: 0,
        }
    }

    /// Visits the cell around `self.ijk` and moves on to the next one; returns its bound and where
    /// the ray leaves it.
    #[inline(always)]
    fn visit(&mut self) -> (f32, f32) {
        self.steps += 1;
        let cell = self.partition.cell(self.ijk, self.cell.key);
        self.cell = cell;
        let Cell { low, high, .. } = cell;
        let corner = self.corner.voxel();
        let from = |c: [i32; 3]| {
            let [x, y, z] = [c[0] - corner[0], c[1] - corner[1], c[2] - corner[2]];
            Vec3A::new(x as f32, y as f32, z as f32)
        };
        (self.low, self.high) = (from(low), from(high));
        let face = Vec3A::new(
            if self.ascending[0] { self.high.x } else { self.low.x },
            if self.ascending[1] { self.high.y } else { self.low.y },
            if self.ascending[2] { self.high.z } else { self.low.z },
        );
        let t_face = (face - self.p0) * self.inv_d + self.parallel;
        let (axis, t_exit) = if t_face.x <= t_face.y && t_face.x <= t_face.z {
            (0, t_face.x)
        } else if t_face.y <= t_face.z {
            (1, t_face.y)
        } else {
            (2, t_face.z)
        };
        let t_exit = t_exit.max(self.t);
        if t_exit >= self.t_end {
            return (cell.max, self.t_end);
        }
        let p = (self.p0 + self.d * t_exit).to_array();
        for k in 0..3 {
            self.ijk[k] = if k == axis {
                if self.ascending[k] { high[k] } else { low[k] - 1 }
            } else {
                // Rounding may put the point outside the cell or behind: stay inside, never go
                // back.
                let c = (p[k] as i32).saturating_add(corner[k]).clamp(low[k], high[k] - 1);
                if self.ascending[k] { c.max(self.ijk[k]) } else { c.min(self.ijk[k]) }
            };
        }
        (cell.max, t_exit)
    }
}

impl<V: Voxel, P: Partition, C: Corner> GridRay<'_, V, P, C> {
    /// The point at ray parameter `t` of the segment handed out last, from the corner: inside its
    /// cell whatever rounding says, so that the bound holds.
    #[inline(always)]
    pub(crate) fn local_in_cell(&self, t: f32) -> Vec3 {
        (self.p0 + self.d * t).max(self.low).min(self.high).into()
    }
}

impl<V: Voxel, P: Partition, C: Corner> RayField for GridRay<'_, V, P, C> {
    #[inline(always)]
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        let extent = self.view.topology.extent;
        while self.t < self.t_end {
            let inside = (0..3).all(|axis| (self.ijk[axis] as u32) < extent[axis] as u32);
            if !inside {
                return None;
            }
            let t0 = self.t;
            let (max, t1) = self.visit();
            self.t = t1;
            if max > 0.0 {
                return Some(MajorantSegment { t0, t1, majorant: max * self.majorant_scale });
            }
        }
        None
    }

    fn minorant(&self) -> f32 {
        self.partition.min(&self.cell) * self.scale.min(self.majorant_scale)
    }

    #[inline(always)]
    fn sigma_t(&self, t: f32) -> f32 {
        let mut p = self.local_in_cell(t);
        let (high, corner) = (self.cell.high, self.corner.voxel());
        // From the corner, which is one of a brick: voxels have the same place in theirs.
        let mut ijk = [
            (p.x as i32).min(high[0] - corner[0] - 1),
            (p.y as i32).min(high[1] - corner[1] - 1),
            (p.z as i32).min(high[2] - corner[2] - 1),
        ];
        let brick = if self.cell.brick != NO_BRICK {
            self.cell.brick
        } else {
            // Cells larger than a brick may reach beyond the grid.
            for axis in 0..3 {
                let extent = self.view.topology.extent[axis] - corner[axis];
                ijk[axis] = ijk[axis].min(extent - 1);
                p[axis] = p[axis].min(extent as f32);
            }
            self.view.brick([ijk[0] + corner[0], ijk[1] + corner[1], ijk[2] + corner[2]])
        };
        self.view.interpolate_in_brick(brick, ijk, p) * self.scale
    }

    fn steps(&self) -> u64 {
        self.steps
    }

    #[inline]
    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        let p = Vec3::from(self.p0 + self.d * t);
        let corner = self.corner.voxel();
        let mut ijk = [0; 3];
        let mut inside = [0.0; 3];
        for axis in 0..3 {
            let extent = self.view.topology.extent[axis] - corner[axis];
            inside[axis] = p[axis].clamp(0.0, extent as f32);
            ijk[axis] = (inside[axis] as i32).min(extent - 1);
        }
        let brick = self.view.brick([0, 1, 2].map(|axis| ijk[axis] + corner[axis]));
        self.view.interpolate_in_brick(brick, ijk, Vec3::from_array(inside)) * self.scale
    }
}

impl<V: Voxel, P: Partition, C: Corner> ExactField for GridRay<'_, V, P, C> {
    fn optical_depth(&self, tally: &mut Tally) -> f64 {
        let Line { p, d, length } = self.line;
        ray_depth(&self.view, (p, d), (0.0, length), tally) * f64::from(self.scale)
    }

    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        let Line { p, d, length } = self.line;
        let scale = f64::from(self.scale);
        ray_t_at_depth(&self.view, (p, d), (0.0, length), depth / scale, tally)
            .map(|t| t as f32)
            .map_err(|depth| depth * scale)
    }
}
