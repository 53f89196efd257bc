//! Regular tracking: the exact optical depth, cell by cell.

use crate::channels::Channels;
use crate::field::ExactField;
use crate::grid::{CellWalk, GridView, Interpolation, Voxel};
use crate::medium::{GridShape, Medium, Shape, VoxelKernel};
use crate::tally::Tally;
use glam::DVec3;
use pileus_math::Spectrum;

/// Optical depth whose transmittance is zero in single precision.
const OPAQUE: f64 = 88.0;

/// The transmittance of `field` per channel by its optical depth. Exact but for rounding. Cost: two
/// lookups per voxel cell up to where no channel has any light left.
pub(super) fn regular_tracking<F: ExactField, C: Channels>(
    field: F,
    channels: C,
    tally: &mut Tally,
) -> C::Value {
    // Behind what leaves no channel any light there is nothing to sum.
    let weakest = (0..C::Value::COUNT)
        .map(|channel| channels.of(1.0).channel(channel))
        .filter(|relative| *relative > 0.0)
        .fold(1.0, f32::min);
    let opaque = OPAQUE / f64::from(weakest);
    let depth = field.t_at_depth(opaque, tally).map_or_else(|all| all, |_| opaque);
    channels.of(depth as f32).map(|d| if d > 0.0 { -d } else { 0.0 }).exp()
}

/// The optical depth of `medium` along `origin + t direction` for t in [t_min, t_max], for its
/// strongest channel.
///
/// Exact but for rounding (double precision): along a line the trilinear field is a cubic in each
/// voxel cell, which two Gauss points integrate without error. Cost: two lookups per voxel cell
/// crossed; empty cells are skipped at their largest size; none for constant extinction.
/// `t` is in multiples of the length of `direction`, which need not be a unit vector. An upper
/// bound for microflakes by grid, whose largest projected area stands for all.
pub fn optical_depth(
    medium: &Medium,
    origin: DVec3,
    direction: DVec3,
    t_min: f64,
    t_max: f64,
    tally: &mut Tally,
) -> f64 {
    let depth = match medium.shape() {
        Shape::Grid(grid) => grid_depth(grid, (origin, direction), (t_min, t_max), tally),
        Shape::Box(constant) => match constant.clip(origin, direction, t_min, t_max) {
            // No extinction in all space: zero, not zero times infinity.
            Some((t0, t1)) if constant.sigma_t() > 0.0 => f64::from(constant.sigma_t()) * (t1 - t0),
            _ => 0.0,
        },
    };
    let depth = depth * direction.length();
    match medium.phase().microflakes() {
        None => depth,
        Some(microflakes) => {
            depth * f64::from(microflakes.largest_area(direction.normalize().as_vec3()))
        }
    }
}

/// Integral of the extinction over `t`, in its units.
fn grid_depth(
    grid: &GridShape,
    (origin, direction): (DVec3, DVec3),
    (t_min, t_max): (f64, f64),
    tally: &mut Tally,
) -> f64 {
    let placed = grid.placed();
    let (o, d) = (placed.to_local(origin), placed.vector_to_local(direction));
    let Some((t0, t1)) = placed.support().clip(o, d, t_min, t_max) else {
        return 0.0;
    };
    struct Depth<'a> {
        grid: &'a GridShape,
        ray: (DVec3, DVec3),
        range: (f64, f64),
        tally: &'a mut Tally,
    }
    impl VoxelKernel for Depth<'_> {
        type Output = f64;
        fn run<V: Voxel>(self, voxels: &[V]) -> f64 {
            ray_depth(&self.grid.voxels().view(voxels), self.ray, self.range, self.tally)
        }
    }
    let kernel = Depth { grid, ray: (o, d), range: (t0, t1), tally };
    grid.with_voxels(kernel) * f64::from(grid.sigma_t_scale())
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

/// Integral over [a, b] within the voxel cell of `ijk`: exact, since the field is constant or a
/// cubic in it.
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

/// Calls `visit` with every voxel cell along the ray that may hold extinction, and its range of t,
/// until it returns false.
fn voxel_cells<V: Voxel>(
    view: &GridView<'_, V>,
    ray: (DVec3, DVec3),
    range: (f64, f64),
    tally: &mut Tally,
    mut visit: impl FnMut([i32; 3], f64, f64, &mut Tally) -> bool,
) {
    let top = view.topology.top_log2();
    let mut walk = CellWalk::new(ray, range, view.topology.extent);
    while let Some(ijk) = walk.voxel() {
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
        let (start, end) = walk.cross(log2);
        if log2 == 0 && end > start && !visit(ijk, start, end, tally) {
            break;
        }
    }
}
