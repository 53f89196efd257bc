//! The walk: visits the cells of a partition along a ray.

use super::adaptive::Adaptive;
use super::partition::{Cell, NO_BRICK, Partition};
use crate::field::{ExactField, MajorantSegment, RayField};
use crate::grid::{GridView, Voxel};
use crate::tally::Tally;
use crate::transmittance::{ray_depth, ray_t_at_depth};
use glam::{DVec3, Vec3, Vec3A};

/// Axes whose direction is smaller than this do not bound a cell: the ray would need over 1e18 voxels.
const PARALLEL: f32 = 1e-18;

/// A ray through a grid: hands out its majorant segments and looks up its extinction.
///
/// The cell around a point depends on the point, the grid and the scale only, not on how the walk came there. Cell
/// coordinates advance as integers: every step moves on by at least one cell along the axis it leaves through, so that the walk
/// ends for every ray, also along faces and through corners.
#[derive(Debug, Clone)]
pub struct GridRay<'a, V, P = Adaptive<'a>> {
    view: GridView<'a, V>,
    partition: P,
    /// Raw value to extinction.
    scale: f32,
    /// Raw bound to majorant: `scale`, unless an experiment wants looser or broken bounds.
    bound_scale: f32,
    /// Local point at parameter zero, voxels.
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
    /// Its corners.
    low: Vec3A,
    high: Vec3A,
    steps: u64,
}

impl<'a, V: Voxel, P: Partition> GridRay<'a, V, P> {
    /// A ray from local point `p0` (voxels, inside the extent) along `d` (voxels per length) up to parameter `t_end` (a length).
    /// `scale`: raw value to extinction and raw bound to majorant.
    #[inline]
    pub(crate) fn new(
        view: GridView<'a, V>,
        partition: P,
        [scale, bound_scale]: [f32; 2],
        p0: Vec3,
        d: Vec3,
        t_end: f32,
    ) -> Self {
        let extent = view.topology.extent;
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
            ijk[axis] = (p0[axis] as i32).clamp(0, extent[axis] - 1);
        }
        GridRay {
            view,
            partition,
            scale,
            bound_scale,
            p0: p0.into(),
            d: d.into(),
            inv_d,
            parallel,
            ascending,
            t: 0.0,
            t_end,
            ijk,
            cell: Cell::NONE,
            low: Vec3A::ZERO,
            high: Vec3A::ZERO,
            steps: 0,
        }
    }

    /// Visits the cell around `self.ijk` and moves on to the next one; returns its bound and where the ray leaves it.
    #[inline(always)]
    fn visit(&mut self) -> (f32, f32) {
        self.steps += 1;
        let cell = self.partition.cell(self.ijk, self.cell.key);
        self.cell = cell;
        let Cell { low, high, .. } = cell;
        self.low = Vec3A::new(low[0] as f32, low[1] as f32, low[2] as f32);
        self.high = Vec3A::new(high[0] as f32, high[1] as f32, high[2] as f32);
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
                // Rounding may put the point outside the cell or behind: stay inside, never go back.
                let c = (p[k] as i32).clamp(low[k], high[k] - 1);
                if self.ascending[k] { c.max(self.ijk[k]) } else { c.min(self.ijk[k]) }
            };
        }
        (cell.max, t_exit)
    }
}

impl<V: Voxel, P: Partition> GridRay<'_, V, P> {
    /// The local point at ray parameter `t` of the segment handed out last: inside its cell whatever rounding says, so that the bound holds.
    #[inline(always)]
    pub(crate) fn local_in_cell(&self, t: f32) -> Vec3 {
        (self.p0 + self.d * t).max(self.low).min(self.high).into()
    }
}

impl<V: Voxel, P: Partition> RayField for GridRay<'_, V, P> {
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
                return Some(MajorantSegment { t0, t1, majorant: max * self.bound_scale });
            }
        }
        None
    }

    fn minorant(&self) -> f32 {
        self.partition.min(&self.cell) * self.scale.min(self.bound_scale)
    }

    #[inline(always)]
    fn sigma_t(&self, t: f32) -> f32 {
        let mut p = self.local_in_cell(t);
        let high = self.cell.high;
        let mut ijk = [
            (p.x as i32).min(high[0] - 1),
            (p.y as i32).min(high[1] - 1),
            (p.z as i32).min(high[2] - 1),
        ];
        let brick = if self.cell.brick != NO_BRICK {
            self.cell.brick
        } else {
            // Cells larger than a brick may reach beyond the grid.
            for axis in 0..3 {
                let extent = self.view.topology.extent[axis];
                ijk[axis] = ijk[axis].min(extent - 1);
                p[axis] = p[axis].min(extent as f32);
            }
            self.view.brick(ijk)
        };
        self.view.interpolate_in_brick(brick, ijk, p) * self.scale
    }

    fn steps(&self) -> u64 {
        self.steps
    }

    #[inline]
    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        let p = Vec3::from(self.p0 + self.d * t);
        let mut ijk = [0; 3];
        let mut inside = [0.0; 3];
        for axis in 0..3 {
            let extent = self.view.topology.extent[axis];
            inside[axis] = p[axis].clamp(0.0, extent as f32);
            ijk[axis] = (inside[axis] as i32).min(extent - 1);
        }
        let brick = self.view.brick(ijk);
        self.view.interpolate_in_brick(brick, ijk, Vec3::from_array(inside)) * self.scale
    }
}

impl<V: Voxel, P: Partition> GridRay<'_, V, P> {
    fn exact_ray(&self) -> (DVec3, DVec3) {
        (self.p0.as_dvec3(), self.d.as_dvec3())
    }
}

impl<V: Voxel, P: Partition> ExactField for GridRay<'_, V, P> {
    fn optical_depth(&self, tally: &mut Tally) -> f64 {
        let range = (0.0, f64::from(self.t_end));
        ray_depth(&self.view, self.exact_ray(), range, tally) * f64::from(self.scale)
    }

    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        let range = (0.0, f64::from(self.t_end));
        let scale = f64::from(self.scale);
        ray_t_at_depth(&self.view, self.exact_ray(), range, depth / scale, tally)
            .map(|t| t as f32)
            .map_err(|depth| depth * scale)
    }
}
