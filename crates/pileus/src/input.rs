//! What a command is given: a job, a glTF scene or an OpenVDB file.

use std::io::Read;
use std::path::{Path, PathBuf};

use pileus_scene::json::Document;
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
    pub job: Job,
    /// Its text, if it was read.
    pub document: Option<Document>,
    /// The file that was named on the command line.
    pub path: PathBuf,
    /// The folder that names in the job are relative to.
    pub base: PathBuf,
    /// The extinction of a grid value of 1 that nobody specified.
    pub default_scale: DefaultScale,
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
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("json") => return Ok(Self::Job),
            Some("gltf" | "glb") => return Ok(Self::Gltf),
            Some("vdb") => return Ok(Self::Vdb),
            _ => {}
        }
        let mut start = [0u8; 8];
        let read = std::fs::File::open(path)
            .and_then(|mut file| file.read(&mut start))
            .map_err(|source| cannot_read(path, source))?;
        match start.get(..read).unwrap_or_default() {
            [b'g', b'l', b'T', b'F', ..] => Ok(Self::Gltf),
            [b' ', b'B', b'D', b'V', ..] => Ok(Self::Vdb),
            [b'{' | b' ' | b'\n' | b'\r' | b'\t', ..] => Ok(Self::Job),
            _ => Err(Failure::usage(
                format!("{}: the kind of this file is not known", path.display()),
                "give an OpenVDB file (.vdb), a scene (.gltf, .glb) or a job (.json)",
            )),
        }
    }
}

impl Input {
    /// Reads or makes up the job for a file.
    pub fn open(path: &Path, options: &VdbOptions) -> Result<Self, Failure> {
        let kind = Kind::of(path)?;
        if kind != Kind::Vdb && *options != VdbOptions::default() {
            return Err(Failure::usage(
                "--grid, --density-scale and --up-axis belong to OpenVDB files",
                "write these settings into the job or the scene",
            ));
        }
        match kind {
            Kind::Job => Self::read_job(path),
            Kind::Gltf => Ok(Self::made_up(
                path,
                Job { scene: Some(path.to_string_lossy().into_owned()), ..Job::default() },
            )),
            Kind::Vdb => {
                let stem = path.file_stem().map_or_else(|| "cloud".into(), |s| s.to_string_lossy());
                let spec = VolumeSpec {
                    vdb: Some(path.to_string_lossy().into_owned()),
                    name: Some(stem.clone().into_owned()),
                    density: Some(DensitySpec {
                        grid: options.grid.clone(),
                        scale: options.density_scale,
                    }),
                    phase: Some(PhaseSpec::HenyeyGreenstein { g: CosineSpec::Constant(CLOUD_G) }),
                    up_axis: options.up_axis,
                    ..VolumeSpec::default()
                };
                Ok(Self::made_up(
                    path,
                    Job {
                        volumes: Some(vec![spec]),
                        output: Some(OutputSpec {
                            image: Some(format!("{stem}.exr")),
                            preview: Some(format!("{stem}.png")),
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

    fn read_job(path: &Path) -> Result<Self, Failure> {
        let text = read_text(path, MAX_JOB)?;
        let document = Document::new(path, text);
        let job = document.parse()?;
        let base = path.parent().unwrap_or(Path::new("")).to_owned();
        Ok(Self {
            job,
            document: Some(document),
            path: path.to_owned(),
            base,
            default_scale: DefaultScale::One,
        })
    }
}

/// Reads a text file of limited size.
pub(crate) fn read_text(path: &Path, limit: u64) -> Result<String, Failure> {
    let failed = |source| cannot_read(path, source);
    let file = std::fs::File::open(path).map_err(failed)?;
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > limit {
        let place = pileus_scene::Place::file(path);
        let what = format!("the file is larger than {limit} bytes");
        return Err(pileus_scene::Error::unsupported(place, what, "this is no such file").into());
    }
    String::from_utf8(bytes).map_err(|_| {
        let place = pileus_scene::Place::file(path);
        pileus_scene::Error::invalid(place, "the text is not UTF-8", "save it as UTF-8").into()
    })
}

fn cannot_read(path: &Path, source: std::io::Error) -> Failure {
    Failure::Io { path: path.to_owned(), what: "the file cannot be read".into(), source }
}
