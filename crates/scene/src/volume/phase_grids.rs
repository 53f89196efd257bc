//! Reading the grids that a phase function of microflakes names.

use std::path::Path;
use std::time::Instant;

use glam::DAffine3;
use pileus_media::Clamped;
use pileus_vdb::{GridInfo, Tree, Values, VdbFile};

use super::grids::{describe, grid_info, warn_of_clamped};
use super::microflakes::{self, MicroflakeGrids};
use super::placement::between;
use crate::error::{Error, Place};

/// Grids of a phase function, from the file of its density.
pub(super) struct PhaseGrids<'a> {
    /// Seconds spent in reading files so far.
    pub(super) seconds_load: &'a mut f64,
    pub(super) place: &'a dyn Fn(&str) -> Place,
    pub(super) file: &'a VdbFile,
    pub(super) path: &'a Path,
    pub(super) density: &'a GridInfo,
}

impl PhaseGrids<'_> {
    fn read(
        &mut self,
        name: &str,
        key: &str,
    ) -> Result<(pileus_vdb::Grid, DAffine3, Place), Error> {
        let at = || (self.place)(&format!("{}/{key}", microflakes::POINTER));
        let vdb_error = |source| Error::vdb(at(), source);
        let index = self.file.find(name).map_err(vdb_error)?;
        let info = grid_info(self.file, index, self.path)?;
        let map = between(self.density, info, &at)?;
        let start = Instant::now();
        let grid = self.file.read(index).map_err(vdb_error)?;
        *self.seconds_load += start.elapsed().as_secs_f64();
        Ok((grid, map, at()))
    }
}

impl MicroflakeGrids for PhaseGrids<'_> {
    fn vectors(&mut self, name: &str, key: &str) -> Result<(Tree<[f32; 3]>, DAffine3), Error> {
        let (grid, map, place) = self.read(name, key)?;
        let info = grid.info.clone();
        let tree = match grid.values {
            Values::Vec3f(tree) => tree,
            Values::Vec3d(tree) => tree.map(|v| v.map(|c| c as f32)),
            _ => {
                return Err(Error::invalid(
                    place,
                    format!("grid {} holds no vectors", describe(&grid.info)),
                    "name a grid of type vec3s or vec3d",
                ));
            }
        };
        let all = (f32::NEG_INFINITY, f32::INFINITY);
        warn_of_clamped(&Clamped::vectors(&tree, all), self.path, &info, "flakes", all);
        Ok((tree, map))
    }

    fn numbers(&mut self, name: &str, key: &str) -> Result<(Tree<f32>, DAffine3), Error> {
        let (grid, map, place) = self.read(name, key)?;
        let info = grid.info.clone();
        let tree = grid.to_float().map_err(|source| Error::vdb(place, source))?;
        let range = (0.0, 1.0);
        warn_of_clamped(&Clamped::numbers(&tree, range), self.path, &info, "roughness", range);
        Ok((tree, map))
    }
}
