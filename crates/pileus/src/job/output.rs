//! Which files a job writes.

use pileus_scene::option::{between, pattern, unit};
use pileus_scene::options;
use serde::{Deserialize, Deserializer};

use super::rules;

/// A value whose null means something else than its absence.
fn even_null<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<Option<T>>, D::Error> {
    Option::deserialize(deserializer).map(Some)
}

options! {
    /// Which files are written, each beside its target and renamed when it is whole.
    #[derive(Default)]
    pub struct OutputSpec {
        /// The image, OpenEXR: linear radiance, alpha, and the variance of each pixel's mean as the
        /// layer `variance`. Default: the name of the job with `.exr`, in the current folder.
        #[schemars(extend("examples" = ["cloud.exr"]))]
        image: String, pattern(rules::EXR);
        /// Store the image's colours and alpha as 16-bit floats: half the size, values beyond 65504
        /// are clamped and counted. The variance stays 32-bit.
        half: bool = false;
        /// A PNG to look at, tone-mapped by a filmic curve; null for none. Default: the image's
        /// path with `.png`. With `-o` on the command line it follows the image.
        #[serde(deserialize_with = "even_null")]
        #[schemars(extend("examples" = ["cloud.png"]))]
        preview: Option<String>, pattern(rules::PNG);
        /// Exposure of the preview: radiance is multiplied by `2^exposure` before the curve.
        exposure: f32 = 0.0, between(-64, 64), unit("stops");
        /// Counters and times as JSON; null for none. Default: the image's path with `.stats.json`.
        #[serde(deserialize_with = "even_null")]
        #[schemars(extend("examples" = ["cloud.stats.json"]))]
        stats: Option<String>, pattern(rules::FILE);
        /// Further quantities to write. This version has none: the list must be empty.
        aovs: Vec<String> = Vec::new(), rules::no_aovs;
    }
}
