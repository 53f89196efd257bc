//! A job resolved into settings without options: defaults filled in, paths made whole, values
//! checked.

mod camera;
mod film;
mod lights;
mod load;
mod outputs;
mod overrides;
mod places;
mod record;
mod sampling;

pub(crate) use outputs::layers_beside;
pub use outputs::{LayersTo, Outputs};
pub use overrides::{Overrides, SunPosition};
pub(crate) use record::job_hash;

use std::convert::Infallible;
use std::path::{Path, PathBuf};

use pileus_film::Crop;
use pileus_integrator::RenderSettings;
use pileus_scene::uri::{resolve_path, with_frame};
use pileus_scene::volume::DefaultScale;
use pileus_scene::volume_spec::VolumeSpec;
use pileus_scene::{CameraRequest, GlassRule, LensRequest, Loaded, Place};

use crate::failure::Failure;
use crate::input::Input;
use crate::job::Job;
use lights::JobLights;
use places::Places;

/// A job without options.
#[derive(Debug)]
pub struct Settings {
    /// How the scene is sampled.
    pub render: RenderSettings,
    /// The part that is rendered.
    pub crop: Option<Crop>,
    /// Which files are written.
    pub outputs: Outputs,
    /// The job as it was given, with the command line's changes of what is rendered.
    job: Job,
    gltf: Option<(PathBuf, f64)>,
    glass_rule: GlassRule,
    volumes: Vec<VolumeSpec>,
    camera: CameraRequest,
    lens: Option<LensRequest>,
    lights: JobLights,
    resolution: Option<[u32; 2]>,
    default_scale: DefaultScale,
    places: Places,
    base: PathBuf,
    overrides: Overrides,
}

impl Settings {
    /// Resolves what a command was given.
    ///
    /// # Errors
    /// If the job breaks its schema or contradicts itself, or if the command line does.
    pub fn resolve(input: Input, overrides: &Overrides) -> Result<Self, Failure> {
        let Input { job, document, path, base, default_scale } = input;
        let places = match document {
            Some(document) => Places::Job(document),
            None => Places::File(path.clone()),
        };
        places.hold_against_schema()?;
        let job = overrides.applied_to(job, &base)?;
        let film = job.film.clone().unwrap_or_default();
        let gltf = job.gltf.clone().unwrap_or_default();
        let volumes = job.volumes.iter().flatten().map(|spec| {
            let mut spec = spec.clone();
            let whole = |_: &str, name: &str| {
                let path = resolve_path(&base, name);
                Ok::<_, Infallible>(path.to_string_lossy().into_owned())
            };
            let Ok(()) = spec.resolve_files(whole);
            spec
        });
        Ok(Self {
            render: sampling::resolve(&job, film::filter(&film, &places)?, &places)?,
            crop: film::crop(&film, overrides.crop.is_some(), &places)?,
            outputs: Outputs::resolve(&job, overrides, &path, &base)?,
            gltf: job
                .scene
                .as_ref()
                .map(|name| (resolve_path(&base, name), gltf.lumens_per_watt())),
            glass_rule: gltf.glass().0,
            volumes: volumes.collect(),
            camera: camera::resolve(job.camera.as_ref(), overrides.orbit, &places),
            lens: camera::lens(job.camera.as_ref(), &places),
            lights: JobLights::resolve(&job, &base, &places)?,
            resolution: film::resolution(&film, &places)?,
            default_scale,
            places,
            job,
            base,
            overrides: overrides.clone(),
        })
    }

    /// The job as it was given, with the command line's changes of what is rendered.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// Where an option of the job stands, given by its JSON pointer.
    pub(crate) fn place(&self, pointer: &str) -> Place {
        self.places.at(pointer)
    }

    /// Every file that is read: what was given on the command line, and after loading all that it
    /// led to.
    pub(crate) fn reads(&self, loaded: Option<&Loaded>) -> Vec<PathBuf> {
        let mut reads = vec![self.places.file().to_owned()];
        let further = self.files().into_iter().chain(loaded.iter().flat_map(|l| l.files.clone()));
        for path in further {
            if !reads.contains(&path) {
                reads.push(path);
            }
        }
        reads
    }

    /// All files that the job names.
    pub fn files(&self) -> Vec<PathBuf> {
        let gltf = self.gltf.iter().map(|(path, _)| path.clone());
        let mut volumes = Vec::new();
        for spec in &self.volumes {
            let frame = spec.frame;
            let collect = |key: &str, name: &str| {
                let by_frame = (key == "/vdb").then(|| with_frame(name, frame, &Place::default()));
                let name_of_file = by_frame.and_then(Result::ok);
                volumes.push(PathBuf::from(name_of_file.as_deref().unwrap_or(name)));
                Ok::<_, Infallible>(name.to_owned())
            };
            let Ok(()) = spec.clone().resolve_files(collect);
        }
        gltf.chain(volumes).chain(self.lights.file().map(Path::to_owned)).collect()
    }
}
