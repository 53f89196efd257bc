//! A walk through the cells of a grid in double precision: for exact depths, and for grids too wide
//! for single precision.

use glam::DVec3;

/// Steps from cell to cell along `o + t d`, local coordinates, as long as the ray is within the
/// grid; who walks says how large each cell is.
#[derive(Debug, Clone)]
pub(crate) struct CellWalk {
    o: DVec3,
    d: DVec3,
    t: f64,
    t_end: f64,
    extent: [i32; 3],
    /// A voxel of the next cell.
    ijk: [i32; 3],
}

impl CellWalk {
    /// For t in `[t0, t_end]`, along which the ray is within the extent.
    pub(crate) fn new(
        (o, d): (DVec3, DVec3),
        (t0, t_end): (f64, f64),
        extent: [i32; 3],
    ) -> CellWalk {
        let start = o + d * t0;
        let ijk = std::array::from_fn(|axis| (start[axis] as i32).clamp(0, extent[axis] - 1));
        CellWalk { o, d, t: t0, t_end, extent, ijk }
    }

    /// A voxel of the next cell; `None` at the ray's end.
    pub(crate) fn voxel(&self) -> Option<[i32; 3]> {
        let inside = (0..3).all(|axis| (0..self.extent[axis]).contains(&self.ijk[axis]));
        (self.t < self.t_end && inside).then_some(self.ijk)
    }

    /// Crosses the cell of `2^log2` voxels (at most 2^30) around the next voxel: its range of t.
    pub(crate) fn cross(&mut self, log2: u32) -> (f64, f64) {
        let CellWalk { o, d, .. } = *self;
        let size = 1i32 << log2;
        let low = self.ijk.map(|c| c & -size);
        let (mut t_exit, mut axis) = (f64::INFINITY, 0);
        for k in 0..3 {
            if d[k] != 0.0 {
                let face = f64::from(low[k]) + if d[k] > 0.0 { f64::from(size) } else { 0.0 };
                let t_face = (face - o[k]) / d[k];
                if t_face < t_exit {
                    (t_exit, axis) = (t_face, k);
                }
            }
        }
        let entry = self.t;
        let t_exit = t_exit.max(entry);
        self.t = t_exit;
        if t_exit >= self.t_end {
            return (entry, self.t_end);
        }
        let p = o + d * t_exit;
        for k in 0..3 {
            self.ijk[k] = if k == axis {
                if d[k] > 0.0 { low[k].saturating_add(size) } else { low[k] - 1 }
            } else {
                // Rounding may put the point outside the cell or behind: stay inside, never go
                // back.
                let c = (p[k] as i32).clamp(low[k], low[k].saturating_add(size - 1));
                if d[k] >= 0.0 { c.max(self.ijk[k]) } else { c.min(self.ijk[k]) }
            };
        }
        (entry, t_exit)
    }
}
