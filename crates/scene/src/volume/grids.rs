//! Finding the grids of a file and describing them in messages.

use std::path::Path;

use glam::DVec3;
use pileus_math::Bounds3;
use pileus_media::Clamped;
use pileus_vdb::{GridClass, GridInfo, MetaValue, ValueType, VdbFile};

use super::placement::affine;
use crate::error::{Error, Place};
use crate::spec::volume_spec::DensitySpec;

/// What to do where it is not clear which grid is the density: what the remedy of that error begins
/// with, so that programs can say it in words of their own.
pub const NAME_THE_GRID: &str = "name one with `density`: {\"grid\": ...}";

/// The grid that gives the density: as named, else `density`, else the only fog volume.
pub(super) fn density_grid(
    file: &VdbFile,
    path: &Path,
    density: &DensitySpec,
    place: &dyn Fn(&str) -> Place,
) -> Result<usize, Error> {
    let place_of_grid = || place(if density.grid.is_some() { "/density/grid" } else { "/vdb" });
    let index = match &density.grid {
        Some(name) => file.find(name).map_err(|source| Error::vdb(place_of_grid(), source))?,
        None => default_density_grid(file).ok_or_else(|| {
            let names: Vec<String> = file.grids().iter().map(describe).collect();
            let (what, remedy) = if names.is_empty() {
                ("the file has no grids".to_owned(), "write it again with a fog volume".to_owned())
            } else {
                (
                    "it is not clear which grid is the density".to_owned(),
                    format!("{NAME_THE_GRID}; the file has {}", names.join(", ")),
                )
            };
            Error::missing(place_of_grid(), format!("{}: {what}", path.display()), remedy)
        })?,
    };
    let info = grid_info(file, index, path)?;
    if info.class == GridClass::LevelSet {
        return Err(Error::unsupported(
            place_of_grid(),
            format!(
                "{}: grid `{}` is a level set (distances), not a density",
                path.display(),
                info.name
            ),
            "convert it to a fog volume (Houdini: Convert VDB, OpenVDB: sdfToFogVolume)",
        ));
    }
    if matches!(info.value_type, ValueType::Vec3f | ValueType::Vec3d | ValueType::Vec3i) {
        return Err(Error::unsupported(
            place_of_grid(),
            format!("{}: grid `{}` holds vectors ({})", path.display(), info.name, info.type_name),
            "name a grid of numbers as the density",
        ));
    }
    Ok(index)
}

/// The index of the grid that a file without further word means: the first `density`, else the
/// only grid of floating-point numbers that is not a level set.
pub fn default_density_grid(file: &VdbFile) -> Option<usize> {
    let possible = |info: &GridInfo| {
        matches!(info.value_type, ValueType::Float | ValueType::Double | ValueType::Half)
            && info.class != GridClass::LevelSet
    };
    let grids = file.grids();
    if let Some(index) = grids.iter().position(|info| info.name == "density") {
        return Some(index);
    }
    let mut fogs = grids.iter().enumerate().filter(|(_, info)| possible(info));
    match (fogs.next(), fogs.next()) {
        (Some((index, _)), None) => Some(index),
        _ => None,
    }
}

pub(super) fn grid_info<'a>(
    file: &'a VdbFile,
    index: usize,
    path: &Path,
) -> Result<&'a GridInfo, Error> {
    file.grids().get(index).ok_or_else(|| {
        Error::missing(Place::file(path), format!("grid {index} does not exist"), "")
    })
}

pub(super) fn describe(info: &GridInfo) -> String {
    let level_set = if info.class == GridClass::LevelSet { ", level set" } else { "" };
    format!("`{}` ({}{level_set})", info.full_name(), info.value_type)
}

/// The box of a grid's active voxels in the file's world, by what its metadata say.
pub(super) fn box_by_metadata(info: &GridInfo) -> Option<Bounds3> {
    let corner = |name: &str| match info.metadata.get(name) {
        Some(MetaValue::Vec3i(corner)) => Some(DVec3::from_array(corner.map(f64::from))),
        _ => None,
    };
    let (low, high) = (corner("file_bbox_min")?, corner("file_bbox_max")?);
    Some(Bounds3::new(low, high).moved(&affine(info.transform.matrix().ok()?)))
}

/// Says what of a grid counts as something else.
pub(super) fn warn_of_clamped(
    clamped: &Clamped,
    path: &Path,
    grid: &GridInfo,
    what: &str,
    (low, high): (f32, f32),
) {
    let Clamped { non_finite, below, above, largest } = *clamped;
    let of = format!("{}: grid `{}`, {what}", path.display(), grid.full_name());
    if non_finite > 0 {
        tracing::warn!("{of}: {non_finite} values are not finite and count as 0");
    }
    if below > 0 {
        tracing::warn!("{of}: {below} values are below {low} and count as {low}");
    }
    if above > 0 {
        let bytes = if low == 0.0 && largest > 2.0 && largest <= 255.0 {
            "; if they are bytes, divide them by 255"
        } else {
            ""
        };
        tracing::warn!(
            "{of}: {above} values are above {high} and count as {high}, the largest is {largest}{bytes}"
        );
    }
}
