//! The path kernel: the null-scattering path integral [Miller et al. 2019] by free flights, phase
//! sampling and next-event estimation.
//!
//! Light that a path can only reach one way has weight one: delta lights by shadow rays, the
//! constant part of the environment by escape. What both can reach (the bright part of an
//! environment image, a sun's disc, emissive triangles) is weighted by the balance heuristic over
//! the densities of the whole null-scattering path. Both walks share the majorants, so all
//! exponentials cancel: the ratio of the light sampling's density to the path sampling's is
//! `p_light / (p_phase * product of null probabilities)`.
//!
//! A kernel is compiled for its media (events and channels, see [`crate::media`]) and its world
//! ([`World`]: volumes only, or surfaces and emissive volumes besides). What a scene has of lights,
//! weights and equiangular points is looked at once a vertex.

mod camera_media;
mod direct;
mod emission;
mod equiangular;
pub(crate) mod interior;
pub(crate) mod limits;
mod passage;
mod path;
mod recorder;
mod surface;
mod world;

pub(crate) use camera_media::CameraMedia;
pub(crate) use interior::MediumStack;
pub(crate) use limits::PathLimits;
pub(crate) use recorder::{DirectLight, LayerRecorder, Recorder};
pub(crate) use world::{VolumesAndSurfaces, VolumesOnly, World, luminance};

use crate::lights::Lights;
use crate::prepass::RadianceCache;
use pileus_scene::Environment;

/// What a kernel is compiled for and what it reads.
pub(crate) struct Kernel<'a, M, W> {
    pub(crate) media: M,
    pub(crate) world: W,
    pub(crate) lights: &'a Lights,
    pub(crate) environment: &'a Environment,
    pub(crate) limits: PathLimits<'a>,
    /// Whether some light can be met both by shadow rays and by paths, so that both are weighted.
    pub(crate) mis: bool,
    /// Whether points seen by point-like lights at equal angles are sampled besides flights.
    pub(crate) equiangular: bool,
    /// Extinction, 1/length, by which flights are taken to be distributed when they are weighted
    /// against equiangular points. Any positive value is unbiased.
    pub(crate) typical_sigma_t: f64,
    /// Whether flights end with the density of the medium and carry no weight, so that emission up
    /// to there may be counted as it is.
    pub(crate) analog_flights: bool,
    /// What shadow rays may bring, where a prepass has asked.
    pub(crate) radiance_cache: Option<&'a RadianceCache>,
}
