//! How the image of a job is sampled.

use pileus_integrator::{DEFAULT_MAX_EVENTS, RenderSettings, ShadowRoulette};
use pileus_media::distance::DistanceSampler;
use pileus_media::transmittance::Estimator;
use pileus_scene::option::{above, at_least, at_most, between, biased, pattern, unbiased, unit};
use pileus_scene::volume_spec::LARGEST_COLOR;
use pileus_scene::{options, whole};
use serde::Deserializer;

use super::auto::Auto;
use super::film::SMALLEST;
use super::rules;

/// Most samples per pixel.
pub(crate) const MAX_SPP: u64 = 1 << 32;

/// Tells a key that is null, `Some(None)`, from one that is not there, `None`; whole numbers may be
/// written as 4.0.
fn null_or_whole<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Option<u64>>, D::Error> {
    whole::option(deserializer).map(Some)
}

options! {
    /// How the image is sampled.
    #[derive(Default)]
    pub struct SamplingSpec {
        /// Samples per pixel.
        #[serde(deserialize_with = "whole::option")]
        spp: u64 = 64, between(1, MAX_SPP), unbiased();
        /// Seed of all random numbers: the same seed gives the same image, bit for bit.
        #[serde(deserialize_with = "whole::option")]
        seed: u64 = 0, unbiased();
        /// Most scattering events on a path: 0 shows the background through the volumes, 1 is
        /// single scattering. null is unlimited.
        #[serde(deserialize_with = "whole::option")]
        #[schemars(extend("default" = null))]
        max_bounces: u32, biased("longer paths are cut, which darkens the image");
        /// Most events on a path: bounces, lookups of the extinction and majorant cells, those of
        /// its shadow rays included. It ends paths that would not end by themselves, or after
        /// millions of events: in dense volumes that absorb nothing, in bodies whose mesh is open.
        /// Log, plan and metadata say how many were cut. null is unlimited.
        #[serde(deserialize_with = "null_or_whole")]
        max_events: Option<u64> = Some(DEFAULT_MAX_EVENTS), at_least(1),
            biased("the picture lacks the light of paths that were cut");
        /// How transmittance is estimated.
        transmittance: Auto<Estimator> = Auto(None);
        /// How distances are sampled.
        distance: Auto<DistanceSampler> = Auto(None);
        /// How grids are parted into cells with majorants: `auto` (the same as `adaptive`),
        /// `adaptive`, `hierarchy`, `kd_tree`, `uniform_N` (cells of N voxels) or `global`.
        #[schemars(extend("examples" = ["adaptive", "uniform_16"]))]
        majorants: String = "auto".to_owned(), pattern(rules::MAJORANTS), unbiased();
        /// Factor on the majorants of grids, for experiments: above 1 they are looser than need be,
        /// below 1 they do not bound, which only some methods allow.
        majorant_scale: f32 = 1.0, between(SMALLEST, LARGEST_COLOR), unbiased();
        /// What decides whether a shadow ray is sent from a point in a volume.
        shadow_roulette: Auto<ShadowRoulette> = Auto(None), unbiased();
        /// Largest luminance that a single sample may have: brighter ones, fireflies, are scaled
        /// down to it. The plan and the image's metadata say so, with the number of samples it met.
        /// null is no limit.
        #[schemars(extend("default" = null))]
        clamp: f32, between(SMALLEST, LARGEST_COLOR), unit("radiance"),
            biased("what few paths find is lost");
        /// Of `debiased_ray_marching` under a `law`: level j of the debiasing series costs 2^j
        /// and has a probability in proportion to 2^(-level_exponent j). Above 1, where the work is
        /// finite; the variance is infinite above 4 on most rays, and grows from far below where
        /// extinction has narrow features.
        level_exponent: f64 = RenderSettings::default().continuation_exponent, above(1), at_most(16), unbiased();
    }
}
