//! Microflakes by grids.

use super::sggx::{MIN_ROUGHNESS, Sggx};
use crate::Error;
use crate::grid::{Interpolation, VoxelGrid, VoxelGridOptions};
use crate::index_map::snapped;
use glam::{DAffine3, DVec3};
use pileus_vdb::{LEAF_VALUES, Tree};

/// A symmetric matrix per point, interpolated entry by entry, so that it stays positive: sums of
/// positive matrices are. One outside of its grids.
#[derive(Debug, Clone)]
struct MatrixGrid {
    diagonal: [VoxelGrid; 3],
    /// Entries xy, xz, yz plus one: grids hold no negative numbers.
    off_diagonal_plus_one: [VoxelGrid; 3],
    to_index: DAffine3,
}

impl MatrixGrid {
    fn at_index(&self, p_index: DVec3) -> ([f64; 3], [f64; 3]) {
        let p = self.to_index.transform_point3(p_index);
        (
            [0, 1, 2].map(|i| self.diagonal[i].interpolate(p)),
            [0, 1, 2].map(|i| self.off_diagonal_plus_one[i].interpolate(p) - 1.0),
        )
    }
}

/// How rough microflakes are.
#[derive(Debug, Clone)]
pub enum Roughness {
    /// One roughness everywhere, in [0.001, 1].
    Constant(f32),
    /// By a grid; values are clamped to [0.001, 1]. The map leads from the index space that is
    /// asked in to the grid's own.
    Grid(Box<(VoxelGrid, DAffine3)>),
}

impl Roughness {
    /// Roughness by a tree of numbers; `to_index` maps the index space of the medium that asks to
    /// that of this tree.
    ///
    /// # Errors
    /// If the tree spans more than 2^31 voxels along an axis.
    pub fn from_tree(tree: &Tree<f32>, to_index: DAffine3) -> Result<Roughness, Error> {
        Ok(Roughness::Grid(Box::new((voxels(tree)?, snapped(to_index)))))
    }

    fn at_index(&self, p_index: DVec3) -> f64 {
        let value = match self {
            Roughness::Constant(roughness) => f64::from(*roughness),
            Roughness::Grid(grid) => {
                let (grid, to_index) = &**grid;
                grid.interpolate(to_index.transform_point3(p_index))
            }
        };
        value.clamp(f64::from(MIN_ROUGHNESS), 1.0)
    }
}

/// Which matrix the grids hold.
#[derive(Debug, Clone)]
enum Kind {
    /// S over its largest diagonal entry.
    Entries { scale: f64 },
    /// The outer product of the axis; zero (isotropic) where there is none.
    Fibre(Roughness),
    /// The outer product of the normal; one (isotropic) where there is none.
    Surface(Roughness),
}

/// Microflakes by grids: the six entries of S, or an axis with a roughness.
#[derive(Debug, Clone)]
pub struct MicroflakeGrid {
    matrix: MatrixGrid,
    kind: Kind,
    largest_area: f32,
}

impl MicroflakeGrid {
    /// Microflakes by grids of the entries (xx, yy, zz) and (xy, xz, yz) of S. Where the diagonal
    /// is zero, also outside of the grids, microflakes are isotropic with area 1.
    ///
    /// # Errors
    /// If a matrix has an eigenvalue below zero, or an entry is not finite; the message names the
    /// voxel. Else as [`VoxelGrid::from_tree`].
    pub fn from_entries(
        diagonal: &Tree<[f32; 3]>,
        off_diagonal: &Tree<[f32; 3]>,
        to_index: DAffine3,
    ) -> Result<MicroflakeGrid, Error> {
        let diagonal = diagonal.clone().map(|d| if d == [0.0; 3] { [1.0; 3] } else { d });
        let all = diagonal.values().iter().chain(diagonal.tiles().iter().map(|tile| &tile.value));
        let scale = all
            .flatten()
            .filter(|entry| entry.is_finite())
            .fold(1.0f32, |largest, entry| largest.max(*entry));
        let scaled = |tree: &Tree<[f32; 3]>| tree.clone().map(|v| v.map(|entry| entry / scale));
        let matrix = MatrixGrid {
            diagonal: channels(&scaled(&diagonal), 0.0)?,
            off_diagonal_plus_one: channels(&scaled(off_diagonal), 1.0)?,
            to_index: snapped(to_index),
        };
        let mut largest = 1.0f64;
        let mut check = |p: [i32; 3], size: i32, given: [f32; 3]| {
            let p = DVec3::from_array(p.map(f64::from)) + 0.5 * f64::from(size - 1);
            let off = [0, 1, 2].map(|i| matrix.off_diagonal_plus_one[i].interpolate(p) - 1.0);
            let found = Sggx::new(given.map(|d| d / scale), off.map(|v| v as f32));
            match found.and_then(|s| s.eigenvalues()) {
                Some([_, _, high]) => {
                    largest = largest.max(high * f64::from(scale));
                    Ok(())
                }
                None => Err(Error::invalid(
                    format!("the matrix of voxel {p} is not positive: diagonal {given:?}"),
                    "write symmetric matrices without negative eigenvalues: xx, yy, zz and xy, xz, yz",
                )),
            }
        };
        for (i, leaf) in diagonal.leaves().iter().enumerate() {
            for (offset, value) in diagonal.leaf_values(i).iter().enumerate().take(LEAF_VALUES) {
                let step = [offset >> 6, offset >> 3 & 7, offset & 7].map(|s| s as i32);
                let p = [0, 1, 2].map(|axis| leaf.origin[axis].wrapping_add(step[axis]));
                check(p, 1, *value)?;
            }
        }
        for tile in diagonal.tiles() {
            check(tile.origin, 1 << tile.log2_size, tile.value)?;
        }
        let largest_area = (largest.sqrt() * (1.0 + 1e-5)) as f32;
        Ok(MicroflakeGrid { matrix, kind: Kind::Entries { scale: f64::from(scale) }, largest_area })
    }

    /// Microflakes around fibres along a grid of axes, of any length; isotropic where the axis is
    /// zero.
    ///
    /// # Errors
    /// If the tree spans more than 2^31 voxels along an axis.
    pub fn fibres(
        axes: &Tree<[f32; 3]>,
        roughness: Roughness,
        to_index: DAffine3,
    ) -> Result<MicroflakeGrid, Error> {
        MicroflakeGrid::from_axes(axes, Kind::Fibre(roughness), 0.0, to_index)
    }

    /// Microflakes of surfaces by a grid of normals, of any length; isotropic where the normal is
    /// zero.
    ///
    /// # Errors
    /// If the tree spans more than 2^31 voxels along an axis.
    pub fn surfaces(
        normals: &Tree<[f32; 3]>,
        roughness: Roughness,
        to_index: DAffine3,
    ) -> Result<MicroflakeGrid, Error> {
        MicroflakeGrid::from_axes(normals, Kind::Surface(roughness), 1.0, to_index)
    }

    /// `none`: the diagonal where there is no axis.
    fn from_axes(
        axes: &Tree<[f32; 3]>,
        kind: Kind,
        none: f32,
        to_index: DAffine3,
    ) -> Result<MicroflakeGrid, Error> {
        let unit = |v: [f32; 3]| glam::DVec3::from_array(v.map(f64::from)).try_normalize();
        let diagonal = axes.clone().map(|v| {
            unit(v).map_or([none; 3], |a| [a.x * a.x, a.y * a.y, a.z * a.z].map(|x| x as f32))
        });
        let off_diagonal = axes.clone().map(|v| {
            unit(v).map_or([0.0; 3], |a| [a.x * a.y, a.x * a.z, a.y * a.z].map(|x| x as f32))
        });
        let matrix = MatrixGrid {
            diagonal: channels(&diagonal, 0.0)?,
            off_diagonal_plus_one: channels(&off_diagonal, 1.0)?,
            to_index: snapped(to_index),
        };
        Ok(MicroflakeGrid { matrix, kind, largest_area: 1.0 + 1e-5 })
    }

    /// The microflakes at a point of the asking medium's index space.
    pub fn at_index(&self, p_index: DVec3) -> Sggx {
        let (diagonal, off_diagonal) = self.matrix.at_index(p_index);
        let of = |one: f64, factor: f64| {
            Sggx::new(
                diagonal.map(|d| (one + factor * d) as f32),
                off_diagonal.map(|d| (factor * d) as f32),
            )
        };
        let s = match &self.kind {
            Kind::Entries { scale } => of(0.0, *scale),
            Kind::Fibre(roughness) => {
                let r = roughness.at_index(p_index);
                let r2 = r * r;
                of(1.0, r2 - 1.0)
            }
            Kind::Surface(roughness) => {
                let r = roughness.at_index(p_index);
                let r2 = r * r;
                of(r2, 1.0 - r2)
            }
        };
        s.unwrap_or(Sggx::ISOTROPIC)
    }

    /// Bound of the projected area over all microflakes of the grid and all directions.
    pub fn largest_area(&self) -> f32 {
        self.largest_area
    }
}

fn voxels(tree: &Tree<f32>) -> Result<VoxelGrid, Error> {
    VoxelGrid::from_tree(tree, &VoxelGridOptions { interpolation: Interpolation::Trilinear })
}

/// Three grids of numbers of a grid of vectors, plus `shift`.
fn channels(tree: &Tree<[f32; 3]>, shift: f32) -> Result<[VoxelGrid; 3], Error> {
    let channel = |i: usize| voxels(&tree.clone().map(|v| v[i] + shift));
    Ok([channel(0)?, channel(1)?, channel(2)?])
}
