//! What a plan says of each volume, and how dense they are.

use crate::settings::RenderSettings;
use pileus_media::{Albedo, Medium};
use pileus_scene::{Scene, Volume};
use serde::Serialize;

/// A volume as planned.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannedVolume {
    /// The user's name for it.
    pub name: String,
    /// `grid` or `homogeneous`.
    pub kind: &'static str,
    /// Whether all channels have the same extinction.
    pub grey: bool,
    /// Largest extinction, 1/scene unit.
    pub sigma_t_max: f64,
    /// Stored precision of the voxels; none for homogeneous media.
    pub voxels: Option<&'static str>,
    /// Bytes of voxels, bounds and tables.
    pub bytes: u64,
    /// Transmittance function; none is the exponential one.
    #[serde(rename = "law")]
    pub transmittance_function: Option<String>,
    /// Phase function.
    pub phase: String,
    /// Albedo.
    pub albedo: String,
}

/// Optical depth per voxel from which on walks by tentative collisions lose to exact ones whatever
/// else there is: they take its root at every edge, and all of it where a cell is empty beside a
/// voxel.
pub(super) const DENSE: f64 = 16_384.0;

/// Optical depth per voxel from which on walks by tentative collisions do not end.
pub(super) const TOO_DENSE: f64 = 1e7;

/// Whether a medium has any extinction: no path asks for others.
pub(crate) fn extinguishes(medium: &Medium) -> bool {
    medium.largest_sigma_t() > 0.0 && (medium.grid().is_none() || medium.bounds_world().is_some())
}

/// Optical depth per voxel of a volume's majorants, at most; zero for homogeneous media.
pub(super) fn depth_of(volume: &Volume, settings: &RenderSettings) -> f64 {
    let depth = volume.medium.grid().map_or(0.0, |grid| grid.majorant_depth_per_voxel());
    depth * f64::from(settings.majorant_scale.max(1.0))
}

/// The largest optical depth per voxel of the majorants, and the volume's name.
pub(super) fn densest<'a>(scene: &'a Scene, settings: &RenderSettings) -> Option<(f64, &'a str)> {
    let of = |volume: &'a Volume| (depth_of(volume, settings), volume.name.as_str());
    scene.volumes.iter().map(of).max_by(|a, b| a.0.total_cmp(&b.0))
}

pub(super) fn describe(name: &str, medium: &Medium) -> PlannedVolume {
    let phase = medium.phase().to_string();
    let color = |c: [f32; 3]| {
        if c[0] == c[1] && c[1] == c[2] { c[0].to_string() } else { format!("{c:?}") }
    };
    let report = medium.grid().map(|grid| grid.voxels().report());
    PlannedVolume {
        name: name.to_owned(),
        kind: if report.is_some() { "grid" } else { "homogeneous" },
        grey: medium.is_grey(),
        sigma_t_max: medium.largest_sigma_t(),
        voxels: report.map(|report| if report.stored_as_half { "binary16" } else { "binary32" }),
        bytes: report.map_or(0, |r| r.bytes_voxels + r.bytes_bounds + r.bytes_index),
        transmittance_function: medium.transmittance_function().map(ToString::to_string),
        phase,
        albedo: match medium.optics().albedo() {
            Albedo::Constant(albedo) => color(*albedo),
            Albedo::Grid(_) => "grid".to_owned(),
        },
    }
}
