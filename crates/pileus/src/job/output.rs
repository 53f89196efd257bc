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
    #[schemars(extend("allOf" = rules::output()))]
    pub struct OutputSpec {
        /// The image, OpenEXR: linear radiance and alpha, and nothing else, which is what all
        /// programs read. Default: the name of the job with `.exr`, in the current folder.
        #[schemars(extend("examples" = ["cloud.exr"]))]
        image: String, pattern(rules::EXR);
        /// Store the image's colours and alpha as 16-bit floats: half the size, values beyond 65504
        /// are clamped and counted. Layers stay 32-bit.
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
        /// Layers to keep beside radiance, alpha and variance, which are always kept.
        aovs: Vec<String> = Vec::new(), rules::aovs;
        /// Where the layers go, OpenEXR with 32-bit floats; null for nowhere. Default: the image's
        /// path with `.layers.exr`. With `-o` on the command line it follows the image.
        #[serde(deserialize_with = "even_null")]
        #[schemars(extend("examples" = ["cloud.layers.exr"]))]
        layers: Option<String>, pattern(rules::EXR);
        /// Write the layers into the image instead of a file of their own: scripts in Blender get
        /// no pixels of such an image, and Mitsuba takes it for no environment or texture.
        layers_in_image: bool = false;
    }
}
