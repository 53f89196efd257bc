//! Assets of the repository for this crate's tests.
#![allow(dead_code, reason = "each test binary uses a part")]

use glam::{DAffine3, DMat3, DVec3};
use pileus_media::{Albedo, Interpolation, Medium, Phase, VoxelGrid, VoxelGridOptions};
use pileus_vdb::{Tree, VdbFile};
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Reads a scalar grid and its transform.
pub(crate) fn read(path: &Path, grid: &str) -> (Tree<f32>, DAffine3) {
    let file = VdbFile::open(path).unwrap();
    let index = file.find(grid).unwrap();
    let grid = file.read(index).unwrap();
    let m = grid.info.transform.index_to_world().unwrap();
    let row = |i: usize| DVec3::new(m[i][0], m[i][1], m[i][2]);
    let matrix = DMat3::from_cols(row(0), row(1), row(2));
    (grid.to_float().unwrap(), DAffine3::from_mat3_translation(matrix, row(3)))
}

pub(crate) fn asset(name: &str) -> PathBuf {
    root().join("scenes/assets").join(name)
}

pub(crate) fn medium(path: &Path, grid: &str, scale: f32) -> Medium {
    let (tree, index_to_world) = read(path, grid);
    let options = VoxelGridOptions { interpolation: Interpolation::Trilinear };
    let grid = Arc::new(VoxelGrid::from_tree(&tree, &options).unwrap());
    Medium::from_grid(
        grid,
        index_to_world,
        [scale; 3],
        Albedo::Constant([1.0; 3]),
        Phase::Isotropic,
    )
    .unwrap()
}
