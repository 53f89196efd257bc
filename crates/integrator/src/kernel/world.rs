//! What a path can meet besides media: nothing, or surfaces and emissive volumes. Kernels for
//! volumes only have none of this compiled.

use super::camera_media::CameraMedia;
use super::surface::SurfacePath;
use crate::media::Ray;
use glam::{DVec3, Vec3};
pub(crate) use pileus_math::luminance;
use pileus_media::emission::EmissionField;
use pileus_scene::{Hit, Interaction, Surfaces};
use rand_core::Rng;
use std::sync::Arc;

/// What a kernel is compiled with.
pub(crate) trait World: Sync {
    /// Whether there is anything: all else is left out if not.
    const SURFACES: bool;

    /// What a path carries on account of it.
    type Carried: Clone;

    /// What a path from the camera carries, that begins with this ray.
    fn begin(&self, ray: &Ray) -> Self::Carried;

    /// What a path carries on account of surfaces.
    fn of(carried: &Self::Carried) -> Option<&SurfacePath>;

    /// What a path carries on account of surfaces, to be changed.
    fn of_mut(carried: &mut Self::Carried) -> Option<&mut SurfacePath>;

    /// The triangles.
    fn surfaces(&self) -> Option<&Surfaces>;

    /// Volumes that emit light.
    fn emissive_volumes(&self) -> &[Arc<EmissionField>];

    /// The nearest surface on a ray; `camera`: it is still the camera's own, which backs of
    /// single-sided surfaces do not stop.
    #[inline(always)]
    fn intersect<R: Rng>(&self, ray: &Ray, camera: bool, rng: &mut R) -> Option<Hit> {
        let surfaces = self.surfaces()?;
        if !surfaces.may_be_met(ray.origin, ray.direction, f64::INFINITY) {
            return None;
        }
        if camera {
            return surfaces.seen(ray.origin, ray.direction, f64::INFINITY, rng);
        }
        surfaces.intersect(ray.origin, ray.direction, f64::INFINITY, rng)
    }

    /// The surfaces, if light may go straight through one of them.
    #[inline(always)]
    fn panes(&self) -> Option<&Surfaces> {
        self.surfaces().filter(|surfaces| surfaces.has_panes())
    }

    /// The surface that a ray meets next in the very place that it leaves: of faces that coincide
    /// the one behind.
    #[inline(always)]
    fn next_layer<R: Rng>(&self, from: &Interaction, wi: Vec3, rng: &mut R) -> Option<Hit> {
        self.surfaces()?.next_layer(from, wi, rng)
    }

    /// Whether a surface hides what lies at `distance`, or at `end` if that is a point of an
    /// emissive triangle.
    #[inline(always)]
    fn occluded<R: Rng>(
        &self,
        ray: &Ray,
        distance: f64,
        end: Option<(DVec3, u32)>,
        rng: &mut R,
    ) -> bool {
        let Some(surfaces) = self.surfaces() else { return false };
        match end {
            Some((end, emitter)) => surfaces.hides_lamp(ray.origin, end, emitter, rng),
            None => surfaces.occluded(ray.origin, ray.direction, distance, rng),
        }
    }
}

/// Nothing but media.
pub(crate) struct VolumesOnly;

impl World for VolumesOnly {
    const SURFACES: bool = false;
    type Carried = ();

    #[inline(always)]
    fn begin(&self, _: &Ray) {}

    #[inline(always)]
    fn of((): &()) -> Option<&SurfacePath> {
        None
    }

    #[inline(always)]
    fn of_mut((): &mut ()) -> Option<&mut SurfacePath> {
        None
    }

    #[inline(always)]
    fn surfaces(&self) -> Option<&Surfaces> {
        None
    }

    #[inline(always)]
    fn emissive_volumes(&self) -> &[Arc<EmissionField>] {
        &[]
    }
}

/// Media, surfaces and emissive volumes.
#[derive(Debug, Clone)]
pub(crate) struct VolumesAndSurfaces<'a> {
    pub(crate) surfaces: Option<&'a Surfaces>,
    pub(crate) emissive_volumes: &'a [Arc<EmissionField>],
    /// The interior media that the camera's rays start in.
    pub(crate) camera_in: CameraMedia,
}

impl World for VolumesAndSurfaces<'_> {
    const SURFACES: bool = true;
    type Carried = SurfacePath;

    #[inline(always)]
    fn begin(&self, ray: &Ray) -> SurfacePath {
        let mut path = SurfacePath::begin();
        if let Some(interiors) = self.camera_in.at(self.surfaces, ray.origin) {
            path.interiors = interiors;
        }
        path
    }

    #[inline(always)]
    fn of(carried: &SurfacePath) -> Option<&SurfacePath> {
        Some(carried)
    }

    #[inline(always)]
    fn of_mut(carried: &mut SurfacePath) -> Option<&mut SurfacePath> {
        Some(carried)
    }

    #[inline(always)]
    fn surfaces(&self) -> Option<&Surfaces> {
        self.surfaces
    }

    #[inline(always)]
    fn emissive_volumes(&self) -> &[Arc<EmissionField>] {
        self.emissive_volumes
    }
}
