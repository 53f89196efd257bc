//! A job resolved into settings without options: defaults filled in, paths made whole, values
//! checked.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{DVec3, Vec3};
use pileus_film::{Crop, FIRST_LAYERS, Filter, LAYERS, Layer, VARIANCE};
use pileus_integrator::{
    DEFAULT_MAX_EVENTS, Distance, RenderSettings, ShadowRoulette, Transmittance,
};
use pileus_media::MajorantStructure;
use pileus_media::distance::DistanceSampler;
use pileus_media::transmittance::Estimator;
use pileus_scene::json::Document;
use pileus_scene::uri::{resolve_path, with_frame};
use pileus_scene::volume::{DefaultScale, NAME_THE_GRID};
use pileus_scene::volume_spec::{AlbedoSpec, DensitySpec, InterpolationSpec, Rgb, VolumeSpec};
use pileus_scene::{
    CameraRequest, ClearSky, Environment, EnvironmentImage, Error, GlassRule, Light, Loaded, Place,
    Point, Scene, SceneRequest, Sun, VolumeSource,
};

use crate::escape;
use crate::failure::Failure;
use crate::input::Input;
use crate::job::{
    CameraSpec, DEFAULT_FILTER_RADIUS, DEFAULT_FOV_Y, DEFAULT_LUMENS_PER_WATT, DEFAULT_SPP,
    DistanceSpec, FilmSpec, FilterKind, FilterSpec, GlassSpec, Job, LightSpec, MAX_SPP, OutputSpec,
    SamplingSpec, ShadowRouletteSpec, TransmittanceSpec,
};
use crate::outputs::Target;
use crate::schema::job_schema;
use crate::validate::validate;

/// Half width of a Blackman-Harris filter of jobs that do not say, pixels.
const BLACKMAN_HARRIS_RADIUS: f32 = 1.5;

/// What the command line changes about a job.
#[derive(Debug, Clone, Default)]
pub struct Overrides {
    /// Where the image goes, relative to the current folder.
    pub image: Option<PathBuf>,
    /// Where the preview goes, relative to the current folder.
    pub preview: Option<PathBuf>,
    /// Samples per pixel.
    pub spp: Option<u64>,
    /// Seed.
    pub seed: Option<u64>,
    /// Width and height of the full image.
    pub resolution: Option<[u32; 2]>,
    /// Name of a camera of the scene.
    pub camera: Option<String>,
    /// Write no preview.
    pub no_preview: bool,
    /// Write no statistics.
    pub no_stats: bool,
    /// Write no layers.
    pub no_layers: bool,
    /// Where to write the job that renders the same image again, relative to the current folder.
    pub save_job: Option<PathBuf>,
}

/// Which files are written.
#[derive(Debug, Clone, PartialEq)]
pub struct Outputs {
    /// The EXR image.
    pub image: PathBuf,
    /// Whether colours and alpha are stored as 16-bit floats.
    pub half: bool,
    /// The PNG preview.
    pub preview: Option<PathBuf>,
    /// Exposure of the preview, stops.
    pub exposure: f32,
    /// Counters and times.
    pub stats: Option<PathBuf>,
    /// Layers that the film has beside the first ones.
    pub further: Vec<&'static Layer>,
    /// Where the layers go that are not the picture.
    pub layers: LayersTo,
}

/// Where the layers of an image go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LayersTo {
    /// Into an EXR of their own.
    File(PathBuf),
    /// Into the image.
    Image,
    /// They are not written.
    Nowhere,
}

/// The name of the file with the layers of an image, unless another one was asked for.
pub(crate) fn layers_beside(image: &Path) -> PathBuf {
    image.with_extension("layers.exr")
}

/// A job without options.
#[derive(Debug)]
pub struct Settings {
    /// The job with the command line's changes, as the image's metadata records it.
    pub job: Job,
    /// How the scene is sampled.
    pub render: RenderSettings,
    /// The part that is rendered.
    pub crop: Option<Crop>,
    /// Which files are written.
    pub outputs: Outputs,
    gltf: Option<(PathBuf, f64)>,
    volumes: Vec<VolumeSpec>,
    camera: CameraRequest,
    lights: Vec<Light>,
    constant: Option<Vec3>,
    image: Option<EnvironmentSource>,
    resolution: Option<[u32; 2]>,
    default_scale: DefaultScale,
    places: Places,
    base: PathBuf,
    overrides: Overrides,
}

/// Where the environment's image comes from.
#[derive(Debug, Clone)]
enum EnvironmentSource {
    File(EnvironmentFile),
    Sky { sky: ClearSky, pointer: String },
}

#[derive(Debug, Clone)]
struct EnvironmentFile {
    path: PathBuf,
    intensity: f32,
    rotation_y: f64,
    pointer: String,
}

/// Where the values of a job stand.
#[derive(Debug, Clone)]
enum Places {
    /// In a file.
    Job(Document),
    /// Nowhere: the job was made up for this file.
    File(PathBuf),
}

impl Places {
    fn at(&self, pointer: &str) -> Place {
        match self {
            Self::File(path) => Place::file(path),
            Self::Job(document) => {
                // A value that has a default need not be there: its parent is.
                let mut pointer = pointer;
                loop {
                    let place = document.place(pointer);
                    match pointer.rfind('/') {
                        Some(end) if place.line.is_none() => pointer = &pointer[..end],
                        _ => return place,
                    }
                }
            }
        }
    }

    fn invalid(&self, pointer: &str, what: impl Into<String>, remedy: &str) -> Failure {
        Error::invalid(self.at(pointer), what, remedy).into()
    }

    fn unsupported(&self, pointer: &str, what: &str, remedy: &str) -> Failure {
        Error::unsupported(self.at(pointer), what, remedy).into()
    }
}

impl Settings {
    /// Resolves what a command was given.
    pub fn resolve(input: Input, overrides: &Overrides) -> Result<Self, Failure> {
        let Input { mut job, document, path, base, default_scale } = input;
        let places = match document {
            Some(document) => Places::Job(document),
            None => Places::File(path.clone()),
        };
        override_job(&mut job, overrides);
        let outputs = outputs(&job, overrides, &path, &base, &places)?;
        let film = job.film.clone().unwrap_or_default();
        let (lights, constant, image) = lights(&job, &base, &places)?;
        let lumens_per_watt =
            job.gltf.as_ref().and_then(|g| g.lumens_per_watt).unwrap_or(DEFAULT_LUMENS_PER_WATT);
        if !(lumens_per_watt > 0.0 && lumens_per_watt.is_finite()) {
            return Err(places.invalid(
                "/gltf/lumens_per_watt",
                format!("lumens_per_watt is {lumens_per_watt}"),
                "use a number above 0; 683 is the default",
            ));
        }
        let render = sampling(&job, filter(&film, &places)?, &places)?;
        let (crop, resolution) = (crop(&film, &places)?, resolution(&film, &places)?);
        let camera = camera(job.camera.as_ref(), &places)?;
        not_in_this_version(&job, &places)?;
        if let Places::Job(document) = &places {
            hold_against_schema(document)?;
        }
        let volumes = job.volumes.iter().flatten().map(|spec| {
            let mut spec = spec.clone();
            let whole = |_: &str, name: &str| {
                let path = resolve_path(&base, name);
                Ok::<_, std::convert::Infallible>(path.to_string_lossy().into_owned())
            };
            let Ok(()) = spec.resolve_files(whole);
            spec
        });
        Ok(Self {
            render,
            crop,
            outputs,
            gltf: job.scene.as_ref().map(|name| (resolve_path(&base, name), lumens_per_watt)),
            volumes: volumes.collect(),
            camera,
            lights,
            constant,
            image,
            resolution,
            default_scale,
            places,
            job,
            base,
            overrides: overrides.clone(),
        })
    }

    /// What is written, for messages and to be checked; `pixels`: how many the image has, if that
    /// is known.
    pub(crate) fn targets(&self, pixels: u64) -> Vec<Target> {
        let Outputs { image, half, preview, stats, further, layers, .. } = &self.outputs;
        let of_image = self.overrides.image.is_some();
        let at = |key: &str, by_option: bool| (!by_option).then(|| self.places.at(key));
        // Colour and alpha; variances and what was asked for in single precision; the job's text.
        let picture = if *half { 4 * 2 } else { 4 * 4 };
        let channels: usize = further.iter().map(|layer| layer.channels.len()).sum();
        let of_layers = 4 * (VARIANCE.channels.len() + channels) as u64;
        let per_pixel = if *layers == LayersTo::Image { picture + of_layers } else { picture };
        let mut targets = vec![Target {
            what: "the image",
            path: image.clone(),
            at: at("/output/image", of_image),
            bytes: pixels.saturating_mul(per_pixel).saturating_add(1 << 12),
            remedy: "name another file: `image` under `output`, or -o on the command line",
        }];
        targets.extend(preview.iter().map(|path| Target {
            what: "the preview",
            path: path.clone(),
            at: at("/output/preview", self.overrides.preview.is_some() || of_image),
            bytes: pixels.saturating_mul(3),
            remedy: "name another file: `preview` under `output`, or --preview on the command \
                     line; null or --no-preview for none",
        }));
        if let LayersTo::File(path) = layers {
            targets.push(Target {
                what: "the file of layers",
                path: path.clone(),
                at: at("/output/layers", of_image),
                bytes: pixels.saturating_mul(of_layers).saturating_add(1 << 12),
                remedy: "name another file: `layers` under `output`; null or --no-layers for none",
            });
        }
        targets.extend(stats.iter().map(|path| Target {
            what: "the statistics file",
            path: path.clone(),
            at: at("/output/stats", of_image),
            bytes: 1 << 14,
            remedy: "name another file: `stats` under `output`; null or --no-stats for none",
        }));
        targets.extend(self.overrides.save_job.iter().map(|path| Target {
            what: "the saved job",
            path: path.clone(),
            at: None,
            bytes: 1 << 12,
            remedy: "name another file",
        }));
        targets
    }

    /// Every file that is read: what was given on the command line, and after loading all that it
    /// led to.
    pub(crate) fn reads(&self, loaded: Option<&Loaded>) -> Vec<PathBuf> {
        let given = match &self.places {
            Places::Job(document) => document.path().to_owned(),
            Places::File(path) => path.clone(),
        };
        let mut reads = vec![given];
        let further = self.files().into_iter().chain(loaded.iter().flat_map(|l| l.files.clone()));
        for path in further {
            if !reads.contains(&path) {
                reads.push(path);
            }
        }
        reads
    }

    /// The job that renders the same image again, whatever folder it lies in: with all paths from
    /// the root on.
    pub(crate) fn saved_job(&self) -> Job {
        let whole = |name: &Path| {
            let path = self.base.join(name);
            std::path::absolute(&path).unwrap_or(path).to_string_lossy().into_owned()
        };
        let here = |path: &Path| {
            std::path::absolute(path).unwrap_or(path.to_owned()).to_string_lossy().into_owned()
        };
        let mut job = self.job.clone();
        job.scene = job.scene.map(|name| whole(Path::new(&name)));
        for spec in job.volumes.iter_mut().flatten() {
            let resolve =
                |_: &str, name: &str| Ok::<_, std::convert::Infallible>(whole(Path::new(name)));
            let Ok(()) = spec.resolve_files(resolve);
        }
        for light in job.lights.iter_mut().flatten() {
            if let LightSpec::Environment { image: Some(name), .. } = light {
                *name = whole(Path::new(name));
            }
        }
        let Outputs { image, preview, stats, exposure, layers, .. } = &self.outputs;
        let mut output = job.output.unwrap_or_default();
        if *layers == LayersTo::Nowhere {
            (output.aovs, output.layers_in_image) = (None, None);
        }
        job.output = Some(OutputSpec {
            image: Some(here(image)),
            preview: Some(preview.as_deref().map(here)),
            stats: Some(stats.as_deref().map(here)),
            exposure: Some(*exposure),
            layers: match layers {
                LayersTo::File(path) => Some(Some(here(path))),
                LayersTo::Image => None,
                LayersTo::Nowhere => Some(None),
            },
            ..output
        });
        job
    }

    /// Loads all files and builds the scene.
    pub fn load(&mut self) -> Result<Loaded, Failure> {
        let start = Instant::now();
        let image = match &self.image {
            Some(EnvironmentSource::File(file)) => Some(Arc::new(
                EnvironmentImage::open(&file.path, file.intensity, file.rotation_y)
                    .map_err(|error| name_place(error, &self.places.at(&file.pointer)))?,
            )),
            Some(EnvironmentSource::Sky { sky, pointer }) => {
                let image = sky.image().map_err(|error| {
                    Error::invalid(self.places.at(pointer), error.to_string(), error.remedy())
                })?;
                Some(Arc::new(image))
            }
            None => None,
        };
        let environment = (self.constant.is_some() || image.is_some())
            .then(|| Environment { constant: self.constant.unwrap_or(Vec3::ZERO), image });
        let seconds = start.elapsed().as_secs_f64();
        let places = self.places.clone();
        let mut loaded = Scene::load(SceneRequest {
            gltf: self.gltf.clone(),
            glass_rule: match self.job.gltf.as_ref().and_then(|gltf| gltf.glass) {
                Some(GlassSpec::ByTheLetter) => GlassRule::ByTheLetter,
                Some(GlassSpec::ClosedMeshesAreSolid) | None => GlassRule::default(),
            },
            volumes: self.volumes.clone(),
            volume_place: &|i, key| places.at(&format!("/volumes/{i}{key}")),
            camera: self.camera.clone(),
            lights: self.lights.clone(),
            environment,
            resolution: self.resolution,
            default_scale: self.default_scale,
        })
        .map_err(|error| self.in_words_of_options(error))?;
        loaded.seconds_load += seconds;
        show_safely(&mut loaded);
        self.record(&loaded.scene);
        Ok(loaded)
    }

    /// Errors about volumes that were given on the command line speak of its options.
    fn in_words_of_options(&self, error: Error) -> Failure {
        if matches!(self.places, Places::Job(_)) || self.gltf.is_some() {
            return error.into();
        }
        match error {
            Error::Missing { place, what, remedy } => {
                let remedy = remedy.replace(NAME_THE_GRID, "name one with --grid NAME");
                Error::Missing { place, what, remedy }.into()
            }
            // Nobody but `--grid` names a grid here.
            Error::Vdb { source, .. } if matches!(*source, pileus_vdb::Error::Missing { .. }) => {
                Failure::usage(source.to_string(), "name a grid of the file with --grid NAME")
            }
            other => other.into(),
        }
    }

    /// Fills into the job what loading decided, so that it tells how the image came about.
    fn record(&mut self, scene: &Scene) {
        let camera = &scene.camera;
        let film = self.job.film.get_or_insert_default();
        film.resolution = Some(camera.resolution());
        if self.job.camera.is_none() {
            self.job.camera = Some(CameraSpec {
                position: Some(camera.position().to_array()),
                look_at: Some((camera.position() + camera.forward()).to_array()),
                up: Some(camera.up().to_array()),
                fov_y: Some(camera.fov_y_degrees()),
                ..CameraSpec::default()
            });
        }
        let sampling = self.job.sampling.get_or_insert_default();
        sampling.spp = Some(self.render.samples.end);
        sampling.seed = Some(self.render.seed);
        // Volumes of the glTF file come first, see `Scene::load`.
        let own = self.job.volumes.iter_mut().flatten();
        for (spec, volume) in own.rev().zip(scene.volumes.iter().rev()) {
            if let VolumeSource::Vdb { grid, density_scale, fire, .. } = &volume.source {
                spec.density =
                    Some(DensitySpec { grid: Some(grid.clone()), scale: Some(*density_scale) });
                if let Some((emission, albedo)) = fire.as_deref() {
                    spec.emission.get_or_insert_with(|| emission.clone());
                    spec.albedo.get_or_insert(AlbedoSpec::Constant(Rgb::Grey(*albedo)));
                }
            }
        }
    }

    /// A number that tells jobs apart: FNV-1a over what determines the value of a sample. Where the
    /// files go and how many samples are taken does not count.
    pub fn job_hash(&self) -> String {
        let mut job = Job { output: None, schema: None, ..self.job.clone() };
        if let Some(sampling) = &mut job.sampling {
            sampling.spp = None;
        }
        let text = serde_json::to_string(&job).unwrap_or_default();
        let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        format!("{hash:016x}")
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
                Ok::<_, std::convert::Infallible>(name.to_owned())
            };
            let Ok(()) = spec.clone().resolve_files(collect);
        }
        let image = self.image.iter().filter_map(|source| match source {
            EnvironmentSource::File(file) => Some(file.path.clone()),
            EnvironmentSource::Sky { .. } => None,
        });
        gltf.chain(volumes).chain(image).collect()
    }
}

/// Names from files reach the terminal, the plan and the metadata: without control characters.
fn show_safely(loaded: &mut Loaded) {
    let names = loaded.scene.volumes.iter_mut().map(|volume| &mut volume.name);
    let sentences = loaded.notes.iter_mut().chain(&mut loaded.scene.not_modelled);
    for text in names.chain(sentences) {
        if let Cow::Owned(safe) = escape::line(text) {
            *text = safe;
        }
    }
}

/// What the schema refuses the program refuses.
fn hold_against_schema(document: &Document) -> Result<(), Failure> {
    let value: serde_json::Value = document.parse()?;
    let Err(fault) = validate(&job_schema(), &value) else { return Ok(()) };
    let place = document.place(&fault.pointer);
    Err(match fault.later {
        true => Error::unsupported(place, fault.what, fault.remedy),
        false => Error::invalid(place, fault.what, fault.remedy),
    }
    .into())
}

/// What the format has and no part of this version renders.
fn not_in_this_version(job: &Job, places: &Places) -> Result<(), Failure> {
    for (i, volume) in job.volumes.iter().flatten().enumerate() {
        if volume.interpolation == Some(InterpolationSpec::Tricubic) {
            return Err(places.unsupported(
                &format!("/volumes/{i}/interpolation"),
                "interpolation `tricubic` is not rendered by this version",
                "use \"trilinear\" or \"nearest\"",
            ));
        }
    }
    Ok(())
}

/// The direction of a vector of any length; `None` if it has none.
fn direction(vector: [f64; 3]) -> Option<DVec3> {
    let vector = DVec3::from_array(vector);
    vector.try_normalize().or_else(|| {
        // Squares of very large or small numbers are not finite or zero.
        let largest = vector.abs().max_element();
        (largest > 0.0 && largest.is_finite()).then(|| vector / largest)?.try_normalize()
    })
}

/// Adds the place in the job to an error that names only the file.
fn name_place(error: Error, asked_at: &Place) -> Error {
    match error {
        Error::Io { place, source } => {
            let part = format!("named at {asked_at}");
            Error::io(Place { part: Some(part), ..*place }, source)
        }
        other => other,
    }
}

fn override_job(job: &mut Job, overrides: &Overrides) {
    if overrides.spp.is_some() || overrides.seed.is_some() {
        let sampling = job.sampling.get_or_insert_default();
        sampling.spp = overrides.spp.or(sampling.spp);
        sampling.seed = overrides.seed.or(sampling.seed);
    }
    if overrides.camera.is_some() {
        job.camera = Some(CameraSpec { node: overrides.camera.clone(), ..CameraSpec::default() });
    }
    if overrides.resolution.is_some() {
        job.film.get_or_insert_default().resolution = overrides.resolution;
    }
}

fn outputs(
    job: &Job,
    overrides: &Overrides,
    input: &Path,
    base: &Path,
    places: &Places,
) -> Result<Outputs, Failure> {
    let default = OutputSpec::default();
    let output = job.output.as_ref().unwrap_or(&default);
    let asked_for: Vec<&String> = output.aovs.iter().flatten().collect();
    for (i, name) in asked_for.iter().enumerate() {
        if Layer::named(name).is_none_or(Layer::is_picture) {
            let names = LAYERS.iter().filter(|layer| !layer.is_picture()).map(|layer| layer.name);
            return Err(places.unsupported(
                &format!("/output/aovs/{i}"),
                &format!("there is no layer `{name}` in this version"),
                &format!("take of: {}", names.collect::<Vec<_>>().join(", ")),
            ));
        }
    }
    // In the order of the table, whatever the job's: slices of equal jobs merge.
    let mut further = LAYERS[FIRST_LAYERS..].to_vec();
    further.retain(|layer| asked_for.iter().any(|name| *name == layer.name));
    let stem = input.file_stem().map_or_else(|| "pileus".into(), |s| s.to_string_lossy());
    let image = match (&overrides.image, &output.image) {
        (Some(path), _) => path.clone(),
        (None, Some(name)) => base.join(name),
        (None, None) => PathBuf::from(format!("{stem}.exr")),
    };
    if !has_extension(&image, "exr") {
        let remedy = "name the image .exr; for a picture to look at add --preview FILE.png";
        return Err(match overrides.image {
            Some(_) => Failure::usage(format!("{} is not an EXR file", image.display()), remedy),
            None => places.invalid("/output/image", "the image is written as OpenEXR", remedy),
        });
    }
    let beside = || image.with_extension("png");
    let preview = match (&overrides.preview, &output.preview) {
        _ if overrides.no_preview => None,
        (Some(path), _) => Some(path.clone()),
        (None, Some(None)) => None,
        // An image that goes elsewhere takes its preview along.
        (None, Some(Some(name))) if overrides.image.is_none() => Some(base.join(name)),
        (None, _) => Some(beside()),
    };
    if let Some(preview) = preview.as_ref().filter(|path| !has_extension(path, "png")) {
        let remedy = "name the preview .png";
        return Err(match overrides.preview {
            Some(_) => Failure::usage(format!("{} is not a PNG file", preview.display()), remedy),
            None => places.invalid("/output/preview", "the preview is written as PNG", remedy),
        });
    }
    let stats = match &output.stats {
        _ if overrides.no_stats => None,
        Some(None) => None,
        Some(Some(name)) => Some(base.join(name)),
        None => Some(image.with_extension("stats.json")),
    };
    let layers = match &output.layers {
        _ if overrides.no_layers => LayersTo::Nowhere,
        _ if output.layers_in_image == Some(true) => LayersTo::Image,
        Some(None) => LayersTo::Nowhere,
        Some(Some(name)) if overrides.image.is_none() => LayersTo::File(base.join(name)),
        _ => LayersTo::File(layers_beside(&image)),
    };
    let layers_file = match &layers {
        LayersTo::File(path) => Some(path),
        LayersTo::Image | LayersTo::Nowhere => None,
    };
    if layers == LayersTo::Nowhere {
        further.clear();
    }
    if layers_file.is_some_and(|path| !has_extension(path, "exr")) {
        let remedy = "name the file .exr";
        return Err(places.invalid("/output/layers", "layers are written as OpenEXR", remedy));
    }
    let named = [
        (overrides.image.is_some(), output.image.is_some(), "/output/image", Some(&image)),
        (
            overrides.preview.is_some(),
            matches!(output.preview, Some(Some(_))),
            "/output/preview",
            preview.as_ref(),
        ),
        (false, matches!(output.stats, Some(Some(_))), "/output/stats", stats.as_ref()),
        (false, matches!(output.layers, Some(Some(_))), "/output/layers", layers_file),
    ];
    for (by_option, by_job, pointer, path) in named {
        let by_job = by_job && matches!(places, Places::Job(_));
        let name = path.and_then(|path| path.file_name()).map(|name| name.to_string_lossy());
        if (by_option || by_job) && name.is_some_and(|name| name.contains('#')) {
            // Written as it stands, every frame would overwrite the one before.
            let what = "no frame number is filled in for the `#` in the name of an output by this \
                        version";
            let remedy = "give each frame a name of its own, without `#`";
            return Err(match by_option {
                true => Failure::usage(what, remedy),
                false => places.unsupported(pointer, what, remedy),
            });
        }
    }
    let exposure = output.exposure.unwrap_or(0.0);
    if !(exposure.abs() <= 64.0) {
        let what = format!("the exposure is {exposure} stops");
        return Err(places.invalid("/output/exposure", what, "use -64 to 64"));
    }
    let half = output.half.unwrap_or(false);
    Ok(Outputs { image, half, preview, exposure, stats, further, layers })
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

fn resolution(film: &FilmSpec, places: &Places) -> Result<Option<[u32; 2]>, Failure> {
    let pixels = film.resolution.map(|[w, h]| u64::from(w) * u64::from(h));
    if pixels.is_some_and(|n| n == 0 || n > pileus_film::MAX_PIXELS) {
        return Err(places.invalid(
            "/film/resolution",
            format!("the image has {} pixels", pixels.unwrap_or(0)),
            "use a width and a height of at least 1, and fewer than 2^28 pixels",
        ));
    }
    Ok(film.resolution)
}

fn crop(film: &FilmSpec, places: &Places) -> Result<Option<Crop>, Failure> {
    let Some([x0, y0, width, height]) = film.crop else { return Ok(None) };
    let inside = film.resolution.is_none_or(|[w, h]| {
        u64::from(x0) + u64::from(width) <= u64::from(w)
            && u64::from(y0) + u64::from(height) <= u64::from(h)
    });
    if width == 0 || height == 0 || !inside {
        return Err(places.invalid(
            "/film/crop",
            format!("the crop {:?} is empty or leaves the image", [x0, y0, width, height]),
            "give left, top, width and height in pixels inside the resolution",
        ));
    }
    Ok(Some(Crop { x0, y0, width, height }))
}

fn filter(film: &FilmSpec, places: &Places) -> Result<Filter, Failure> {
    let FilterSpec { kind, radius } = film.filter.clone().unwrap_or_default();
    let filter = match kind.unwrap_or_default() {
        FilterKind::Box => Filter::Box { radius: radius.unwrap_or(DEFAULT_FILTER_RADIUS) },
        FilterKind::BlackmanHarris => {
            Filter::BlackmanHarris { radius: radius.unwrap_or(BLACKMAN_HARRIS_RADIUS) }
        }
    };
    filter.validate().map_err(|error| {
        places.invalid("/film/filter/radius", error.to_string(), "0.5 is one pixel")
    })?;
    Ok(filter)
}

fn sampling(job: &Job, filter: Filter, places: &Places) -> Result<RenderSettings, Failure> {
    let SamplingSpec {
        spp,
        seed,
        max_bounces,
        max_events,
        transmittance,
        distance,
        majorants,
        majorant_scale,
        shadow_roulette,
        clamp,
        level_exponent,
    } = job.sampling.clone().unwrap_or_default();
    let level_exponent = level_exponent.unwrap_or(RenderSettings::default().level_exponent);
    if !(level_exponent > 1.0 && level_exponent <= 16.0) {
        return Err(places.invalid(
            "/sampling/level_exponent",
            format!("a level exponent of {level_exponent}"),
            "give a number above 1 (else the work is infinite) and at most 16; 1.5 is the default",
        ));
    }
    let spp = spp.unwrap_or(DEFAULT_SPP);
    if !(1..=MAX_SPP).contains(&spp) {
        return Err(places.invalid(
            "/sampling/spp",
            format!("{spp} samples per pixel"),
            "take at least 1 and at most 2^32",
        ));
    }
    let majorants = match majorants.as_deref() {
        None | Some("auto") => MajorantStructure::default(),
        Some(name) => MajorantStructure::from_name(name).ok_or_else(|| {
            places.invalid(
                "/sampling/majorants",
                format!("there is no majorant structure `{name}`"),
                "take auto, adaptive, hierarchy, kd_tree, uniform_N with N voxels, or global",
            )
        })?,
    };
    let majorant_scale = majorant_scale.unwrap_or(1.0);
    if !(majorant_scale > 0.0 && majorant_scale.is_finite()) {
        return Err(places.invalid(
            "/sampling/majorant_scale",
            format!("a majorant scale of {majorant_scale}"),
            "give a positive number; 1 keeps the proven bounds",
        ));
    }
    if max_events == Some(Some(0)) {
        return Err(places.invalid(
            "/sampling/max_events",
            "at most 0 events on a path",
            "give at least 1; null is unlimited, and 1048576 the default",
        ));
    }
    if let Some(most) = clamp.filter(|most| !(*most > 0.0 && most.is_finite())) {
        return Err(places.invalid(
            "/sampling/clamp",
            format!("a largest luminance of {most}"),
            "give a positive number, or null for no limit",
        ));
    }
    Ok(RenderSettings {
        samples: 0..spp,
        seed: seed.unwrap_or(0),
        max_bounces,
        max_events: max_events.unwrap_or(Some(DEFAULT_MAX_EVENTS)),
        filter,
        transmittance: match transmittance.unwrap_or_default() {
            TransmittanceSpec::Auto => Transmittance::Auto,
            TransmittanceSpec::Regular => Transmittance::By(Estimator::Regular),
            TransmittanceSpec::Delta => Transmittance::By(Estimator::Delta),
            TransmittanceSpec::Ratio => Transmittance::By(Estimator::Ratio),
            TransmittanceSpec::ResidualRatio => Transmittance::By(Estimator::ResidualRatio),
            TransmittanceSpec::NextFlight => Transmittance::By(Estimator::NextFlight),
            TransmittanceSpec::Volterra => Transmittance::By(Estimator::Volterra),
            TransmittanceSpec::Taylor => Transmittance::By(Estimator::Taylor),
            TransmittanceSpec::PseriesCumulative => Transmittance::By(Estimator::PseriesCumulative),
            TransmittanceSpec::PseriesCmf => Transmittance::By(Estimator::PseriesCmf),
            TransmittanceSpec::Bidirectional => Transmittance::By(Estimator::Bidirectional),
            TransmittanceSpec::UnbiasedRayMarching => {
                Transmittance::By(Estimator::UnbiasedRayMarching)
            }
            TransmittanceSpec::DebiasedRayMarching => {
                Transmittance::By(Estimator::DebiasedRayMarching)
            }
            TransmittanceSpec::RayMarching => Transmittance::By(Estimator::RayMarching),
        },
        distance: match distance.unwrap_or_default() {
            DistanceSpec::Auto => Distance::Auto,
            DistanceSpec::Analytic => Distance::By(DistanceSampler::Analytic),
            DistanceSpec::Delta => Distance::By(DistanceSampler::Delta),
            DistanceSpec::WeightedDelta => Distance::By(DistanceSampler::WeightedDelta),
            DistanceSpec::Decomposition => Distance::By(DistanceSampler::Decomposition),
            DistanceSpec::Regular => Distance::By(DistanceSampler::Regular),
            DistanceSpec::Spectral => Distance::By(DistanceSampler::Spectral),
            DistanceSpec::Split => Distance::Split,
            DistanceSpec::Equiangular => Distance::Equiangular,
            DistanceSpec::RayMarching => Distance::By(DistanceSampler::RayMarching),
        },
        majorants,
        majorant_scale,
        shadow_roulette: match shadow_roulette.unwrap_or_default() {
            ShadowRouletteSpec::Auto => ShadowRoulette::Auto,
            ShadowRouletteSpec::Importance => ShadowRoulette::Importance,
            ShadowRouletteSpec::Expected => ShadowRoulette::Expected,
        },
        clamp,
        level_exponent,
        ..RenderSettings::default()
    })
}

fn camera(spec: Option<&CameraSpec>, places: &Places) -> Result<CameraRequest, Failure> {
    let Some(spec) = spec else {
        return Ok(CameraRequest::Auto { fov_y_degrees: DEFAULT_FOV_Y });
    };
    if spec.shutter.is_some_and(|times| times != [0.0, 0.0]) {
        return Err(places.unsupported(
            "/camera/shutter",
            "motion is not rendered by this version",
            "set the shutter to [0, 0] or remove it",
        ));
    }
    let fov_y_degrees = spec.fov_y.unwrap_or(DEFAULT_FOV_Y);
    if let Some(name) = &spec.node {
        let placed = [
            (spec.position.is_some(), "/camera/position"),
            (spec.look_at.is_some(), "/camera/look_at"),
            (spec.up.is_some(), "/camera/up"),
            (spec.fov_y.is_some(), "/camera/fov_y"),
        ];
        if let Some((_, pointer)) = placed.into_iter().find(|(given, _)| *given) {
            return Err(places.invalid(
                pointer,
                "the camera has a `node` and a placement of its own",
                "keep one of the two",
            ));
        }
        return Ok(CameraRequest::Node { name: name.clone(), place: places.at("/camera/node") });
    }
    match (spec.position, spec.look_at) {
        (Some(position), Some(target)) => Ok(CameraRequest::LookAt {
            position: DVec3::from_array(position),
            target: DVec3::from_array(target),
            up: DVec3::from_array(spec.up.unwrap_or([0.0, 1.0, 0.0])),
            fov_y_degrees,
            place: places.at("/camera"),
        }),
        (None, None) if spec.up.is_none() => Ok(CameraRequest::Auto { fov_y_degrees }),
        _ => Err(places.invalid(
            "/camera",
            "the camera is placed by half",
            "give both `position` and `look_at`, or neither to frame the volumes",
        )),
    }
}

type Lights = (Vec<Light>, Option<Vec3>, Option<EnvironmentSource>);

fn lights(job: &Job, base: &Path, places: &Places) -> Result<Lights, Failure> {
    let (mut lights, mut constant, mut image) = (Vec::new(), None, None);
    for (i, light) in job.lights.iter().flatten().enumerate() {
        let pointer = |key: &str| format!("/lights/{i}{key}");
        let colour = |rgb: &Rgb, key: &str| {
            let channels = Vec3::from_array(rgb.channels().map(|c| c as f32));
            if channels.is_finite() && channels.min_element() >= 0.0 {
                return Ok(channels);
            }
            let what = format!("the light's colour is {:?}", rgb.channels());
            Err(places.invalid(&pointer(key), what, "use finite numbers of at least 0"))
        };
        match light {
            LightSpec::Sun { to_light, irradiance, angular_diameter } => {
                let Some(to_light) = direction(*to_light) else {
                    return Err(places.invalid(
                        &pointer("/to_light"),
                        "the sun has no direction",
                        "give a vector that is not zero",
                    ));
                };
                let degrees = angular_diameter.unwrap_or(0.0);
                if !(0.0..180.0).contains(&degrees) {
                    return Err(places.invalid(
                        &pointer("/angular_diameter"),
                        format!("the sun is {degrees} degrees wide"),
                        "use an angle of at least 0 and below 180; seen from the Earth it is 0.53",
                    ));
                }
                lights.push(Light::Sun(Sun {
                    to_light: to_light.as_vec3().normalize(),
                    irradiance: colour(irradiance, "/irradiance")?,
                    angular_diameter: degrees.to_radians() as f32,
                }));
            }
            LightSpec::Point { position, intensity } => lights.push(Light::Point(Point {
                position: DVec3::from_array(*position),
                intensity: colour(intensity, "/intensity")?,
            })),
            LightSpec::Environment {
                radiance: Some(radiance),
                image: None,
                intensity,
                rotation_y,
            } => {
                if intensity.is_some() || rotation_y.is_some() {
                    let key = if intensity.is_some() { "/intensity" } else { "/rotation_y" };
                    return Err(places.invalid(
                        &pointer(key),
                        "this key belongs to environments with an `image`",
                        "remove it",
                    ));
                }
                let sum = constant.unwrap_or(Vec3::ZERO) + colour(radiance, "/radiance")?;
                constant = Some(sum.min(Vec3::splat(f32::MAX)));
            }
            LightSpec::Environment { radiance: None, image: Some(name), intensity, rotation_y } => {
                one_image(image.as_ref(), &pointer(""), places)?;
                let intensity = intensity.unwrap_or(1.0);
                let rotation_y = rotation_y.unwrap_or(0.0);
                if !(intensity >= 0.0 && (intensity as f32).is_finite() && rotation_y.is_finite()) {
                    return Err(places.invalid(
                        &pointer("/intensity"),
                        format!("intensity {intensity}, rotation {rotation_y}"),
                        "use a finite intensity of at least 0",
                    ));
                }
                image = Some(EnvironmentSource::File(EnvironmentFile {
                    path: base.join(name),
                    intensity: intensity as f32,
                    rotation_y,
                    pointer: pointer("/image"),
                }));
            }
            LightSpec::Sky { .. } => {
                one_image(image.as_ref(), &pointer(""), places)?;
                let sky = clear_sky(light, &pointer(""), places)?;
                lights.extend(sky.sun()?);
                image = Some(EnvironmentSource::Sky { sky, pointer: pointer("") });
            }
            LightSpec::Environment { .. } => {
                return Err(places.invalid(
                    &pointer(""),
                    "an environment has either `radiance` or `image`",
                    "give one of the two",
                ));
            }
        }
    }
    Ok((lights, constant, image))
}

/// Refuses a second image of the environment.
fn one_image(
    first: Option<&EnvironmentSource>,
    pointer: &str,
    places: &Places,
) -> Result<(), Failure> {
    match first {
        None => Ok(()),
        Some(_) => Err(places.unsupported(
            pointer,
            "there are two images of the environment (a sky is one)",
            "use one `sky` or one `image`; constant environments may be added to it",
        )),
    }
}

/// The sky of a job's light, all its values in range.
fn clear_sky(light: &LightSpec, pointer: &str, places: &Places) -> Result<ClearSky, Failure> {
    let mut sky = ClearSky::default();
    if let LightSpec::Sky {
        to_sun,
        elevation,
        azimuth,
        turbidity,
        ground_albedo,
        intensity,
        sun,
        sun_angular_diameter,
    } = light
    {
        sky = ClearSky {
            to_sun: match (to_sun, elevation, azimuth) {
                (Some(to_sun), None, None) => {
                    let to_sun = DVec3::from_array(*to_sun);
                    // What has no direction is refused below.
                    to_sun.try_normalize().map_or_else(
                        || direction(to_sun.to_array()).unwrap_or_default(),
                        |_| to_sun,
                    )
                }
                (None, Some(degrees), azimuth) => {
                    if !(-90.0..=90.0).contains(degrees) {
                        return Err(places.invalid(
                            &format!("{pointer}/elevation"),
                            format!("the sun is {degrees} degrees above the horizon"),
                            "use an angle from -6 to 90 degrees",
                        ));
                    }
                    ClearSky::direction(*degrees, azimuth.unwrap_or(0.0))
                }
                _ => {
                    return Err(places.invalid(
                        pointer,
                        "it is not clear where the sky's sun stands",
                        "give either `to_sun`, or `elevation` and `azimuth`",
                    ));
                }
            },
            turbidity: turbidity.unwrap_or(sky.turbidity),
            ground_albedo: ground_albedo.map_or(sky.ground_albedo, Rgb::channels),
            intensity: intensity.unwrap_or(sky.intensity),
            sun: sun.unwrap_or(sky.sun),
            sun_angular_diameter: sun_angular_diameter.unwrap_or(sky.sun_angular_diameter),
        };
        if let Some(fault) = sky.fault() {
            let key = match fault.field {
                "to_sun" if elevation.is_some() => "elevation",
                field => field,
            };
            return Err(places.invalid(&format!("{pointer}/{key}"), fault.what, fault.remedy));
        }
    }
    Ok(sky)
}
