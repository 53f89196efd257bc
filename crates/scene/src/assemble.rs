//! Puts a scene together from files and from what a job says.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DVec3};
use pileus_math::Bounds3;
use pileus_media::emission::EmissionField;

use crate::camera::{Camera, Lens, Orbit, Projection};
use crate::error::{Error, Place};
use crate::gltf::{self, GltfCamera, GltfScene, GltfSurfaces};
use crate::light::environment::Environment;
use crate::light::punctual::Light;
use crate::light::sky::default_sky;
use crate::spec::Hint;
use crate::spec::volume_spec::VolumeSpec;
use crate::surface::{GlassRule, Surfaces};
use crate::volume::{DefaultScale, Volume, VolumeLoader, VolumeRequest, VolumeSource};

/// Everything an image is made from, immutable; nothing in it touches a file any more.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The camera, bound to the resolution of the full image.
    pub camera: Camera,
    /// The participating media; they may overlap.
    pub volumes: Vec<Volume>,
    /// Triangles with their materials; `None` if there are none.
    pub surfaces: Option<Arc<Surfaces>>,
    /// Lights without extent.
    pub lights: Vec<Light>,
    /// Light from all around.
    pub environment: Environment,
    /// What the files contain and the renderer leaves out, as sentences for people.
    pub not_modelled: Vec<String>,
}

/// What a scene is to be made of.
pub struct SceneRequest<'a> {
    /// A glTF file and its lumens per watt, see [`gltf::load`].
    pub gltf: Option<(PathBuf, f64)>,
    /// Volumes beside those of the glTF file; their file names are paths.
    pub volumes: Vec<VolumeSpec>,
    /// The place of a key of volume `i` (a JSON pointer relative to it), for messages.
    pub volume_place: &'a dyn Fn(usize, &str) -> Place,
    /// Which camera to use.
    pub camera: CameraRequest,
    /// The lens of that camera; `None`: a pinhole.
    pub lens: Option<LensRequest>,
    /// Lights beside those of the glTF file.
    pub lights: Vec<Light>,
    /// The environment; `None` if nothing was said about it.
    pub environment: Option<Environment>,
    /// Size of the full image in pixels; `None`: 640 pixels along the longer side in the aspect
    /// ratio of the glTF camera, 640 x 320 of a panorama, or 640 x 360.
    pub resolution: Option<[u32; 2]>,
    /// The extinction of a grid value of 1 in `volumes` that do not say.
    pub default_scale: DefaultScale,
    /// What surfaces of glass bound.
    pub glass_rule: GlassRule,
}

/// Which camera to use.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraRequest {
    /// The first camera of the glTF file that can be rendered, or one that frames volumes and
    /// surfaces.
    Auto {
        /// Vertical opening angle in degrees of a camera that frames volumes and surfaces.
        fov_y_degrees: f64,
        /// From where it frames them, whatever cameras there are.
        orbit: Option<Orbit>,
    },
    /// An orthographic camera that frames volumes and surfaces, whatever cameras there are.
    FramedOrthographic {
        /// Height of the view in scene units; `None`: all that there is fits.
        height: Option<f64>,
        /// From where it frames them.
        orbit: Option<Orbit>,
    },
    /// The camera of a glTF node.
    Node {
        /// Name of the node, or else of the camera; `node 7` for one without names.
        name: String,
        /// Where it is named.
        place: Place,
    },
    /// A camera in the world, see [`Camera::new`].
    LookAt {
        /// Position in scene units.
        position: DVec3,
        /// What it looks at.
        target: DVec3,
        /// What is up.
        up: DVec3,
        /// Perspective, orthographic or panorama.
        projection: Projection,
        /// Where it is described.
        place: Place,
    },
}

/// A lens for whichever camera is used, see [`Lens::new`].
#[derive(Debug, Clone, PartialEq)]
pub struct LensRequest {
    /// Diameter of the aperture in scene units.
    pub aperture: f64,
    /// Sides of the aperture; 0 for a disc.
    pub blades: u32,
    /// What is sharp.
    pub focus: Focus,
    /// Where the focus is described.
    pub place: Place,
}

/// What is sharp in a picture through a lens: a plane across the view axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Focus {
    /// At this distance along the view axis, scene units.
    Distance(f64),
    /// Through this point in world space.
    Point(DVec3),
}

impl LensRequest {
    /// The camera with this lens.
    fn fitted_to(&self, camera: Camera) -> Result<Camera, Error> {
        let distance = match self.focus {
            Focus::Distance(distance) => distance,
            Focus::Point(point) => camera.depth(point),
        };
        Lens::new(self.aperture, distance, self.blades)
            .and_then(|lens| camera.with_lens(lens))
            .map_err(|error| at(error, &self.place))
    }
}

/// A scene and how it came about.
#[derive(Debug)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// What was chosen without being asked for, as sentences for people.
    pub notes: Vec<String>,
    /// Which of these choices can be made otherwise, each once.
    pub hints: Vec<Hint>,
    /// What is likely not meant so, as sentences for people.
    pub warnings: Vec<String>,
    /// The files that the scene is made of: the glTF file, its buffers and images, volumes, tables.
    /// Those of the environment are read before and not among them.
    pub files: Vec<PathBuf>,
    /// Seconds spent in reading files.
    pub seconds_load: f64,
    /// Seconds spent in building render grids.
    pub seconds_build: f64,
}

impl Scene {
    /// Loads everything that a request names.
    pub fn load(request: SceneRequest<'_>) -> Result<Loaded, Error> {
        let start = Instant::now();
        let (file, surfaces) = match &request.gltf {
            Some((path, lumens_per_watt)) => {
                let rule = request.glass_rule;
                let (file, surfaces) = gltf::load_with_surfaces(path, *lumens_per_watt, rule)?;
                (Some(file), surfaces)
            }
            None => Default::default(),
        };
        let mut loader = VolumeLoader::default();
        loader.seconds_load = start.elapsed().as_secs_f64();
        let GltfSurfaces { surfaces, mut notes, mut warnings, .. } = surfaces;
        if let Some(file) = &file {
            notes.extend(file.notes.iter().cloned());
            warnings.extend(file.warnings.iter().cloned());
        }
        let volumes = load_volumes(&mut loader, &request, file.as_ref(), &mut notes)?;
        let files = crate::files::of_scene(&request, file.as_ref(), &loader);
        let nothing_seen = volumes.is_empty() && surfaces.is_none();
        let lost = file.as_ref().and_then(|file| lost_properties(file, nothing_seen));
        let (camera, note) = choose_camera(&request, file.as_ref(), &volumes, surfaces.as_ref())
            .map_err(|error| with_hint(error, lost.as_deref()))?;
        notes.extend(note);
        let camera = match &request.lens {
            Some(lens) => lens.fitted_to(camera)?,
            None => camera,
        };
        let mut hints = std::mem::take(&mut loader.hints);
        let cameras = file.as_ref().map_or(0, |file| file.cameras.len());
        if cameras > 1 && matches!(request.camera, CameraRequest::Auto { orbit: None, .. }) {
            hints.push(Hint::OtherCamera);
        }
        match lost {
            // Surfaces may be all there is.
            Some(hint) if !nothing_seen => notes.push(hint),
            Some(hint) => warnings.push(hint),
            None => {}
        }
        let mut lights = request.lights;
        let mut not_modelled = Vec::new();
        if let Some(file) = file {
            lights.extend(file.lights);
            not_modelled = file.not_modelled;
        }
        let environment = match request.environment {
            Some(environment) => environment,
            None if lights.is_empty()
                && !surfaces.as_ref().is_some_and(Surfaces::emits)
                && !volumes.iter().any(|volume| volume.emission.is_some()) =>
            {
                let (sun, environment) = default_sky()?;
                lights.push(sun);
                notes.push("no light given: the default sky, a sun and a blue gradient".into());
                environment
            }
            None => Environment::default(),
        };
        if nothing_seen {
            notes.push(
                "there is no volume and no surface: the picture shows the environment alone".into(),
            );
        }
        Ok(Loaded {
            scene: Scene {
                camera,
                volumes,
                surfaces: surfaces.map(Arc::new),
                lights,
                environment,
                not_modelled,
            },
            notes,
            hints,
            warnings,
            files,
            seconds_load: loader.seconds_load,
            seconds_build: loader.seconds_build,
        })
    }

    /// The volumes that emit light.
    pub fn emissive_volumes(&self) -> impl Iterator<Item = &Arc<EmissionField>> {
        self.volumes.iter().filter_map(|volume| volume.emission.as_ref())
    }

    /// The box in world space that holds all bounded volumes and surfaces; `None` if there are
    /// none.
    pub fn bounds(&self) -> Option<Bounds3> {
        let emissive = self.emissive_volumes().filter_map(|field| field.bounds_world());
        let volumes = self.volumes.iter().filter_map(|volume| volume.medium.bounds_world());
        let volumes = volumes.chain(emissive);
        let surfaces = self.surfaces.iter().map(|surfaces| surfaces.bounds());
        volumes.chain(surfaces).reduce(Bounds3::union)
    }
}

/// Balls of one size that together hold what is seen of the volumes and surfaces.
struct Balls {
    centres: Vec<DVec3>,
    radius: f64,
}

impl Balls {
    /// Cells of the volumes' bounds in which there is more than a trace of density or of light, and
    /// corners of the surfaces' bounds; `None` without anything bounded. What is smaller than a
    /// cell may be missed, which the margin of the frame forgives.
    fn of(volumes: &[Volume], surfaces: Option<&Surfaces>) -> Option<Self> {
        /// Cells along each axis of a volume's bounds.
        const SIDE: u32 = 40;
        /// Share of the densest cell below which a cell does not matter.
        const TRACE: f64 = 0.005;
        let mut balls = Self { centres: Vec::new(), radius: 0.0 };
        let mut add = |bounds: Bounds3, value: &dyn Fn(DVec3) -> f64| {
            let cell = bounds.size() / f64::from(SIDE);
            balls.radius = balls.radius.max(cell.length() * 0.5);
            let cells = (0..SIDE.pow(3)).map(|i| {
                let index = [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)].map(f64::from);
                bounds.low + cell * (DVec3::from_array(index) + 0.5)
            });
            let values: Vec<(DVec3, f64)> = cells.map(|p| (p, value(p))).collect();
            let largest = values.iter().fold(0.0f64, |a, (_, v)| a.max(*v));
            let seen = values.iter().filter(|(_, v)| *v > TRACE * largest);
            let before = balls.centres.len();
            balls.centres.extend(seen.map(|(p, _)| *p));
            if balls.centres.len() == before {
                balls.centres.extend(bounds.corners());
            }
        };
        for volume in volumes {
            let lit = volume.emission.as_ref().and_then(|e| Some((e, e.bounds_world()?)));
            if let Some((emission, bounds)) = lit {
                add(bounds, &|p| f64::from(emission.emission(p).max_element()));
            }
            // What only emits light is seen by that alone.
            let grid = volume.medium.grid();
            let clear = grid.is_some_and(|grid| grid.sigma_t_scale() == 0.0);
            if let Some(bounds) = volume.medium.bounds_world()
                && !(clear && lit.is_some())
            {
                add(bounds, &|p| grid.map_or(0.0, |grid| grid.sigma_t_at(p)));
            }
        }
        let instances = surfaces.into_iter().flat_map(Surfaces::instance_bounds);
        balls.centres.extend(instances.flat_map(Bounds3::corners));
        (!balls.centres.is_empty()).then_some(balls)
    }
}

fn load_volumes(
    loader: &mut VolumeLoader,
    request: &SceneRequest<'_>,
    file: Option<&GltfScene>,
    notes: &mut Vec<String>,
) -> Result<Vec<Volume>, Error> {
    let mut volumes = Vec::new();
    for volume in file.iter().flat_map(|file| &file.volumes) {
        // The keys of extras do not mirror those of a specification: one place serves for all.
        volumes.push(loader.load(&VolumeRequest {
            spec: &volume.spec,
            to_world: volume.to_world,
            fallback_name: &volume.node,
            place: &|_| volume.place.clone(),
            default_scale: DefaultScale::One,
        })?);
    }
    for (i, spec) in request.volumes.iter().enumerate() {
        let volume = loader.load(&VolumeRequest {
            spec,
            to_world: DAffine3::IDENTITY,
            fallback_name: "",
            place: &|key| (request.volume_place)(i, key),
            default_scale: request.default_scale,
        })?;
        let chosen = spec.density.as_ref().and_then(|d| d.scale).is_none();
        if let (VolumeSource::Vdb { density_scale, .. }, true, DefaultScale::Cloud) =
            (&volume.source, chosen, request.default_scale)
        {
            notes.push(format!(
                "density scale of `{}`: {density_scale:.4} per scene unit, chosen so that it looks like a cloud",
                volume.name
            ));
        }
        volumes.push(volume);
    }
    notes.append(&mut loader.notes);
    for volume in &volumes {
        if matches!(volume.source, VolumeSource::Vdb { .. })
            && volume.medium.bounds_world().is_none()
            && volume.emission.is_none()
        {
            notes.push(format!("volume `{}` is empty: no density anywhere", volume.name));
        }
        if volume.emission.as_ref().is_some_and(|emission| emission.bounds_world().is_none()) {
            notes.push(format!(
                "volume `{}` emits no light: its emission is zero everywhere",
                volume.name
            ));
        }
    }
    Ok(volumes)
}

fn choose_camera(
    request: &SceneRequest<'_>,
    file: Option<&GltfScene>,
    volumes: &[Volume],
    surfaces: Option<&Surfaces>,
) -> Result<(Camera, Option<String>), Error> {
    let cameras = file.map(|file| file.cameras.as_slice()).unwrap_or_default();
    let resolution = request.resolution.unwrap_or([640, 360]);
    match &request.camera {
        CameraRequest::LookAt { position, target, up, projection, place } => {
            let resolution = match (request.resolution, projection) {
                (None, Projection::Panorama) => [640, 320],
                _ => resolution,
            };
            Camera::new(*position, *target, *up, *projection, resolution)
                .map(|camera| (camera, None))
                .map_err(|error| at(error, place))
        }
        CameraRequest::Node { name, place } => {
            let find = |names: &dyn Fn(&GltfCamera) -> bool| cameras.iter().find(|c| names(c));
            let found = find(&|camera| camera.node == *name)
                .or_else(|| find(&|camera| camera.name == *name))
                .or_else(|| find(&|camera| label(camera) == *name));
            let Some(camera) = found.filter(|_| !name.is_empty()) else {
                let names: Vec<String> = cameras.iter().map(label).collect();
                let remedy = match (file, names.is_empty()) {
                    (None, _) => "there is no glTF scene that could have one".to_owned(),
                    (_, true) => {
                        "the scene has no cameras: place one by where it stands and what it looks at".to_owned()
                    }
                    _ => format!("the scene's cameras are {}", gltf::list_names(&names)),
                };
                return Err(Error::missing(
                    place.clone(),
                    format!("there is no camera node `{name}`"),
                    remedy,
                ));
            };
            gltf_camera(camera, request, place).map(|camera| (camera, None))
        }
        CameraRequest::Auto { fov_y_degrees, orbit } => {
            if let (false, Some((path, _)), None) = (cameras.is_empty(), &request.gltf, orbit) {
                return first_camera(cameras, request, path)
                    .map(|(camera, note)| (camera, Some(note)));
            }
            let Balls { centres, radius } = balls_to_frame(request, volumes, surfaces)?;
            let camera =
                Camera::framing_balls(centres, radius, *orbit, *fov_y_degrees, resolution)?;
            let framed = what_is_framed(volumes, surfaces);
            Ok((camera, Some(format!("no camera given: {framed}"))))
        }
        CameraRequest::FramedOrthographic { height, orbit } => {
            let Balls { centres, radius } = balls_to_frame(request, volumes, surfaces)?;
            let camera =
                Camera::framing_balls_orthographic(centres, radius, *orbit, *height, resolution)?;
            let framed = what_is_framed(volumes, surfaces);
            Ok((camera, Some(format!("no place given for the camera: {framed}"))))
        }
    }
}

fn balls_to_frame(
    request: &SceneRequest<'_>,
    volumes: &[Volume],
    surfaces: Option<&Surfaces>,
) -> Result<Balls, Error> {
    if let Some(balls) = Balls::of(volumes, surfaces) {
        return Ok(balls);
    }
    if let Some(error) = empty_volume(volumes) {
        return Err(error);
    }
    let place = request.gltf.as_ref().map(|(path, _)| Place::file(path));
    Err(Error::missing(
        place.unwrap_or_default(),
        "there is no camera, and no surface and no volume with an end that could be framed",
        "place a camera: where it stands and what it looks at",
    ))
}

/// What a camera shows that was not placed, for people.
fn what_is_framed(volumes: &[Volume], surfaces: Option<&Surfaces>) -> &'static str {
    match (volumes.is_empty(), surfaces.is_some()) {
        (_, false) => "the volumes are framed",
        (true, true) => "the surfaces are framed",
        (false, true) => "volumes and surfaces are framed",
    }
}

/// What a camera of a glTF file is called in messages.
fn label(camera: &GltfCamera) -> String {
    let names = [&camera.node, &camera.name].into_iter().find(|name| !name.is_empty());
    names.map_or_else(|| format!("node {}", camera.index), String::clone)
}

/// The first camera that can be rendered, and a note about the choice.
///
/// Nothing in a glTF file marks the active camera, and some exporters list nodes by name.
fn first_camera(
    cameras: &[GltfCamera],
    request: &SceneRequest<'_>,
    path: &Path,
) -> Result<(Camera, String), Error> {
    let mut passed = Vec::new();
    let mut first_error = None;
    for camera in cameras {
        let name = label(camera);
        let place = Place::part(path, format!("camera `{name}`"));
        let found = match gltf_camera(camera, request, &place) {
            Ok(found) => found,
            Err(error) => {
                passed.push(name);
                first_error.get_or_insert(error);
                continue;
            }
        };
        let mut note = format!("camera `{name}` of the scene");
        if cameras.len() > 1 {
            let others: Vec<String> =
                cameras.iter().map(label).filter(|other| *other != name).collect();
            note = format!(
                "camera `{name}` is taken, the first of {} in the scene that can be rendered \
                 (there are also {})",
                cameras.len(),
                gltf::list_names(&others)
            );
        }
        if let Some(error) = &first_error {
            let names = gltf::list_names(&passed);
            note = format!("{note}; passed over: {names} ({})", error.what());
        }
        return Ok((found, note));
    }
    let error = first_error.unwrap_or_else(|| {
        Error::missing(Place::file(path), "the scene has no camera", "add a camera")
    });
    if cameras.len() == 1 {
        return Err(error);
    }
    Err(Error::unsupported(
        Place::file(path),
        format!("none of the scene's {} cameras can be rendered: {}", cameras.len(), error.what()),
        "use a perspective or an orthographic camera",
    ))
}

/// The error that a volume without any density is where nothing else can be framed.
fn empty_volume(volumes: &[Volume]) -> Option<Error> {
    volumes.iter().find_map(|volume| match &volume.source {
        VolumeSource::Vdb { path, grid, .. } => Some(Error::invalid(
            Place::part(path, format!("volume `{}`", volume.name)),
            format!(
                "grid `{grid}` is empty: it has no value above 0, so that there is nothing to frame"
            ),
            "take a frame in which there is density, name another grid, or give a camera",
        )),
        VolumeSource::Homogeneous => None,
    })
}

/// The hint for a file by Blender that has no volumes: by default the exporter leaves out the
/// custom properties that say what is a volume.
fn lost_properties(file: &GltfScene, nothing_seen: bool) -> Option<String> {
    let by_blender = file.generator.as_ref().is_some_and(|name| name.contains("Blender"));
    (by_blender && file.volumes.is_empty() && (nothing_seen || file.has_empties)).then(|| {
        "no node of the scene says that it is a volume: Blender exports the custom properties that do \
         (`pileus_vdb`) only with \"Include: Custom Properties\" ticked"
            .to_owned()
    })
}

/// Adds a hint to the remedy of an error.
fn with_hint(mut error: Error, hint: Option<&str>) -> Error {
    if let (Some(hint), Error::Missing { remedy, .. }) = (hint, &mut error) {
        *remedy = format!("{remedy}; {hint}");
    }
    error
}

fn gltf_camera(
    camera: &GltfCamera,
    request: &SceneRequest<'_>,
    place: &Place,
) -> Result<Camera, Error> {
    let projection = match (camera.fov_y_degrees, camera.magnification) {
        (Some(fov_y_degrees), _) => Projection::Perspective { fov_y_degrees },
        (None, Some([xmag, ymag])) => {
            if !(xmag > 0.0 && ymag > 0.0) {
                return Err(Error::invalid(
                    place.clone(),
                    format!(
                        "camera `{}` has an xmag of {xmag} and a ymag of {ymag}",
                        label(camera)
                    ),
                    "both have to be above 0: correct the camera and export again",
                ));
            }
            Projection::Orthographic { height: 2.0 * ymag }
        }
        (None, None) => {
            return Err(Error::unsupported(
                place.clone(),
                format!("camera `{}` is neither perspective nor orthographic", label(camera)),
                "use a camera of one of these types",
            ));
        }
    };
    let resolution = request.resolution.unwrap_or_else(|| {
        let aspect = camera.aspect_ratio.unwrap_or(16.0 / 9.0);
        let short = |long: f64| (long.round() as u32).max(1);
        if aspect >= 1.0 { [640, short(640.0 / aspect)] } else { [short(640.0 * aspect), 640] }
    });
    Camera::from_transform(&camera.to_world, projection, resolution)
        .map_err(|error| at(error, place))
}

fn at(error: Error, place: &Place) -> Error {
    match error {
        Error::Invalid { what, remedy, .. } => Error::invalid(place.clone(), what, remedy),
        other => other,
    }
}
