//! From what a user wrote about a volume without a grid to a medium.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use pileus_math::Bounds3;
use pileus_media::Medium;

use super::color::constant_albedo;
use super::phase;
use super::placement::move_box;
use super::request::{Volume, VolumeRequest, VolumeSource, name};
use super::transmittance_function::transmittance_function;
use crate::error::Error;
use crate::spec::volume_spec::{AlbedoSpec, DEFAULT_ALBEDO, HomogeneousSpec, Rgb};

pub(super) fn load_homogeneous(
    request: &VolumeRequest<'_>,
    homogeneous: &HomogeneousSpec,
    extinction: [f64; 3],
    placement: &DAffine3,
) -> Result<Volume, Error> {
    let (spec, place) = (request.spec, request.place);
    for (given, key) in [
        (spec.density.is_some(), "/density"),
        (spec.interpolation.is_some(), "/interpolation"),
        (spec.frame.is_some(), "/frame"),
        (spec.emission.is_some(), "/emission"),
    ] {
        if given {
            return Err(Error::invalid(
                place(key),
                "this key belongs to volumes with a grid",
                "remove it, or replace `homogeneous` by `vdb`; light and fog can be two volumes that overlap",
            ));
        }
    }
    let albedo = match &spec.albedo {
        Some(AlbedoSpec::Grid(_)) => {
            return Err(Error::invalid(
                place("/albedo"),
                "a homogeneous volume has no grids",
                "give the albedo as numbers",
            ));
        }
        Some(AlbedoSpec::Constant(rgb)) => constant_albedo(*rgb, place)?,
        None => constant_albedo(Rgb::Grey(DEFAULT_ALBEDO), place)?,
    };
    let phase = phase::phase(spec.phase.as_ref(), placement, place, None)?;
    let function = transmittance_function(spec, place)?;
    let bounds = homogeneous.bounds.map(|bounds| bounds.map(DVec3::from_array));
    let bounds = match bounds {
        None => None,
        Some([low, high]) => {
            Some(move_box(Bounds3::new(low, high), placement).ok_or_else(|| {
                Error::unsupported(
                    place("/homogeneous/bounds"),
                    "the box of a homogeneous volume is turned by its transform",
                    "only translation and scale are possible: boxes stay parallel to the axes",
                )
            })?)
        }
    };
    let sigma_t = extinction.map(|e| (e * homogeneous.sigma_t) as f32);
    let medium = Medium::homogeneous(sigma_t, bounds, albedo, phase)
        .map_err(|source| Error::medium(place("/homogeneous"), source))?
        .with_transmittance_function(function);
    Ok(Volume {
        name: name(request),
        medium: Arc::new(medium),
        emission: None,
        source: VolumeSource::Homogeneous,
    })
}
