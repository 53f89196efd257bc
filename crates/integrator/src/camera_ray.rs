//! The ray that a path begins with.

use crate::media::Ray;
use crate::sampler::{LENS, PathSampler};
use pileus_scene::Camera;

/// The ray through a film point, and through a point of the aperture if the camera has a lens: its
/// numbers are stratified over the samples of a pixel, and drawn for a lens alone.
#[inline(always)]
pub(crate) fn camera_ray(camera: &Camera, film: [f64; 2], sampler: &PathSampler) -> Ray {
    let (origin, direction) = if camera.lens().is_none() {
        camera.ray(film)
    } else {
        let [u, v, ..] = sampler.stratified(LENS);
        camera.ray_through_lens(film, [u, v])
    };
    Ray { origin, direction }
}
