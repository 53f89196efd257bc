//! Regular tracking: the exact optical depth, cell by cell.

use crate::grid::{GridView, Interpolation, Voxel};
use crate::medium::{GridMedium, VoxelKernel};
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
    struct Depth<'a> {
        medium: &'a GridMedium,
        ray: (DVec3, DVec3),
        range: (f64, f64),
        tally: &'a mut Tally,
    }
    impl VoxelKernel for Depth<'_> {
        type Output = f64;
        fn run<V: Voxel>(self, voxels: &[V]) -> f64 {
            ray_depth(&self.medium.grid().view(voxels), self.ray, self.range, self.tally)
        }
    }
    let kernel = Depth { medium, ray: (o, d), range: (t0, t1), tally };
    medium.with_voxels(kernel) * f64::from(medium.scale()) * direction.length()
}

/// Integral of the field over `o + t d`, t in [t0, t1], in units of t.
pub(crate) fn ray_depth<V: Voxel>(
    view: &GridView<'_, V>,
    ray: (DVec3, DVec3),
    range: (f64, f64),
    tally: &mut Tally,
) -> f64 {
    let mut sum = 0.0;
    voxel_cells(view, ray, range, tally, |ijk, a, b, tally| {
        sum += cell_depth(view, ray, ijk, (a, b), tally);
        true
    });
    sum
}

/// Where that integral from `t0` on reaches `depth`.
///
/// # Errors
/// The whole integral, if it is less.
pub(crate) fn ray_t_at_depth<V: Voxel>(
    view: &GridView<'_, V>,
    ray: (DVec3, DVec3),
    range: (f64, f64),
    depth: f64,
    tally: &mut Tally,
) -> Result<f64, f64> {
    let mut sum = 0.0;
    let mut found = None;
    voxel_cells(view, ray, range, tally, |ijk, a, b, tally| {
        let cell = cell_depth(view, ray, ijk, (a, b), tally);
        if !(sum + cell >= depth) || cell <= 0.0 {
            sum += cell;
            return true;
        }
        let target = depth - sum;
        // Newton's method on the quartic, kept between bounds by bisection.
        let (mut low, mut high) = (a, b);
        let mut t = a + (b - a) * target / cell;
        for _ in 0..60 {
            let excess = cell_depth(view, ray, ijk, (a, t), tally) - target;
            if excess.abs() <= 1e-12 * cell {
                break;
            }
            if excess > 0.0 {
                high = t;
            } else {
                low = t;
            }
            tally.lookups += 1;
            let newton = t - excess / view.interpolate_f64(ijk, ray.0 + ray.1 * t);
            t = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        }
        found = Some(t);
        false
    });
    found.ok_or(sum)
}

/// Integral over [a, b] within the voxel cell of `ijk`: exact, since the field is constant or a cubic in it.
fn cell_depth<V: Voxel>(
    view: &GridView<'_, V>,
    (o, d): (DVec3, DVec3),
    ijk: [i32; 3],
    (a, b): (f64, f64),
    tally: &mut Tally,
) -> f64 {
    let (middle, length) = (0.5 * (a + b), b - a);
    let value = |t: f64| view.interpolate_f64(ijk, o + d * t);
    match view.interpolation {
        Interpolation::Nearest => {
            tally.lookups += 1;
            value(middle) * length
        }
        Interpolation::Trilinear => {
            tally.lookups += 2;
            let offset = 0.5 / 3f64.sqrt() * length;
            0.5 * length * (value(middle - offset) + value(middle + offset))
        }
    }
}

/// Calls `visit` with every voxel cell along the ray that may hold extinction, and its range of t, until it returns false.
fn voxel_cells<V: Voxel>(
    view: &GridView<'_, V>,
    (o, d): (DVec3, DVec3),
    (t0, t1): (f64, f64),
    tally: &mut Tally,
    mut visit: impl FnMut([i32; 3], f64, f64, &mut Tally) -> bool,
) {
    let extent = view.topology.extent;
    let top = view.topology.top_log2();
    let mut t = t0;
    let start = o + d * t0;
    let mut ijk: [i32; 3] =
        std::array::from_fn(|axis| (start[axis] as i32).clamp(0, extent[axis] - 1));
    while t < t1 && (0..3).all(|axis| (0..extent[axis]).contains(&ijk[axis])) {
        tally.majorant_steps += 1;
        // The largest empty cell around, or one voxel cell.
        let empty = |log2: u32| view.cell_max(ijk, log2) == 0.0;
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
        if log2 == 0 && end > t && !visit(ijk, t, end, tally) {
            break;
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
}
