//! How thick the media of a scene are, roughly: what choices and weights may use, since they are
//! unbiased whatever it is.

use glam::DVec3;
use pileus_math::Bounds3;
use pileus_media::Medium;
use pileus_media::kernel::Shape;
use pileus_scene::Scene;

/// Points per axis at which media are looked up for their typical extinction.
const TYPICAL_LATTICE: u32 = 12;

/// Mean extinction over a medium's box, 1/length.
fn mean_sigma_t(medium: &Medium) -> f64 {
    match (medium.shape(), medium.bounds_world()) {
        (Shape::Box(shape), _) => f64::from(shape.sigma_t()),
        (Shape::Grid(grid), Some(bounds)) => {
            let n = TYPICAL_LATTICE;
            let at = |i: u32| (f64::from(i) + 0.5) / f64::from(n);
            let mut total = 0.0;
            for i in 0..n.pow(3) {
                let u = DVec3::new(at(i % n), at(i / n % n), at(i / (n * n)));
                total += grid.sigma_t_at(bounds.at(u));
            }
            total / f64::from(n.pow(3))
        }
        (Shape::Grid(_), None) => 0.0,
    }
}

/// Mean extinction over the media's boxes, summed over media, 1/length: what the weights of
/// equiangular points take for the flights' rate.
pub(crate) fn typical_sigma_t(scene: &Scene) -> f64 {
    let sum: f64 = scene.volumes.iter().map(|volume| mean_sigma_t(&volume.medium)).sum();
    // Without extinction nothing is scattered, whatever the weights are.
    if sum > 0.0 { sum } else { 1.0 }
}

/// Mean optical depth across the media's boxes, summed over media: mean extinction times the mean
/// chord `4 V / S` [Cauchy]. Infinite for media without bounds.
pub(crate) fn typical_depth(scene: &Scene) -> f64 {
    scene
        .volumes
        .iter()
        .map(|volume| {
            let sigma_t = mean_sigma_t(&volume.medium);
            let length = volume.medium.bounds_world().map_or(f64::INFINITY, Bounds3::mean_chord);
            if sigma_t > 0.0 { sigma_t * length } else { 0.0 }
        })
        .sum()
}
