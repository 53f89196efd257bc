//! How a scene is to be sampled.

use pileus_film::Filter;
use pileus_media::distance::DistanceSampler;
use pileus_media::majorant::MajorantStructure;
use pileus_media::method::{Expectation, Named};
use pileus_media::transmittance::Estimator;
use std::ops::Range;

/// Serialises a method as its name.
pub(crate) fn by_name<T: Named, S: serde::Serializer>(
    method: &T,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(method.name())
}

/// Which techniques find light that both shadow rays and paths can meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LightSampling {
    /// Shadow rays and paths, weighted by the balance heuristic; fires draw paths to themselves.
    #[default]
    Both,
    /// Paths alone, drawn to nothing: for comparisons. Delta lights, which no path can meet, are
    /// still sent shadow rays.
    Paths,
}

/// What decides whether a shadow ray is sent from a point in a medium. The expectation of the
/// picture does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShadowRoulette {
    /// What the lights may contribute unshadowed, times the path's throughput.
    Importance,
    /// That, times the transmittance that a prepass found around the point, over the radiance that
    /// the path was expected to bring.
    AdjointDriven,
}

impl Named for ShadowRoulette {
    const ALL: &'static [ShadowRoulette] =
        &[ShadowRoulette::Importance, ShadowRoulette::AdjointDriven];
    const TITLE: &'static str = "ShadowRoulette";
    const QUESTION: &'static str =
        "What decides whether a shadow ray is sent from a point in a volume";

    fn name(self) -> &'static str {
        match self {
            ShadowRoulette::Importance => "importance",
            ShadowRoulette::AdjointDriven => "expected",
        }
    }

    fn expectation(self) -> Option<Expectation> {
        Some(Expectation::Unbiased)
    }

    fn about(self) -> &'static str {
        match self {
            ShadowRoulette::Importance => {
                "What the lights may contribute unshadowed, times the path's throughput."
            }
            ShadowRoulette::AdjointDriven => {
                "That importance, times the transmittance that a prepass of 4096 paths found around the \
                 point, over the radiance that the path was expected to bring; where all lights that \
                 shadow rays are sent to are distant."
            }
        }
    }
}

/// The value of [`RenderSettings::max_events`] where nobody says otherwise: some tenths of a second
/// for one path.
pub const DEFAULT_MAX_EVENTS: u64 = 1 << 20;

/// How a scene is to be sampled. The value of a sample depends on these (but for the range), the
/// scene, the pixel and the sample's number.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderSettings {
    /// Numbers of the samples per pixel to render.
    pub samples: Range<u64>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Most scattering events on a path; `None`: unlimited.
    pub max_bounces: Option<u32>,
    /// Most events on a path, at least 1: bounces, evaluations of the extinction field and majorant
    /// cells visited, those of its shadow rays included. `None`: unlimited. **Biased** where paths
    /// are longer, which are cut and counted: it is there for scenes whose paths would not end.
    /// Looked at every so many bounces, 16 to 256: a path passes it by what it does in between.
    /// Where the channels of a path part, each branch counts for itself.
    pub max_events: Option<u64>,
    /// Pixel filter, by importance sampling.
    pub filter: Filter,
    /// How transmittance is estimated; `None`: as the plan finds best for the scene.
    pub transmittance: Option<Estimator>,
    /// How distances are sampled; `None`: as the plan finds best for the scene.
    pub distance: Option<DistanceSampler>,
    /// How grids are parted for their majorants.
    pub majorants: MajorantStructure,
    /// Factor on the majorants of grids: 1 unless an experiment wants them looser (above) or broken
    /// (below).
    pub majorant_scale: f32,
    /// Whether the default majorants run in the kernel that all structures share, which branches
    /// per step, instead of their own: to compare structures by equal means.
    pub shared_kernel: bool,
    /// Of debiased ray marching under non-exponential transmittance: level `j` has a probability in
    /// proportion to 2 to the power of minus `j` times this. Above 1, else the work is infinite;
    /// where it is too large the variance is.
    pub continuation_exponent: f64,
    /// What decides whether a shadow ray is sent from a point in a medium; `None`: what the plan
    /// finds better for the scene.
    pub shadow_roulette: Option<ShadowRoulette>,
    /// Which techniques find light that both can meet.
    pub light_sampling: LightSampling,
    /// Largest luminance of a single sample: brighter ones are scaled down to it. **Biased**: light
    /// that few paths find is lost. `None`: no limit.
    pub clamp: Option<f32>,
    /// Edge of the tiles that threads take, pixels. No influence on the image.
    pub tile_size: u32,
}

impl Default for RenderSettings {
    fn default() -> Self {
        RenderSettings {
            samples: 0..64,
            seed: 0,
            max_bounces: None,
            max_events: Some(DEFAULT_MAX_EVENTS),
            filter: Filter::default(),
            transmittance: None,
            distance: None,
            majorants: MajorantStructure::default(),
            majorant_scale: 1.0,
            shared_kernel: false,
            continuation_exponent: 1.5,
            shadow_roulette: None,
            light_sampling: LightSampling::Both,
            clamp: None,
            tile_size: 16,
        }
    }
}
