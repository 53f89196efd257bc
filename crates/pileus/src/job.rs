//! The job file as people write it: optional fields, unknown keys refused.
//!
//! The doc comments here are the reference: `pileus schema` and the page made from it print them.

use pileus_integrator::DEFAULT_MAX_EVENTS;
use pileus_scene::volume_spec::{LARGEST_COLOR, Rgb, VolumeSpec};
use pileus_scene::whole;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use crate::job_rules as rules;

/// Vertical opening angle of cameras that do not name one, degrees.
pub const DEFAULT_FOV_Y: f64 = 35.0;
/// Samples per pixel of jobs that do not say.
pub const DEFAULT_SPP: u64 = 64;
/// Half width of the pixel filter of jobs that do not say, pixels.
pub const DEFAULT_FILTER_RADIUS: f32 = 0.5;
/// Most samples per pixel.
pub const MAX_SPP: u64 = 1 << 32;
/// Smallest positive number that single precision has with all its digits.
pub const SMALLEST: f64 = 1.2e-38;
/// Lumens per watt of glTF lights of jobs that do not say.
pub const DEFAULT_LUMENS_PER_WATT: f64 = 683.0;

/// A job: what to render, from where, in which light, how well, and where to put it.
///
/// Paths are relative to the job file. Lengths are scene units, angles degrees, colours linear
/// Rec. 709, coordinates right-handed with +Y up. Comments and unknown keys are refused.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Pileus job", extend("allOf" = rules::job()))]
pub struct Job {
    /// The schema that editors should check this file against; ignored.
    #[serde(default, rename = "$schema", skip_serializing_if = "Option::is_none")]
    pub schema: Option<String>,
    /// A glTF scene (`.gltf` or `.glb`): its cameras, punctual lights and volumes are rendered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("examples" = ["shot.gltf"]))]
    pub scene: Option<String>,
    /// How the glTF scene is read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gltf: Option<GltfSpec>,
    /// Volumes, added to those of the scene. They may overlap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volumes: Option<Vec<VolumeSpec>>,
    /// The camera. Default: the first camera of the scene, else one that frames the volumes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraSpec>,
    /// Lights, added to those of the scene. Without any light in job and scene: the default sky, a
    /// sun and a blue gradient.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(transform = rules::one_image)]
    pub lights: Option<Vec<LightSpec>>,
    /// Size and filter of the image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub film: Option<FilmSpec>,
    /// How the image is sampled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampling: Option<SamplingSpec>,
    /// Which files are written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<OutputSpec>,
}

/// How a glTF scene is read.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GltfSpec {
    /// Candela and lux of punctual lights are divided by this to give radiant units; 1 takes the
    /// numbers as they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = DEFAULT_LUMENS_PER_WATT))]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub lumens_per_watt: Option<f64>,
    /// What a transmissive surface without `KHR_materials_volume` is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "closed_meshes_are_solid"))]
    pub glass: Option<GlassSpec>,
}

/// What a transmissive surface without `KHR_materials_volume` is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GlassSpec {
    /// An infinitely thin wall that bends nothing, as glTF says.
    ByTheLetter,
    /// A body that bends light if its mesh is closed, as modelling programs mean it; else a thin wall.
    ClosedMeshesAreSolid,
}

/// A perspective camera: `position` and `look_at`, or the `node` of a camera in the glTF scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("allOf" = rules::camera()))]
pub struct CameraSpec {
    /// Name of a glTF node with a camera; excludes the keys of placement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("examples" = ["Camera.001"]))]
    pub node: Option<String>,
    /// Where the camera stands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 3]>,
    /// What it looks at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look_at: Option<[f64; 3]>,
    /// What is up in the image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = [0, 1, 0]))]
    #[schemars(transform = rules::directed)]
    pub up: Option<[f64; 3]>,
    /// Full vertical opening angle in degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = DEFAULT_FOV_Y))]
    #[schemars(extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 180))]
    pub fov_y: Option<f64>,
    /// When the shutter opens and closes. Motion is not rendered by this version: both must be 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = [0, 0]))]
    #[schemars(transform = rules::shutter)]
    pub shutter: Option<[f64; 2]>,
}

/// A light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum LightSpec {
    /// Light from infinitely far away.
    Sun {
        /// Direction from the scene to the sun, of any length.
        #[schemars(transform = rules::directed)]
        to_light: [f64; 3],
        /// Irradiance on a plane facing the sun.
        irradiance: Rgb,
        /// Full opening angle of the disc in degrees; 0 is a single direction.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = 0))]
        #[schemars(extend("minimum" = 0, "exclusiveMaximum" = 180))]
        angular_diameter: Option<f64>,
    },
    #[schemars(extend("allOf" = rules::environment()))]
    /// Light from all around: either `radiance` or `image`.
    Environment {
        /// The same radiance from all directions.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        radiance: Option<Rgb>,
        /// A latitude-longitude image (`.exr` or `.hdr`), +Y up, its middle column at -Z.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image: Option<String>,
        /// Factor on the image.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = 1))]
        #[schemars(extend("minimum" = 0, "maximum" = LARGEST_COLOR))]
        intensity: Option<f64>,
        /// Turns the image counter-clockwise seen from above, degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = 0))]
        rotation_y: Option<f64>,
    },
    #[schemars(extend("allOf" = rules::sky()))]
    /// Sun and sky of a clear day, in W/(m2 sr) weighted by the eye (times 683: cd/m2). The sun stands at `to_sun`, or at `elevation` and
    /// `azimuth`, no lower than 6 degrees below the horizon. Excludes environments with an `image`.
    Sky {
        /// Direction from the scene to the sun, of any length.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(transform = rules::directed)]
        to_sun: Option<[f64; 3]>,
        /// The sun's height above the horizon in degrees, -6 to 90.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("minimum" = -6, "maximum" = 90))]
        elevation: Option<f64>,
        /// Where the sun stands, degrees clockwise seen from above: 0 is at -Z, 90 at +X. Goes with `elevation`, default 0.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        azimuth: Option<f64>,
        /// Haze, 1 to 10: 2 is very clear, 3 clear, 6 hazy.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = 3.0))]
        #[schemars(extend("minimum" = 1, "maximum" = 10))]
        turbidity: Option<f64>,
        /// Share of light that the ground reflects: what is below the horizon, and a glow in the sky.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = 0.2))]
        #[schemars(transform = rules::at_most_one)]
        ground_albedo: Option<Rgb>,
        /// Factor on sun, sky and ground; 1 is physical.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = 1))]
        #[schemars(extend("minimum" = 0, "maximum" = 1e12))]
        intensity: Option<f64>,
        /// Whether the sun's disc is there. The sky stays the same without it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = true))]
        sun: Option<bool>,
        /// Full opening angle of the sun's disc in degrees; 0 is a single direction. Its irradiance stays the same.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = 0.53))]
        #[schemars(extend("minimum" = 0, "exclusiveMaximum" = 180))]
        sun_angular_diameter: Option<f64>,
    },
    /// Light from a point, the same in all directions.
    Point {
        /// Where it is.
        position: [f64; 3],
        /// Radiant intensity per steradian: irradiance at distance 1, facing the light.
        intensity: Rgb,
    },
}

/// Size and filter of the image.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilmSpec {
    /// Width and height of the full image in pixels. Default: 640 pixels along the longer side in
    /// the aspect ratio of the glTF camera, or 640 x 360.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "whole::option_of_2"
    )]
    #[schemars(extend("examples" = [[480, 270]]))]
    #[schemars(transform = rules::resolution)]
    pub resolution: Option<[u32; 2]>,
    /// The part that is rendered: left, top, width, height in pixels; null renders everything.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "whole::option_of_4"
    )]
    #[schemars(extend("default" = null))]
    #[schemars(transform = rules::crop)]
    pub crop: Option<[u32; 4]>,
    /// How a pixel weighs the image plane around its centre.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filter: Option<FilterSpec>,
}

/// A pixel filter. Default: the box of one pixel, which is the plain average over its square.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilterSpec {
    /// Its shape.
    #[serde(default, rename = "type", skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "box"))]
    pub kind: Option<FilterKind>,
    /// Its half width in pixels. Default 0.5 for `box`, 1.5 for `blackman_harris`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = SMALLEST, "maximum" = 64))]
    pub radius: Option<f32>,
}

/// Shape of a pixel filter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FilterKind {
    /// Constant on a square.
    #[default]
    Box,
    /// The four-term Blackman-Harris window along both axes: smooth, without aliasing.
    BlackmanHarris,
}

/// Tells a key that is null, `Some(None)`, from one that is not there, `None`; whole numbers may be
/// written as 4.0.
fn null_or_whole<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Option<u64>>, D::Error> {
    whole::option(deserializer).map(Some)
}

/// How the image is sampled.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SamplingSpec {
    /// Samples per pixel, at least 1.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "whole::option")]
    #[schemars(extend("default" = DEFAULT_SPP))]
    #[schemars(extend("minimum" = 1, "maximum" = MAX_SPP))]
    pub spp: Option<u64>,
    /// Seed of all random numbers: the same seed gives the same image, bit for bit.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "whole::option")]
    #[schemars(extend("default" = 0))]
    pub seed: Option<u64>,
    /// Most scattering events on a path: 0 shows the background through the volumes, 1 is single
    /// scattering. Longer paths are cut, which darkens the image; null is unlimited.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "whole::option")]
    #[schemars(extend("default" = null))]
    pub max_bounces: Option<u32>,
    /// Most events on a path, at least 1: bounces, lookups of the extinction and majorant cells,
    /// those of its shadow rays included. It ends paths that would not end by themselves, or after
    /// millions of events: in dense volumes that absorb nothing, in bodies whose mesh is open. The
    /// picture lacks their light; log, plan and metadata say how many were cut. null is unlimited.
    #[serde(default, deserialize_with = "null_or_whole", skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = DEFAULT_MAX_EVENTS, "minimum" = 1))]
    pub max_events: Option<Option<u64>>,
    /// How transmittance is estimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "auto"))]
    pub transmittance: Option<TransmittanceSpec>,
    /// How distances are sampled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "auto"))]
    pub distance: Option<DistanceSpec>,
    /// How grids are parted into cells with majorants: `auto` (the same as `adaptive`), `adaptive`, `hierarchy`, `kd_tree`, `uniform_N` (cells of N voxels) or
    /// `global`. The mean of the image does not depend on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "auto", "examples" = ["adaptive", "uniform_16"]))]
    #[schemars(extend("pattern" = rules::MAJORANTS))]
    pub majorants: Option<String>,
    /// Factor on the majorants of grids, for experiments: above 1 they are looser than need be, below 1
    /// they do not bound, which only some methods allow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = 1.0))]
    #[schemars(extend("minimum" = SMALLEST, "maximum" = LARGEST_COLOR))]
    pub majorant_scale: Option<f32>,
    /// What decides whether a shadow ray is sent from a point in a volume. The mean of the image does not depend on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "auto"))]
    pub shadow_roulette: Option<ShadowRouletteSpec>,
    /// Largest luminance that a single sample may have: brighter ones, fireflies, are scaled down to it. Biased: what few paths find is lost; the plan and
    /// the image's metadata say so, with the number of samples it met. null is no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = null))]
    #[schemars(extend("minimum" = SMALLEST, "maximum" = LARGEST_COLOR))]
    pub clamp: Option<f32>,
    /// Of `debiased_ray_marching` under a `law`: level j of the telescoping series costs 2^j and has a probability in
    /// proportion to 2^(-level_exponent j). Above 1, where the work is finite, and at most 16; the variance is infinite
    /// above 4 on most rays, and grows from far below where extinction has narrow features.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = 1.5))]
    #[schemars(extend("exclusiveMinimum" = 1, "maximum" = 16))]
    pub level_exponent: Option<f64>,
}

/// What decides whether a shadow ray is sent from a point in a volume; all unbiased.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShadowRouletteSpec {
    /// `expected` where paths scatter rarely, else `importance`, by measurement.
    #[default]
    Auto,
    /// What the lights may contribute unshadowed, times the path's throughput.
    Importance,
    /// The same, times the transmittance that a pilot of 4096 paths found around the point, over the radiance that the path was
    /// expected to bring; without surfaces, point lights and light from volumes.
    Expected,
}

/// How transmittance is estimated; all but `ray_marching` are unbiased.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TransmittanceSpec {
    /// What costs the least error x time in whole images, by measurement: `ratio`.
    #[default]
    Auto,
    /// Exact: the field is integrated cell by cell. No noise; the cost of every voxel on the way.
    Regular,
    /// Delta tracking: whether a free flight gets through.
    Delta,
    /// Ratio tracking: the product of null probabilities.
    Ratio,
    /// Residual ratio tracking: ratio tracking of what exceeds the lower bound.
    ResidualRatio,
    /// Next-flight: at every vertex, the probability of reaching the end directly.
    NextFlight,
    /// Volterra recursion without null collisions, on short stretches.
    Volterra,
    /// Taylor series about zero depth, on short stretches.
    Taylor,
    /// Power series about the upper bound, its order by the size of its terms.
    PseriesCumulative,
    /// Power series about the upper bound, its order by the depth of the bound.
    PseriesCmf,
    /// Null-collision series from both ends, combined by weights.
    Bidirectional,
    /// Unbiased ray marching: equidistant samples, corrected by rare higher orders.
    UnbiasedRayMarching,
    /// Ray marching, debiased by a telescoping series.
    DebiasedRayMarching,
    /// Plain ray marching with 64 samples. Biased: shadows are too bright.
    RayMarching,
}

/// How distances are sampled; all but `ray_marching` are unbiased.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DistanceSpec {
    /// What costs the least error x time in whole images, by measurement: `delta` for grey media, `split`
    /// for one grid of extinction per channel, `spectral` for others; with `equiangular` points where point or spot lights shine into very thin media.
    #[default]
    Auto,
    /// Closed form: homogeneous volumes only.
    Analytic,
    /// Delta tracking on local majorants; with several channels their plain mean decides,
    /// whatever their throughput.
    Delta,
    /// Delta tracking with weights, which holds also where majorants do not bound.
    WeightedDelta,
    /// Delta tracking in which collisions with the lower bound need no lookup.
    Decomposition,
    /// Exact inversion of the optical depth, cell by cell.
    Regular,
    /// Delta tracking decided by the throughput-weighted mean over channels.
    Spectral,
    /// One grid of extinction per channel: channels fly together by delta tracking and part where their events
    /// differ, so that none is weighted. Elsewhere the flights of `auto`.
    Split,
    /// The flights of `auto`, and for point and spot lights points seen from them at equal angles, the two
    /// weighted against each other.
    Equiangular,
    /// Plain ray marching with 64 steps. Biased: volumes are too transparent.
    RayMarching,
}

/// A value whose null means something else than its absence.
fn even_null<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<Option<T>>, D::Error> {
    Option::deserialize(deserializer).map(Some)
}

/// Which files are written, each beside its target and renamed when it is whole.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("allOf" = rules::output()))]
pub struct OutputSpec {
    /// The image, OpenEXR: linear radiance and alpha, and nothing else, which is what all programs
    /// read. Default: the name of the job with `.exr`, in the current folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("examples" = ["cloud.exr"]))]
    #[schemars(extend("pattern" = rules::EXR))]
    pub image: Option<String>,
    /// Store the image's colours and alpha as 16-bit floats: half the size, values beyond 65504 are clamped and counted.
    /// Layers stay 32-bit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = false))]
    pub half: Option<bool>,
    /// A PNG to look at, tone-mapped by a filmic curve; null for none. Default: the image's path with `.png`. With `-o` on the
    /// command line it follows the image.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "even_null")]
    #[schemars(extend("examples" = ["cloud.png"], "pattern" = rules::PNG))]
    pub preview: Option<Option<String>>,
    /// Exposure of the preview in stops: radiance is multiplied by `2^exposure` before the curve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = 0.0))]
    #[schemars(extend("minimum" = -64, "maximum" = 64))]
    pub exposure: Option<f32>,
    /// Counters and times as JSON; null for none. Default: the image's path with `.stats.json`.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "even_null")]
    #[schemars(extend("examples" = ["cloud.stats.json"], "pattern" = rules::FILE))]
    pub stats: Option<Option<String>>,
    /// Layers to keep beside radiance, alpha and variance, which are always kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = []))]
    #[schemars(transform = rules::aovs)]
    pub aovs: Option<Vec<String>>,
    /// Where the layers go, OpenEXR with 32-bit floats; null for nowhere. Default: the image's path
    /// with `.layers.exr`. With `-o` on the command line it follows the image.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "even_null")]
    #[schemars(extend("examples" = ["cloud.layers.exr"]))]
    #[schemars(extend("pattern" = rules::EXR))]
    pub layers: Option<Option<String>>,
    /// Write the layers into the image instead of a file of their own: scripts in Blender get no
    /// pixels of such an image, and Mitsuba takes it for no environment or texture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = false))]
    pub layers_in_image: Option<bool>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use pileus_scene::json;

    /// The example of the format's specification, without what this version refuses.
    const FULL: &str = r#"{
      "scene": "shot.gltf", "gltf": { "lumens_per_watt": 683.0 },
      "volumes": [
        { "name": "cloud", "vdb": "cumulus.vdb", "density": { "grid": "density", "scale": 40.0 },
          "extinction": [1.0, 1.0, 1.0], "albedo": [0.999, 0.999, 0.999],
          "phase": { "type": "henyey_greenstein", "g": 0.8 }, "interpolation": "trilinear",
          "transform": { "translation": [0,0,0], "rotation": [0,0,0,1], "scale": [1,1,1] } },
        { "name": "fog", "homogeneous": { "sigma_t": 0.01, "bounds": null }, "albedo": 0.9 }
      ],
      "camera": { "position": [0,1,5], "look_at": [0,1,0], "up": [0,1,0], "fov_y": 35.0, "shutter": [0.0, 0.0] },
      "lights": [
        { "type": "sun", "to_light": [0.5,0.8,-0.3], "irradiance": [3,3,3], "angular_diameter": 0.0 },
        { "type": "environment", "radiance": [0.3,0.4,0.6] },
        { "type": "environment", "image": "sky.exr", "intensity": 1.0, "rotation_y": 0.0 },
        { "type": "point", "position": [0,3,0], "intensity": [10,10,10] }
      ],
      "film": { "resolution": [480,270], "crop": null, "filter": { "type": "box", "radius": 0.5 } },
      "sampling": { "spp": 64, "seed": 0, "max_bounces": null, "transmittance": "auto", "distance": "auto" },
      "output": { "image": "cloud.exr", "preview": "cloud.png", "stats": "cloud.stats.json", "aovs": [] }
    }"#;

    #[test]
    fn reads_the_whole_format_and_writes_it_back() {
        let job: Job = json::parse(FULL).unwrap();
        let again: Job = json::parse(&serde_json::to_string_pretty(&job).unwrap()).unwrap();
        assert_eq!(job, again);
        assert_eq!(json::parse::<Job>("{}").unwrap(), Job::default());
    }

    #[test]
    fn faults_name_the_nearest_key_and_the_place() {
        for (right, wrong, pointer, near) in [
            ("\"scale\": 40.0", "\"sclae\": 40.0", "/volumes/0/density/sclae", "`scale`"),
            ("\"sampling\"", "\"samplng\"", "/samplng", "`sampling`"),
            ("\"irradiance\"", "\"iradiance\"", "/lights/0/iradiance", "`irradiance`"),
            ("\"fov_y\"", "\"fov\"", "/camera/fov", "`fov_y`"),
            ("\"type\": \"box\"", "\"type\": \"boxx\"", "/film/filter/type", "`box`"),
            (
                "\"transmittance\": \"auto\"",
                "\"transmittance\": \"rato\"",
                "/sampling/transmittance",
                "`ratio`",
            ),
            ("\"bounds\"", "\"bound\"", "/volumes/1/homogeneous/bound", "`bounds`"),
        ] {
            let text = FULL.replacen(right, wrong, 1);
            assert_ne!(text, FULL);
            let fault = json::parse::<Job>(&text).unwrap_err();
            assert_eq!(fault.pointer, pointer);
            assert!(fault.remedy.contains(&format!("did you mean {near}")), "{fault:?}");
        }
        let fault = json::parse::<Job>("{\"sampling\": {\"spp\": -3}}").unwrap_err();
        assert_eq!(fault.pointer, "/sampling/spp");
        let fault = json::parse::<Job>("{\"film\": {\"resolution\": [4]}}").unwrap_err();
        assert_eq!(fault.pointer, "/film/resolution");
    }
}
