//! What a command is given: a job, a glTF scene or an OpenVDB file.

use std::io::Read;
use std::path::{Path, PathBuf};

use pileus_scene::ByName;
use pileus_scene::json::{Document, parse};
use pileus_scene::phase_spec::{CosineSpec, PhaseSpec};
use pileus_scene::volume::DefaultScale;
use pileus_scene::volume_spec::{DensitySpec, UpAxis, VolumeSpec};

use crate::failure::Failure;
use crate::job::{Job, OutputSpec};

/// Mean cosine of clouds that are rendered from an OpenVDB file alone.
const CLOUD_G: f64 = 0.8;
/// Exposure of the preview, stops: the default sky is bright enough for a picture at this one.
const DEFAULT_SKY_EXPOSURE: f32 = 0.5;
/// Largest job file.
const MAX_JOB: u64 = 64 << 20;

/// What kind of file it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A job.
    Job,
    /// `.gltf` or `.glb`.
    Gltf,
    /// OpenVDB.
    Vdb,
}

/// A job, read or made up, and where it comes from.
#[derive(Debug)]
pub struct Input {
    /// The job.
    pub(crate) job: Job,
    /// Text of the job, if it was read.
    pub(crate) document: Option<Document>,
    /// The file that was named on the command line.
    pub(crate) path: PathBuf,
    /// The folder that names in the job are relative to.
    pub(crate) base: PathBuf,
    /// The extinction of a grid value of 1 that nobody specified.
    pub(crate) default_scale: DefaultScale,
}

/// What the command line says about a volume that is rendered without a job.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VdbOptions {
    /// Name of the density grid.
    pub grid: Option<String>,
    /// Extinction per scene unit at grid value 1.
    pub density_scale: Option<f64>,
    /// The axis that points up.
    pub up_axis: Option<UpAxis>,
}

impl Kind {
    /// Tells files apart by their extension, or by their first bytes.
    pub fn of(path: &Path) -> Result<Self, Failure> {
        look(path).map(|(kind, _)| kind)
    }

    /// By the extension alone.
    fn of_name(path: &Path) -> Option<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("json") => Some(Self::Job),
            Some("gltf" | "glb") => Some(Self::Gltf),
            Some("vdb") => Some(Self::Vdb),
            _ => None,
        }
    }

    /// By the first bytes.
    fn of_bytes(start: &[u8]) -> Option<Self> {
        match start.strip_prefix(BYTE_ORDER_MARK.as_bytes()).unwrap_or(start) {
            [b'g', b'l', b'T', b'F', ..] => Some(Self::Gltf),
            [b' ', b'B', b'D', b'V', ..] => Some(Self::Vdb),
            [b'{' | b'[' | b' ' | b'\n' | b'\r' | b'\t', ..] => Some(Self::Job),
            _ => None,
        }
    }
}

/// The kind of a file. The text of a job that had to be opened for that comes with it: a pipe gives
/// it once only.
pub(crate) fn look(path: &Path) -> Result<(Kind, Option<String>), Failure> {
    if let Some(kind) = Kind::of_name(path) {
        return Ok((kind, None));
    }
    let failed = |source| cannot_read(path, source);
    let mut file = std::fs::File::open(path).map_err(failed)?;
    let mut start = Vec::new();
    file.by_ref().take(8).read_to_end(&mut start).map_err(failed)?;
    match Kind::of_bytes(&start) {
        Some(Kind::Job) => {
            let text = text_of(path, std::io::Cursor::new(start).chain(file), MAX_JOB)?;
            Ok((Kind::Job, Some(text)))
        }
        Some(_) if !file.metadata().map_err(failed)?.is_file() => Err(Failure::usage(
            format!("{}: volumes and scenes are not read from pipes", path.display()),
            "write it into a file first; jobs may come through a pipe",
        )),
        Some(kind) => Ok((kind, None)),
        None => Err(Failure::usage(
            format!("{}: the kind of this file is not known", path.display()),
            "give an OpenVDB file (.vdb), a scene (.gltf, .glb) or a job (.json)",
        )),
    }
}

impl Input {
    /// Reads or makes up the job for a file.
    pub fn open(path: &Path, options: &VdbOptions) -> Result<Self, Failure> {
        let (kind, text) = look(path)?;
        if kind != Kind::Vdb && *options != VdbOptions::default() {
            return Err(Failure::usage(
                "--grid, --density-scale and --up-axis belong to OpenVDB files",
                "write these settings into the job or the scene",
            ));
        }
        match kind {
            Kind::Job => Self::of_job(path, text),
            Kind::Gltf => Ok(Self::made_up(
                path,
                Job { scene: Some(path.to_string_lossy().into_owned()), ..Job::default() },
            )),
            Kind::Vdb => {
                let stem = path.file_stem().map_or_else(|| "cloud".into(), |s| s.to_string_lossy());
                let spec = VolumeSpec {
                    vdb: Some(path.to_string_lossy().into_owned()),
                    name: Some(stem.into_owned()),
                    density: Some(DensitySpec {
                        grid: options.grid.clone(),
                        scale: options.density_scale,
                    }),
                    phase: Some(PhaseSpec::HenyeyGreenstein { g: CosineSpec::Constant(CLOUD_G) }),
                    up_axis: options.up_axis.map(ByName),
                    ..VolumeSpec::default()
                };
                Ok(Self::made_up(
                    path,
                    Job {
                        volumes: Some(vec![spec]),
                        output: Some(OutputSpec {
                            exposure: Some(DEFAULT_SKY_EXPOSURE),
                            ..OutputSpec::default()
                        }),
                        ..Job::default()
                    },
                ))
            }
        }
    }

    fn made_up(path: &Path, job: Job) -> Self {
        Self {
            job,
            document: None,
            path: path.to_owned(),
            base: PathBuf::new(),
            default_scale: DefaultScale::Cloud,
        }
    }

    /// Reads a job; its text may have been read before.
    pub(crate) fn of_job(path: &Path, text: Option<String>) -> Result<Self, Failure> {
        let text = text.map_or_else(|| read_text(path, MAX_JOB), Ok)?;
        let document = Document::new(path, text);
        let job = parse(document.text()).map_err(|fault| fault_of_job(&document, fault))?;
        // Names in a job that comes through a pipe are relative to the current folder.
        let is_file = std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file());
        let base = path.parent().filter(|_| is_file).unwrap_or(Path::new("")).to_owned();
        Ok(Self {
            job,
            document: Some(document),
            path: path.to_owned(),
            base,
            default_scale: DefaultScale::One,
        })
    }
}

/// Keys that people try, of features that this version does not have, and what to do without them.
const NOT_YET: [(&[&str], &str, &str); 8] = [
    (
        &["aperture_radius", "lens_radius", "f_stop", "fstop", "f_number", "dof"],
        "depth of field is given by `aperture`, the diameter of the lens in scene units",
        "give `aperture`: twice the radius, or the focal length over the f-number",
    ),
    (
        &["denoise", "denoiser", "denoising"],
        "the job's `denoise` says whether what is shown is denoised",
        "write `\"denoise\": { \"when\": \"end\" }` beside `output`; `denoised` among its `aovs` keeps the picture",
    ),
    (
        &["motion_blur", "shutter_open", "shutter_close"],
        "motion is not rendered by this version",
        "remove the key",
    ),
    (
        &["frames", "frame_range", "frame_start", "frame_end", "animation", "fps"],
        "sequences of frames are not rendered by this version",
        "write a job for each frame: `frame` of a volume fills in the `#` in its file's name",
    ),
    (
        &["aov", "passes", "cryptomatte", "light_groups"],
        "such layers are not written by this version",
        "remove the key; layers that there are go by name into `aovs` under `output`",
    ),
    (
        &["adaptive", "noise_threshold", "time_limit", "max_time", "noise"],
        "rendering up to a noise or a time is not part of this version",
        "remove the key and set `spp`; Ctrl-C writes what is there",
    ),
    (
        &["resume", "checkpoint", "continue"],
        "interrupted renders are not resumed by this version",
        "remove the key",
    ),
    (
        &["area_light", "area_lights", "meshes", "objects", "mesh", "materials"],
        "surfaces and area lights are part of glTF scenes, not of jobs",
        "name a glTF file with `scene`; emissive materials are its area lights",
    ),
];

/// The error that a fault in a job is: keys of features that are missing say so.
fn fault_of_job(document: &Document, fault: pileus_scene::json::Fault) -> Failure {
    let key = fault.pointer.rsplit('/').next().unwrap_or_default();
    let unknown = fault.what.starts_with("unknown key");
    let found = NOT_YET.iter().find(|(keys, ..)| unknown && keys.contains(&key));
    let Some((_, what, remedy)) = found else { return document.error(fault).into() };
    let what = format!("unknown key `{key}`: {what}");
    let remedy = (*remedy).to_owned();
    match document.error(pileus_scene::json::Fault { what, remedy, ..fault }) {
        pileus_scene::Error::Invalid { place, what, remedy } => {
            pileus_scene::Error::Unsupported { place, what, remedy }.into()
        }
        other => other.into(),
    }
}

/// What some editors put before UTF-8.
const BYTE_ORDER_MARK: &str = "\u{feff}";

/// Reads a text file of limited size.
pub(crate) fn read_text(path: &Path, limit: u64) -> Result<String, Failure> {
    let file = std::fs::File::open(path).map_err(|source| cannot_read(path, source))?;
    text_of(path, file, limit)
}

/// The text of an open file, without its byte order mark.
fn text_of(path: &Path, file: impl Read, limit: u64) -> Result<String, Failure> {
    let mut bytes = Vec::new();
    let mut limited = file.take(limit + 1);
    limited.read_to_end(&mut bytes).map_err(|source| cannot_read(path, source))?;
    if bytes.len() as u64 > limit {
        let place = pileus_scene::Place::file(path);
        let what = format!("the file is larger than {limit} bytes");
        return Err(pileus_scene::Error::unsupported(place, what, "this is no such file").into());
    }
    let wide = bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]);
    let mut text = String::from_utf8(bytes).map_err(|_| {
        let place = pileus_scene::Place::file(path);
        let what = if wide { "the text is UTF-16, not UTF-8" } else { "the text is not UTF-8" };
        pileus_scene::Error::invalid(place, what, "save it as UTF-8")
    })?;
    if text.starts_with(BYTE_ORDER_MARK) {
        text.drain(..BYTE_ORDER_MARK.len());
    }
    Ok(text)
}

fn cannot_read(path: &Path, source: std::io::Error) -> Failure {
    Failure::Io { path: path.to_owned(), what: "the file cannot be read".into(), source }
}
