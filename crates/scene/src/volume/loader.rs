//! What loading volumes remembers: files and render grids, so that volumes made of the same grid
//! share it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use pileus_media::{ColorGrid, Interpolation, VoxelGrid, VoxelGridOptions};
use pileus_vdb::{Tree, Values, VdbFile};

use crate::error::{Error, Place};
use crate::spec::Hint;

/// What a render grid is made of: file, grid, channel of a vector grid, and whether values are
/// those of the nearest voxel.
type GridKey = (PathBuf, usize, Option<usize>, bool);

/// Loads volumes; remembers files and grids, so that volumes made of the same grid share it.
#[derive(Default)]
pub struct VolumeLoader {
    files: HashMap<PathBuf, Arc<VdbFile>>,
    grids: HashMap<GridKey, Arc<VoxelGrid>>,
    /// Albedos by file, grid, and grid of the density.
    pub(super) albedos: HashMap<(PathBuf, usize, String), Arc<ColorGrid>>,
    /// What was chosen without being asked for, as sentences for people.
    pub notes: Vec<String>,
    /// Which of these choices can be made otherwise.
    pub hints: Vec<Hint>,
    /// Seconds spent in reading files so far.
    pub seconds_load: f64,
    /// Seconds spent in building render grids so far.
    pub seconds_build: f64,
}

impl VolumeLoader {
    /// Adds a note once, however many volumes are made alike.
    pub(super) fn note(&mut self, note: String) {
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    /// The OpenVDB files that were read so far, in no order.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.keys().map(PathBuf::as_path)
    }

    /// An OpenVDB file, opened once.
    pub(super) fn open(
        &mut self,
        path: &Path,
        place: &dyn Fn() -> Place,
    ) -> Result<Arc<VdbFile>, Error> {
        if let Some(file) = self.files.get(path) {
            return Ok(file.clone());
        }
        let start = Instant::now();
        let file = VdbFile::open(path).map_err(|source| Error::vdb(place(), source))?;
        let file = Arc::new(file);
        self.files.insert(path.to_owned(), file.clone());
        self.seconds_load += start.elapsed().as_secs_f64();
        Ok(file)
    }

    /// The render grid of a grid of numbers, read and built once.
    pub(super) fn grid(
        &mut self,
        file: &VdbFile,
        path: &Path,
        index: usize,
        interpolation: Interpolation,
        place: &dyn Fn() -> Place,
    ) -> Result<Arc<VoxelGrid>, Error> {
        let key = (path.to_owned(), index, None, interpolation == Interpolation::Nearest);
        if let Some(grid) = self.grids.get(&key) {
            return Ok(grid.clone());
        }
        let start = Instant::now();
        let tree = file
            .read(index)
            .and_then(pileus_vdb::Grid::to_float)
            .map_err(|source| Error::vdb(place(), source))?;
        self.seconds_load += start.elapsed().as_secs_f64();
        self.render_grid(key, &tree, interpolation, place)
    }

    /// The render grids of the channels of a vector grid, read and built once.
    pub(super) fn channels(
        &mut self,
        file: &VdbFile,
        path: &Path,
        index: usize,
        interpolation: Interpolation,
        place: &dyn Fn() -> Place,
    ) -> Result<[Arc<VoxelGrid>; 3], Error> {
        let keys = [0, 1, 2].map(|channel| {
            (path.to_owned(), index, Some(channel), interpolation == Interpolation::Nearest)
        });
        if let [Some(r), Some(g), Some(b)] = [0, 1, 2].map(|i| self.grids.get(&keys[i])) {
            return Ok([r.clone(), g.clone(), b.clone()]);
        }
        let start = Instant::now();
        let grid = file.read(index).map_err(|source| Error::vdb(place(), source))?;
        let channel = |i: usize| match &grid.values {
            Values::Vec3f(tree) => Some(tree.clone().map(|v| v[i])),
            Values::Vec3d(tree) => Some(tree.clone().map(|v| v[i] as f32)),
            Values::Vec3i(tree) => Some(tree.clone().map(|v| v[i] as f32)),
            _ => None,
        };
        let [Some(r), Some(g), Some(b)] = [channel(0), channel(1), channel(2)] else {
            return Err(Error::invalid(
                place(),
                format!("{}: the grid holds numbers, not vectors", path.display()),
                "write the file again",
            ));
        };
        self.seconds_load += start.elapsed().as_secs_f64();
        let [at_r, at_g, at_b] = keys;
        Ok([
            self.render_grid(at_r, &r, interpolation, place)?,
            self.render_grid(at_g, &g, interpolation, place)?,
            self.render_grid(at_b, &b, interpolation, place)?,
        ])
    }

    fn render_grid(
        &mut self,
        key: GridKey,
        tree: &Tree<f32>,
        interpolation: Interpolation,
        place: &dyn Fn() -> Place,
    ) -> Result<Arc<VoxelGrid>, Error> {
        let start = Instant::now();
        let grid = VoxelGrid::from_tree(tree, &VoxelGridOptions { interpolation })
            .map_err(|source| Error::medium(place(), source))?;
        self.seconds_build += start.elapsed().as_secs_f64();
        let report = grid.report();
        for (count, what) in
            [(report.replaced_non_finite, "not finite"), (report.replaced_negative, "negative")]
        {
            if count > 0 {
                tracing::warn!("{}: {count} values are {what} and count as 0", key.0.display());
            }
        }
        let grid = Arc::new(grid);
        self.grids.insert(key, grid.clone());
        Ok(grid)
    }
}
