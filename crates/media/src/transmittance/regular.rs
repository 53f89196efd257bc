//! Regular tracking: the exact optical depth, cell by cell.

use crate::grid::{Interpolation, VoxelGrid};
use crate::medium::GridMedium;
use crate::tally::Tally;
use glam::DVec3;

/// The optical depth of `medium` along `origin + t direction` for t in [t_min, t_max], for the channel of relative extinction one.
///
/// Exact but for rounding (double precision): along a line the trilinear field is a cubic in each voxel cell, which two Gauss
/// points integrate without error. Cost: two lookups per voxel cell crossed; empty cells are skipped at their largest size.
/// `t` is in multiples of the length of `direction`, which need not be a unit vector.
pub fn optical_depth(
    medium: &GridMedium,
    origin: DVec3,
    direction: DVec3,
    t_min: f64,
    t_max: f64,
    tally: &mut Tally,
) -> f64 {
    let world_to_local = medium.world_to_local();
    let o = world_to_local.transform_point3(origin);
    let d = world_to_local.transform_vector3(direction);
    let Some((t0, t1)) = medium.clip_local(o, d, t_min, t_max) else {
        return 0.0;
    };
    integrate(medium.grid(), o, d, t0, t1, tally) * f64::from(medium.scale()) * direction.length()
}

/// Integral of the field over `o + t d`, t in [t0, t1], in units of t.
fn integrate(grid: &VoxelGrid, o: DVec3, d: DVec3, t0: f64, t1: f64, tally: &mut Tally) -> f64 {
    let extent = grid.topology.extent;
    let top = grid.topology.top_log2();
    let mut t = t0;
    let start = o + d * t0;
    let mut ijk: [i32; 3] =
        std::array::from_fn(|axis| (start[axis] as i32).clamp(0, extent[axis] - 1));
    let offset = 0.5 / 3f64.sqrt();
    let mut sum = 0.0;
    while t < t1 && (0..3).all(|axis| (0..extent[axis]).contains(&ijk[axis])) {
        tally.majorant_steps += 1;
        // The largest empty cell around, or one voxel cell.
        let empty = |log2: u32| grid.cell_range(ijk, log2).1 == 0.0;
        let mut log2 = 0;
        if empty(2) {
            log2 = 2;
            while log2 < top && empty(log2 + 1) {
                log2 += 1;
            }
        }
        let size = 1i32 << log2;
        let low = ijk.map(|c| c & -size);
        let mut t_exit = f64::INFINITY;
        let mut axis = 0;
        for k in 0..3 {
            if d[k] != 0.0 {
                let face = f64::from(if d[k] > 0.0 { low[k] + size } else { low[k] });
                let t_face = (face - o[k]) / d[k];
                if t_face < t_exit {
                    (t_exit, axis) = (t_face, k);
                }
            }
        }
        let t_exit = t_exit.max(t);
        let end = t_exit.min(t1);
        if log2 == 0 && end > t {
            let (middle, half) = (0.5 * (t + end), end - t);
            sum += match grid.interpolation() {
                Interpolation::Nearest => {
                    tally.lookups += 1;
                    grid.interpolate_local(ijk, o + d * middle) * half
                }
                Interpolation::Trilinear => {
                    tally.lookups += 2;
                    let value = |t: f64| grid.interpolate_local(ijk, o + d * t);
                    0.5 * half * (value(middle - offset * half) + value(middle + offset * half))
                }
            };
        }
        if t_exit >= t1 || d == DVec3::ZERO {
            break;
        }
        t = t_exit;
        let p = o + d * t;
        for k in 0..3 {
            ijk[k] = if k == axis {
                if d[k] > 0.0 { low[k] + size } else { low[k] - 1 }
            } else {
                let c = (p[k] as i32).clamp(low[k], low[k] + size - 1);
                if d[k] >= 0.0 { c.max(ijk[k]) } else { c.min(ijk[k]) }
            };
        }
    }
    sum
}
