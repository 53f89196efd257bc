//! The interior media that the camera's rays start in.

use super::MediumStack;
use glam::DVec3;
use pileus_math::Bounds3;
use pileus_scene::{Camera, Surfaces};

/// The interior media that the camera's rays start in.
#[derive(Debug, Clone)]
pub(crate) enum CameraMedia {
    /// The same for all of them.
    Same(MediumStack),
    /// Found for each: the origins of rays, spread over an aperture or the film of an orthographic
    /// camera, may be on both sides of the surface of a body in this box.
    OfEachRay(Bounds3),
}

impl CameraMedia {
    /// Those of a camera, whose rays pass the film and up to `margin` pixels around it.
    pub(crate) fn new(surfaces: Option<&Surfaces>, camera: &Camera, margin: f64) -> CameraMedia {
        let Some(surfaces) = surfaces else { return CameraMedia::Same(MediumStack::new()) };
        if camera.has_one_origin() {
            return CameraMedia::Same(MediumStack::around(surfaces, camera.position()));
        }
        let origins = camera.origins(margin);
        let at_camera = |bounds: &Bounds3| bounds.overlaps(origins);
        match surfaces.body_bounds().filter(at_camera).reduce(Bounds3::union) {
            Some(bodies) => CameraMedia::OfEachRay(bodies),
            None => CameraMedia::Same(MediumStack::new()),
        }
    }

    /// Those of a ray from here; `None`: there are none.
    #[inline(always)]
    pub(super) fn at(&self, surfaces: Option<&Surfaces>, origin: DVec3) -> Option<MediumStack> {
        match self {
            // Nearly all cameras: nothing is called, nothing copied.
            CameraMedia::Same(media) if media.is_empty() => None,
            _ => Some(self.of_ray(surfaces, origin)),
        }
    }

    #[inline(never)]
    fn of_ray(&self, surfaces: Option<&Surfaces>, origin: DVec3) -> MediumStack {
        match (self, surfaces) {
            (CameraMedia::Same(media), _) => media.clone(),
            (CameraMedia::OfEachRay(bodies), Some(surfaces)) if bodies.contains(origin) => {
                MediumStack::around(surfaces, origin)
            }
            _ => MediumStack::new(),
        }
    }
}
