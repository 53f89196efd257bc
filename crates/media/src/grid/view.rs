//! Lookups: borrowed access to a render grid with a known voxel type.

use super::{
    BRICK_EDGE, BRICK_LOG2, BRICK_VALUES, Entry, Interpolation, Topology, Voxel, entry_index,
};
use glam::{DVec3, Vec3};

/// Offset of the neighbour in x within a brick.
const DX: usize = BRICK_EDGE * BRICK_EDGE;
/// Offset of the neighbour in y within a brick.
const DY: usize = BRICK_EDGE;

/// A render grid with a known voxel type, for hot loops.
#[derive(Debug)]
pub(crate) struct GridView<'a, V> {
    pub(crate) voxels: &'a [V],
    pub(crate) sub_max: &'a [[f32; 8]],
    pub(crate) entries: &'a [Entry],
    pub(crate) topology: &'a Topology,
    pub(crate) interpolation: Interpolation,
}

impl<V> Clone for GridView<'_, V> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<V> Copy for GridView<'_, V> {}

/// Which of a brick's eight 4^3 cells holds local voxel `ijk`.
#[inline(always)]
pub(crate) fn sub_cell(ijk: [i32; 3]) -> usize {
    ((ijk[0] & 4) | (ijk[1] & 4) >> 1 | (ijk[2] & 4) >> 2) as usize
}

/// Offset of local voxel `ijk` within its brick.
#[inline(always)]
fn offset(ijk: [i32; 3]) -> usize {
    let [x, y, z] = ijk.map(|c| (c & 7) as usize);
    x * DX + y * DY + z
}

impl<V: Voxel> GridView<'_, V> {
    /// The brick that holds local voxel `ijk`, which must lie within the extent.
    #[inline(always)]
    pub(crate) fn brick(&self, ijk: [i32; 3]) -> u32 {
        self.entries[entry_index(self.topology, self.entries, ijk, BRICK_LOG2)].child
    }

    /// Largest value in the cell of `2^log2` voxels (4 and coarser) around local voxel `ijk`.
    pub(crate) fn cell_max(&self, ijk: [i32; 3], log2: u32) -> f32 {
        if log2 < BRICK_LOG2 {
            self.sub_max[self.brick(ijk) as usize][sub_cell(ijk)]
        } else {
            self.entries[entry_index(self.topology, self.entries, ijk, log2)].max
        }
    }

    #[inline(always)]
    pub(crate) fn voxel(&self, ijk: [i32; 3]) -> f32 {
        self.voxels[self.brick(ijk) as usize * BRICK_VALUES + offset(ijk)].to_f32()
    }

    /// The value at lattice point `at`, by the brick of `ijk`, on whose far faces it may lie.
    pub(crate) fn corner(&self, ijk: [i32; 3], at: [i32; 3]) -> f32 {
        let base = self.brick(ijk) as usize * BRICK_VALUES;
        let [x, y, z] = [0, 1, 2].map(|axis| (at[axis] - (ijk[axis] & !7)) as usize);
        self.voxels[base + x * DX + y * DY + z].to_f32()
    }

    /// The interpolated value at local point `p` in brick `brick` of voxel `ijk = floor(p)`.
    #[inline(always)]
    pub(crate) fn interpolate_in_brick(&self, brick: u32, ijk: [i32; 3], p: Vec3) -> f32 {
        let base = brick as usize * BRICK_VALUES + offset(ijk);
        if self.interpolation == Interpolation::Nearest {
            return self.voxels[base].to_f32();
        }
        let v = &self.voxels[base..base + DX + DY + 2];
        let f = [p.x - ijk[0] as f32, p.y - ijk[1] as f32, p.z - ijk[2] as f32];
        // The four edges along x at once: lanes are (y, z) = 00, 01, 10, 11.
        let near = [v[0], v[1], v[DY], v[DY + 1]].map(Voxel::to_f32);
        let far = [v[DX], v[DX + 1], v[DX + DY], v[DX + DY + 1]].map(Voxel::to_f32);
        let mut a = [0.0f32; 4];
        for lane in 0..4 {
            a[lane] = near[lane] + f[0] * (far[lane] - near[lane]);
        }
        let y0 = a[0] + f[1] * (a[2] - a[0]);
        let y1 = a[1] + f[1] * (a[3] - a[1]);
        y0 + f[2] * (y1 - y0)
    }

    /// The interpolated value at local point `p`, in double precision.
    pub(crate) fn interpolate_f64(&self, ijk: [i32; 3], p: DVec3) -> f64 {
        let base = self.brick(ijk) as usize * BRICK_VALUES + offset(ijk);
        if self.interpolation == Interpolation::Nearest {
            return f64::from(self.voxels[base].to_f32());
        }
        let f = p - DVec3::from_array(ijk.map(f64::from));
        let value = |dx: usize, dy: usize, dz: usize| {
            f64::from(self.voxels[base + dx * DX + dy * DY + dz].to_f32())
        };
        let lerp = |a: f64, b: f64, t: f64| a * (1.0 - t) + b * t;
        let edge = |dx, dy| lerp(value(dx, dy, 0), value(dx, dy, 1), f.z);
        let face = |dx| lerp(edge(dx, 0), edge(dx, 1), f.y);
        lerp(face(0), face(1), f.x)
    }
}
