//! The command line.

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use pileus_film::{DENOISED, DENOISED_MEANING, FIRST_LAYERS, LAYERS};
use pileus_media::Interpolation;
use pileus_media::method::Named;
use pileus_media::transmittance::Estimator;
use pileus_scene::Orbit;
use pileus_scene::volume_spec::UpAxis;

use crate::input::VdbOptions;
use crate::job::MAX_SPP;
use crate::schema::about;
use crate::settings::{Overrides, SunPosition};

const EXIT_CODES: &str = "\
Exit codes:
    0  everything was done
    2  the command line is wrong
    3  an input breaks its format or contradicts itself
    4  a file is missing or cannot be read or written
    5  the input is legal, but this version does not render it
  129  stopped by SIGHUP (unless started under nohup), 130 by Ctrl-C, 143 by SIGTERM; the whole
       passes rendered until then are written. A second signal ends the program at once

Results go to standard output, everything else to standard error.";

/// The version, and the commit where the program was built from a repository.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), env!("PILEUS_COMMIT_SUFFIX"));

/// Renders OpenVDB clouds, smoke and fire inside glTF scenes.
#[derive(Debug, Parser)]
#[command(name = "pileus", version = VERSION, after_long_help = EXIT_CODES, max_term_width = 100)]
pub struct Arguments {
    /// What every command takes.
    #[command(flatten)]
    pub common: Common,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What every command takes.
#[derive(Debug, Args)]
#[command(next_display_order = 900)]
pub struct Common {
    /// Say nothing but errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say more; twice for everything.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Number of threads; all cores if not given. The image does not depend on it.
    #[arg(long, global = true, value_name = "N", value_parser = parse_threads)]
    pub threads: Option<usize>,
}

fn parse_threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n) if (1..=4096).contains(&n) => Ok(n),
        _ => Err("give a number from 1 to 4096".into()),
    }
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a job, a glTF scene or an OpenVDB file.
    #[command(after_long_help = "\
Examples:
  pileus render cloud.vdb                 frames the volume: cloud.exr, cloud.png, cloud.stats.json
  pileus render shot.glb -o shot.exr      camera, lights and volumes of the scene
  pileus render job.json --spp 1024       everything from the job, but more samples
  pileus render cloud.vdb --save-job cloud.json    to go on from: everything that was chosen

Beside the image NAME.exr go a picture to look at, NAME.png, and statistics, NAME.stats.json, unless the
job or an option says otherwise. No file that is read is ever overwritten.")]
    Render(Box<RenderOptions>),
    /// Show what a file contains: OpenVDB, glTF, job or OpenEXR.
    Info(InfoOptions),
    /// Validate a job with all its files; renders nothing.
    Check(InputOptions),
    /// Show what would be modelled, by which methods and why; renders nothing.
    Plan(PlanOptions),
    /// Print the JSON Schema of jobs.
    Schema(SchemaOptions),
    /// Measure image A against image B (the reference).
    #[cfg(feature = "lab")]
    Compare(CompareOptions),
    /// Ask single questions of a volume, JSON in and out.
    Probe(ProbeOptions),
    /// Measure methods and draw charts of error against time.
    #[cfg(feature = "lab")]
    Chart(ChartOptions),
}

/// Options of `chart`.
#[derive(Debug, Args)]
pub struct ChartOptions {
    /// What to chart.
    #[command(subcommand)]
    pub experiment: Experiment,
}

/// The experiments of `chart`.
#[derive(Debug, Subcommand)]
pub enum Experiment {
    /// Every transmittance estimator on the same rays.
    #[command(after_long_help = "\
ASSET is an OpenVDB file, a scene, a job, or a file of closed forms ({\"cases\": [...]}), of which `FILE#NAME` takes one.
Writes transmittance-NAME.csv, .html, and each plot as .svg and .png.")]
    Transmittance(ChartTransmittanceOptions),
    /// Whole images by every method.
    #[command(after_long_help = "\
Methods are named distance+transmittance, with *F where majorants are scaled and /paths where no shadow ray is sent to what paths can meet:
delta+ratio, auto+regular, delta+ratio*4, auto+auto/paths.
Writes render-NAME.csv, .html, and the plot as .svg and .png.")]
    Render(ChartRenderOptions),
    /// Every majorant structure on a scene: predicted and measured cost.
    #[command(after_long_help = "\
Writes majorants-NAME.csv, .html, and the plots as .svg and .png.")]
    Majorants(ChartMajorantsOptions),
    /// Every method under every stress: where methods break.
    #[command(after_long_help = "\
Writes stability.md, stability.csv, stability.html and plots. The outcome is the same on every machine.")]
    Stability(ChartStabilityOptions),
    /// The debiasing series of non-exponential transmittance: variance and cost by how its levels
    /// are chosen.
    #[command(after_long_help = "\
Writes debiasing.csv, debiasing.html and plots. The figures are the same on every machine.")]
    #[command(alias = "laws")]
    Debiasing(ChartDebiasingOptions),
}

/// Options of `chart transmittance`.
#[derive(Debug, Args)]
pub struct ChartTransmittanceOptions {
    /// What to take rays from.
    #[arg(required = true, value_name = "ASSET")]
    pub assets: Vec<PathBuf>,
    /// Folder to write into.
    #[arg(short, long, value_name = "FOLDER", default_value = "charts")]
    pub output: PathBuf,
    /// OpenVDB only: the grid of the density, `name` or `name[i]`.
    #[arg(long, value_name = "NAME")]
    pub grid: Option<String>,
    /// OpenVDB only: extinction per scene unit where the grid is 1; chosen so that it looks like a
    /// cloud if not given.
    #[arg(long, value_name = "S", value_parser = parse_scale)]
    pub density_scale: Option<f64>,
    /// Rays per class.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rays: u32,
    /// Estimates per ray and method.
    #[arg(long, value_name = "N", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(8..=10_000_000))]
    pub samples: u32,
    /// Seed.
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub seed: u64,
}

/// Options of `chart render`.
#[derive(Debug, Args)]
pub struct ChartRenderOptions {
    /// Jobs, scenes or OpenVDB files.
    #[arg(required = true, value_name = "JOB")]
    pub jobs: Vec<PathBuf>,
    /// Folder to write into.
    #[arg(short, long, value_name = "FOLDER", default_value = "charts")]
    pub output: PathBuf,
    /// Methods, separated by commas; all if not given.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub methods: Vec<String>,
    /// Seconds per method, roughly.
    #[arg(long, value_name = "S", default_value_t = 8.0, value_parser = parse_scale)]
    pub seconds: f64,
    /// Samples per pixel of the reference image.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u64).range(2..=1 << 32))]
    pub reference_spp: u64,
    /// Width and height in pixels instead of the job's, for example 128x128.
    #[arg(long, value_name = "WxH", value_parser = parse_resolution)]
    pub resolution: Option<[u32; 2]>,
    /// Timings of other renderers to draw in: columns scene, renderer, seconds, relmse.
    #[arg(long, value_name = "CSV")]
    pub peers: Option<PathBuf>,
}

/// Options of `chart majorants`.
#[derive(Debug, Args)]
pub struct ChartMajorantsOptions {
    /// Jobs, scenes or OpenVDB files.
    #[arg(required = true, value_name = "JOB")]
    pub jobs: Vec<PathBuf>,
    /// Folder to write into.
    #[arg(short, long, value_name = "FOLDER", default_value = "charts")]
    pub output: PathBuf,
    /// Seconds per structure.
    #[arg(long, value_name = "S", default_value_t = 2.0, value_parser = parse_scale)]
    pub seconds: f64,
    /// Width and height in pixels instead of the job's.
    #[arg(long, value_name = "WxH", value_parser = parse_resolution)]
    pub resolution: Option<[u32; 2]>,
}

/// Options of `chart stability`.
#[derive(Debug, Args)]
pub struct ChartStabilityOptions {
    /// Folder to write into.
    #[arg(short, long, value_name = "FOLDER", default_value = "charts")]
    pub output: PathBuf,
}

/// Options of `chart debiasing`.
#[derive(Debug, Args)]
pub struct ChartDebiasingOptions {
    /// Folder to write into.
    #[arg(short, long, value_name = "FOLDER", default_value = "charts")]
    pub output: PathBuf,
}

/// A file and what can be said about it if it is an OpenVDB file.
#[derive(Debug, Args)]
pub struct InputOptions {
    /// Job (.json), scene (.gltf, .glb) or volume (.vdb).
    pub input: PathBuf,
    /// OpenVDB only: the grid of the density, `name` or `name[i]`.
    #[arg(long, value_name = "NAME")]
    pub grid: Option<String>,
    /// OpenVDB only: extinction per scene unit where the grid is 1; chosen so that it looks like a
    /// cloud if not given.
    #[arg(long, value_name = "S", value_parser = parse_scale)]
    pub density_scale: Option<f64>,
    /// OpenVDB only: the axis that points up in the file.
    #[arg(long, value_name = "AXIS", value_parser = by_name::<UpAxis>())]
    pub up_axis: Option<UpAxis>,
    /// The camera of the scene to use, by the name of its node; it takes the lens of the job's.
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
}

fn parse_scale(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(scale) if scale >= 0.0 && scale.is_finite() => Ok(scale),
        _ => Err("give a finite number of at least 0".into()),
    }
}

/// Reads the name of a choice; its list is part of the help and of the error.
fn by_name<T: Named + Send + Sync>() -> impl TypedValueParser<Value = T> {
    let names = T::ALL.iter().map(|choice| PossibleValue::new(choice.name()).help(choice.about()));
    PossibleValuesParser::new(names)
        .try_map(|name| T::from_name(&name).ok_or("there is no such name"))
}

impl InputOptions {
    /// A file about which nothing else is said.
    pub(crate) fn of(input: PathBuf) -> Self {
        Self { input, grid: None, density_scale: None, up_axis: None, camera: None }
    }

    pub(crate) fn vdb_options(&self) -> VdbOptions {
        VdbOptions {
            grid: self.grid.clone(),
            density_scale: self.density_scale,
            up_axis: self.up_axis,
        }
    }
}

/// Options of `render`.
#[derive(Debug, Args)]
pub struct RenderOptions {
    /// What to render.
    #[command(flatten)]
    pub input: InputOptions,
    /// The image (.exr) to write instead of the job's.
    #[arg(short, long, value_name = "IMAGE")]
    pub output: Option<PathBuf>,
    /// The tone-mapped picture (.png) to look at, instead of the one beside the image.
    #[arg(long, value_name = "FILE")]
    pub preview: Option<PathBuf>,
    /// From where the camera looks, degrees: clockwise seen from above (0 is at -Z, 90 at +X), and
    /// above the horizon; around what the job's camera looks at, or else around all that there is.
    /// Without a distance, in scene units, it keeps the job's, or all fits.
    #[arg(long, value_name = "AZIMUTH,ELEVATION[,DISTANCE]", conflicts_with = "camera", allow_hyphen_values = true, value_parser = parse_orbit)]
    pub camera_orbit: Option<Orbit>,
    /// Where the sun stands, degrees, as for `--camera-orbit`: the job's, or else that of a clear
    /// sky in place of the default one, or beside the job's environment.
    #[arg(long, value_name = "AZIMUTH,ELEVATION", allow_hyphen_values = true, value_parser = parse_sun)]
    pub sun: Option<SunPosition>,
    /// An image of all around (.exr, .hdr; latitude and longitude) instead of the job's environment
    /// and sky.
    #[arg(long, value_name = "IMAGE")]
    pub env: Option<PathBuf>,
    /// Share of light that the volumes scatter, from 0 to 1, instead of the job's.
    #[arg(long, value_name = "A|R,G,B", value_parser = parse_albedo)]
    pub albedo: Option<[f64; 3]>,
    /// Mean cosine of scattering in the volumes (Henyey-Greenstein), between -1 and 1, instead of
    /// the job's.
    #[arg(long, value_name = "G", allow_hyphen_values = true, value_parser = parse_cosine)]
    pub g: Option<f64>,
    /// Exposure of the picture to look at instead of the job's.
    #[arg(long, value_name = "STOPS", allow_hyphen_values = true, help = instead("OutputSpec", "exposure"), value_parser = parse_stops)]
    pub exposure: Option<f32>,
    /// Layers to keep besides the job's, separated by commas.
    #[arg(long, value_name = "LAYERS", conflicts_with = "no_layers", value_delimiter = ',', value_parser = layer_names())]
    pub aov: Vec<String>,
    /// Denoise the picture to look at, and keep it as the layer `denoised`, too.
    #[arg(long, conflicts_with_all = ["no_denoise", "no_layers"])]
    pub denoise: bool,
    /// Show the noise in the picture to look at.
    #[arg(long)]
    pub no_denoise: bool,
    /// Write no picture to look at.
    #[arg(long, conflicts_with = "preview")]
    pub no_preview: bool,
    /// Write no statistics.
    #[arg(long)]
    pub no_stats: bool,
    /// Write no layers (variance and what the job asks for).
    #[arg(long)]
    pub no_layers: bool,
    /// Write the job that renders this image again, with all that was chosen, to go on from.
    #[arg(long, value_name = "JOB")]
    pub save_job: Option<PathBuf>,
    /// Samples per pixel instead of the job's.
    #[arg(long, value_name = "N", help = instead("SamplingSpec", "spp"), value_parser = clap::value_parser!(u64).range(1..=MAX_SPP))]
    pub spp: Option<u64>,
    /// Seed instead of the job's.
    #[arg(long, value_name = "N", help = instead("SamplingSpec", "seed"))]
    pub seed: Option<u64>,
    /// The part of the image to render instead of the job's, pixels.
    #[arg(long, value_name = "LEFT,TOP,WIDTH,HEIGHT", help = instead("FilmSpec", "crop"), value_parser = parse_crop)]
    pub crop: Option<[u32; 4]>,
    /// Width and height instead of the job's, pixels.
    #[arg(long, value_name = "WxH", help = instead("FilmSpec", "resolution"), value_parser = parse_resolution)]
    pub resolution: Option<[u32; 2]>,
}

/// The help of an option that takes the place of one of the job's: what that one says of itself.
fn instead(definition: &str, key: &str) -> String {
    format!("Instead of the job's `{key}`: {}", about(definition, key))
}

/// Finite numbers between commas.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let number = |part: &str| part.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    text.split(',').map(number).collect()
}

fn parse_orbit(text: &str) -> Result<Orbit, String> {
    let orbit = |azimuth_degrees, elevation_degrees, distance| Orbit {
        azimuth_degrees,
        elevation_degrees,
        distance,
    };
    numbers(text)
        .and_then(|numbers| match numbers[..] {
            [azimuth, elevation] => Some(orbit(azimuth, elevation, None)),
            [azimuth, elevation, distance] if distance > 0.0 => {
                Some(orbit(azimuth, elevation, Some(distance)))
            }
            _ => None,
        })
        .filter(|orbit| orbit.elevation_degrees.abs() <= 90.0)
        .ok_or_else(|| {
            "give an azimuth and an elevation from -90 to 90 degrees like 120,15, and after them a distance above 0 if one is wanted".into()
        })
}

fn parse_sun(text: &str) -> Result<SunPosition, String> {
    match numbers(text).as_deref() {
        Some(&[azimuth, elevation]) if (-6.0..=90.0).contains(&elevation) => {
            Ok(SunPosition { azimuth, elevation })
        }
        _ => Err("give an azimuth and an elevation from -6 to 90 degrees like 200,35".into()),
    }
}

fn parse_albedo(text: &str) -> Result<[f64; 3], String> {
    let channels = match numbers(text).as_deref() {
        Some(&[grey]) => Some([grey; 3]),
        Some(&[r, g, b]) => Some([r, g, b]),
        _ => None,
    };
    channels
        .filter(|channels| channels.iter().all(|c| (0.0..=1.0).contains(c)))
        .ok_or_else(|| "give one number from 0 to 1, or three for red, green and blue".into())
}

fn parse_cosine(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(g) if g.abs() < 1.0 => Ok(g),
        _ => Err("give a number between -1 and 1, not those themselves".into()),
    }
}

fn parse_stops(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(stops) if stops.abs() <= 64.0 => Ok(stops),
        _ => Err("give a number of stops from -64 to 64".into()),
    }
}

/// Names of layers that a job may ask for.
fn layer_names() -> impl TypedValueParser<Value = String> {
    let layers = LAYERS[FIRST_LAYERS..].iter();
    PossibleValuesParser::new(
        layers
            .map(|layer| (layer.name, layer.meaning))
            .chain([(DENOISED, DENOISED_MEANING)])
            .map(|(name, meaning)| PossibleValue::new(name).help(meaning)),
    )
}

fn parse_resolution(text: &str) -> Result<[u32; 2], String> {
    text.split_once(['x', 'X'])
        .and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]))
        .filter(|&[width, height]: &[u32; 2]| {
            let pixels = u64::from(width) * u64::from(height);
            (1..=pileus_film::MAX_PIXELS).contains(&pixels)
        })
        .ok_or_else(|| {
            "give width and height in pixels like 480x270, fewer than 2^28 in all".into()
        })
}

fn parse_crop(text: &str) -> Result<[u32; 4], String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| <[u32; 4]>::try_from(numbers).ok())
        .filter(|[.., width, height]| *width > 0 && *height > 0)
        .ok_or_else(|| "give left, top, width and height in pixels like 120,60,64,64".into())
}

impl RenderOptions {
    pub(crate) fn overrides(&self) -> Overrides {
        Overrides {
            image: self.output.clone(),
            preview: self.preview.clone(),
            spp: self.spp,
            seed: self.seed,
            resolution: self.resolution,
            crop: self.crop,
            camera: None,
            orbit: self.camera_orbit,
            sun: self.sun,
            environment: self.env.clone(),
            albedo: self.albedo,
            g: self.g,
            exposure: self.exposure,
            aovs: self.aov.clone(),
            denoise: (self.denoise || self.no_denoise).then_some(self.denoise),
            no_preview: self.no_preview,
            no_stats: self.no_stats,
            no_layers: self.no_layers,
            save_job: self.save_job.clone(),
        }
    }
}

/// Options of `info`.
#[derive(Debug, Args)]
pub struct InfoOptions {
    /// OpenVDB (.vdb), scene (.gltf, .glb), job (.json) or image (.exr).
    pub file: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Options of `plan`.
#[derive(Debug, Args)]
pub struct PlanOptions {
    /// What would be rendered.
    #[command(flatten)]
    pub input: InputOptions,
    /// Trace trial paths: predict what a path costs, find volumes that none of them meets, and
    /// choose what decides about shadow rays, as a render does.
    #[arg(long)]
    pub predict: bool,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Options of `schema`.
#[derive(Debug, Args)]
pub struct SchemaOptions {
    /// Print the custom properties by which glTF nodes become volumes, a table, instead.
    #[arg(long, conflicts_with = "markdown")]
    pub properties: bool,
    /// Print the reference page of the book instead.
    #[arg(long, hide = true)]
    pub markdown: bool,
}

/// Options of `compare`.
#[derive(Debug, Args)]
pub struct CompareOptions {
    /// The image to judge.
    pub a: PathBuf,
    /// The reference.
    pub b: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
    /// Write A - B: .exr signed, .png around middle grey.
    #[arg(long, value_name = "FILE")]
    pub difference: Option<PathBuf>,
    /// Exposure in stops at which FLIP looks at the images.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f32,
    /// Factor on the difference in a .png.
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub gain: f32,
}

/// Options of `probe`.
#[derive(Debug, Args)]
pub struct ProbeOptions {
    /// What to ask.
    #[command(subcommand)]
    pub question: Question,
}

/// The questions of `probe`.
#[derive(Debug, Subcommand)]
pub enum Question {
    /// Values of a grid at points.
    #[command(after_long_help = "\
POINTS.json: {\"space\": \"index\" or \"world\", \"points\": [[x, y, z], ...]}
Prints {\"values\": [...], \"active\": [...]}: the stored value at integer index coordinates, elsewhere
interpolated. Numbers that JSON does not have are printed as \"nan\", \"inf\" and \"-inf\".")]
    Values(ValuesOptions),
    /// Transmittance along rays.
    #[command(after_long_help = "\
RAYS.json: {\"rays\": [{\"origin\": [x, y, z], \"direction\": [x, y, z], \"tmin\": t, \"tmax\": t}, ...]}
Prints {\"estimator\", \"rays\": [{\"mean\", \"variance\", \"samples\", \"lookups\", \"seconds\"}, ...], \"dropped\"};
the variance is that of one sample. `regular` is exact: it adds \"optical_depth\" and takes one sample.")]
    Transmittance(TransmittanceOptions),
}

/// Options of `probe values`.
#[derive(Debug, Args)]
pub struct ValuesOptions {
    /// OpenVDB file.
    pub file: PathBuf,
    /// The grid, `name` or `name[i]`.
    #[arg(long, value_name = "NAME")]
    pub grid: String,
    /// Points to look at.
    #[arg(long, value_name = "POINTS.json")]
    pub points: PathBuf,
    /// How values between voxels are formed.
    #[arg(long, value_name = "NAME", value_parser = by_name::<Interpolation>(), default_value = "trilinear")]
    pub interpolation: Interpolation,
}

/// Options of `probe transmittance`.
#[derive(Debug, Args)]
pub struct TransmittanceOptions {
    /// OpenVDB file.
    pub file: PathBuf,
    /// The grid, `name` or `name[i]`.
    #[arg(long, value_name = "NAME")]
    pub grid: String,
    /// Extinction per unit length where the grid is 1.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = parse_scale)]
    pub density_scale: f64,
    /// Rays to follow, in world space.
    #[arg(long, value_name = "RAYS.json")]
    pub rays: PathBuf,
    /// The estimator.
    #[arg(long, value_name = "NAME", value_parser = by_name::<Estimator>())]
    pub estimator: Estimator,
    /// Samples per ray.
    #[arg(long, value_name = "N", default_value_t = 1024)]
    pub samples: u64,
    /// Seed.
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub seed: u64,
    /// How values between voxels are formed.
    #[arg(long, value_name = "NAME", value_parser = by_name::<Interpolation>(), default_value = "trilinear")]
    pub interpolation: Interpolation,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn sizes_are_parsed() {
        assert_eq!(parse_resolution("480x270"), Ok([480, 270]));
        for wrong in ["480", "x", "0x3", "3x-1", "4x4x4"] {
            assert!(parse_resolution(wrong).is_err(), "{wrong}");
        }
    }
}
