//! The density of volumes about which nobody said how dense they are.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use pileus_media::{Albedo, Medium, Phase, VoxelGrid};

/// The extinction of a grid value of 1 that nobody specified.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefaultScale {
    /// One per scene unit.
    One,
    /// What makes the volume look like a cloud, see [`automatic_scale`]; or like a fire if nothing
    /// is said about light and the file has a grid `flame`, `flames`, `heat` or `temperature`.
    Cloud,
}

/// Median optical depth that [`automatic_scale`] aims at.
pub const CLOUD_OPTICAL_DEPTH: f64 = 20.0;

/// The extinction per scene unit at grid value 1 that makes a volume look like a cloud.
///
/// The exact optical depths along a fixed lattice of rays through the volume's bounds, parallel to
/// each axis, are computed; the scale lifts the median of those that are not negligible to
/// [`CLOUD_OPTICAL_DEPTH`]. 1 for a volume without density.
pub fn automatic_scale(
    grid: &Arc<VoxelGrid>,
    index_to_world: &DAffine3,
) -> Result<f64, pileus_media::Error> {
    let scale = CLOUD_OPTICAL_DEPTH / median_depth(grid, index_to_world)?;
    Ok(if scale.is_finite() { scale } else { 1.0 })
}

/// The median of the optical depths at scale 1 that are not negligible, see [`automatic_scale`]; 0
/// for a volume without density.
pub(super) fn median_depth(
    grid: &Arc<VoxelGrid>,
    index_to_world: &DAffine3,
) -> Result<f64, pileus_media::Error> {
    /// Rays along each axis: 16 x 16.
    const SIDE: usize = 16;
    let albedo = Albedo::Constant([1.0; 3]);
    let medium =
        Medium::from_grid(grid.clone(), *index_to_world, [1.0; 3], albedo, Phase::Isotropic)?;
    let Some(bounds) = medium.bounds_world() else { return Ok(0.0) };
    let size = bounds.size();
    let mut depths = Vec::with_capacity(3 * SIDE * SIDE);
    for axis in 0..3 {
        let along = DVec3::AXES[axis];
        let (across, beside) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
        for i in 0..SIDE * SIDE {
            let at = |k: usize| (k as f64 + 0.5) / SIDE as f64;
            let offset = across * at(i % SIDE) + beside * at(i / SIDE);
            let length = size.dot(along);
            let mut tally = pileus_media::Tally::default();
            depths.push(pileus_media::optical_depth(
                &medium,
                bounds.low + size * offset,
                along,
                0.0,
                length,
                &mut tally,
            ));
        }
    }
    let largest = depths.iter().copied().fold(0.0f64, f64::max);
    depths.retain(|&depth| depth > 0.01 * largest);
    depths.sort_by(f64::total_cmp);
    Ok(depths.get(depths.len() / 2).copied().unwrap_or(0.0))
}
