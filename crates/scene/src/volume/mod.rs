//! From what a user wrote about a volume to a medium placed in the world.

mod emission;
mod flakes;
mod law;
mod phase;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use pileus_math::Bounds3;
use pileus_media::phase::CosineGrid;
use pileus_media::{
    Albedo, BuildReport, Clamped, ColorGrid, EmissionField, Interpolation, Medium, Phase,
    VoxelGrid, VoxelGridOptions,
};
use pileus_vdb::{GridClass, GridInfo, MetaValue, Tree, ValueType, Values, VdbFile};

use emission::EmissionParts;
use flakes::FlakeGrids;
use law::law;

use crate::error::{Error, Place};
use crate::spec::Hint;
use crate::spec::by_name::ByName;
use crate::spec::phase_spec::{CosineSpec, PhaseSpec};
use crate::spec::volume_spec::{
    AlbedoSpec, DEFAULT_ALBEDO, DensitySpec, EmissionSpec, HomogeneousSpec, RampNodeSpec, Rgb,
    TransformSpec, UpAxis, VolumeSpec,
};
use crate::uri::with_frame;

/// A volume of the scene: a medium in world space and where it came from.
#[derive(Debug, Clone)]
pub struct Volume {
    /// The user's name for it, or that of its file.
    pub name: String,
    /// The medium, in world space.
    pub medium: Arc<Medium>,
    /// The light that it gives off, in world space.
    pub emission: Option<Arc<EmissionField>>,
    /// Where its values came from.
    pub source: VolumeSource,
}

/// Where the values of a volume came from.
#[derive(Debug, Clone)]
pub enum VolumeSource {
    /// A grid of an OpenVDB file.
    Vdb {
        /// The file.
        path: PathBuf,
        /// The grid as it is addressed: `density` or `density[1]`.
        grid: String,
        /// Extinction per scene unit where the grid is 1, before the channels' `extinction`.
        density_scale: f64,
        /// The light and the albedo of a fire that nobody described, see [`DefaultScale::Cloud`].
        fire: Option<Box<(EmissionSpec, f64)>>,
        /// What the render grid takes; shared by all volumes made of the same grid.
        build: BuildReport,
    },
    /// A formula.
    Homogeneous,
}

/// One volume to load: what the user wrote, where it goes and where it was written.
pub struct VolumeRequest<'a> {
    /// What the user wrote; `vdb` is a path by now.
    pub spec: &'a VolumeSpec,
    /// Applied last: the world transform of the glTF node, or the identity.
    pub to_world: DAffine3,
    /// What to call it if the specification has no name.
    pub fallback_name: &'a str,
    /// The place of a key of the specification (a JSON pointer relative to it), for messages.
    pub place: &'a dyn Fn(&str) -> Place,
    /// The extinction of a grid value of 1 if the specification does not say.
    pub default_scale: DefaultScale,
}

/// The extinction of a grid value of 1 that nobody specified.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefaultScale {
    /// One per scene unit.
    One,
    /// What makes the volume look like a cloud, see [`automatic_scale`]; or like a fire if nothing
    /// is said about light and the file has a grid `flame`, `flames`, `heat` or `temperature`.
    Cloud,
}

/// What a render grid is made of: file, grid, channel of a vector grid, and whether values are
/// those of the nearest voxel.
type GridKey = (PathBuf, usize, Option<usize>, bool);

/// Loads volumes; remembers files and grids, so that volumes made of the same grid share it.
#[derive(Default)]
pub struct VolumeLoader {
    files: HashMap<PathBuf, Arc<VdbFile>>,
    grids: HashMap<GridKey, Arc<VoxelGrid>>,
    /// Albedos by file, grid, and grid of the density.
    albedos: HashMap<(PathBuf, usize, String), Arc<ColorGrid>>,
    /// What was chosen without being asked for, as sentences for people.
    pub notes: Vec<String>,
    /// Which of these choices can be made otherwise.
    pub hints: Vec<Hint>,
    /// Seconds spent in reading files so far.
    pub seconds_load: f64,
    /// Seconds spent in building render grids so far.
    pub seconds_build: f64,
}

impl VolumeLoader {
    /// Loads one volume.
    pub fn load(&mut self, request: &VolumeRequest<'_>) -> Result<Volume, Error> {
        let spec = request.spec;
        let place = request.place;
        let extinction = channels(
            spec.extinction.unwrap_or(Rgb::Grey(1.0)),
            0.0..=1e30,
            &|| place("/extinction"),
            "extinction",
        )?;
        let placement = placement(spec, &request.to_world, place)?;
        match (&spec.vdb, &spec.homogeneous) {
            (Some(vdb), None) => self.load_grid(request, vdb, extinction, placement),
            (None, Some(homogeneous)) => {
                load_homogeneous(request, homogeneous, extinction, &placement)
            }
            (None, None) => Err(Error::invalid(
                place(""),
                "the volume has neither `vdb` nor `homogeneous`",
                "name an OpenVDB file with `vdb`",
            )),
            (Some(_), Some(_)) => Err(Error::invalid(
                place("/homogeneous"),
                "the volume has both `vdb` and `homogeneous`",
                "write two volumes: media may overlap",
            )),
        }
    }

    fn load_grid(
        &mut self,
        request: &VolumeRequest<'_>,
        vdb: &str,
        extinction: [f64; 3],
        placement: DAffine3,
    ) -> Result<Volume, Error> {
        let (spec, place) = (request.spec, request.place);
        let ByName(interpolation) = spec.interpolation();
        let path = PathBuf::from(with_frame(vdb, spec.frame, &place("/vdb"))?);
        if let Some(frame) = spec.frame
            && path == Path::new(vdb)
        {
            self.note(format!(
                "volume `{}`: frame {frame} stands nowhere in `{}`, which has no `#`",
                name(request),
                path.display()
            ));
        }
        let file = self.open(&path, &|| place("/vdb"))?;
        let vdb_error = |key: &str, source| Error::vdb(place(key), source);
        let density = spec.density.clone().unwrap_or_default();
        let index = density_grid(&file, &path, &density, place)?;
        let info = grid_info(&file, index, &path)?;
        let index_to_world =
            placement * affine(info.transform.matrix().map_err(|e| vdb_error("/vdb", e))?);
        let grid = self.grid(&file, &path, index, interpolation, &|| place("/vdb"))?;
        self.note_grid(&file, &path, info, &density);
        self.note_up_axis(request, info, &grid, &placement);
        let fire = match (&spec.emission, request.default_scale) {
            (None, DefaultScale::Cloud) => {
                self.fire(&file, &path, interpolation, &placement, place)?
            }
            _ => None,
        };
        let albedo = match (&fire, &spec.albedo) {
            (Some(_), None) => constant_albedo(Rgb::Grey(SOOT_ALBEDO), place).map(Albedo::Constant),
            _ => self.albedo(request, &file, &path, info),
        }?;
        let phase = self.phase(request, &file, &path, info, &placement)?;
        let law = law(spec, place)?;
        if phase.flakes().is_some() && matches!(spec.emission, Some(EmissionSpec::Blackbody { .. }))
        {
            return Err(Error::unsupported(
                place("/emission"),
                "black bodies made of flakes would glow by direction, which is not modelled",
                "give the fire a volume of its own: media may overlap",
            ));
        }
        let scale = match density.scale {
            Some(scale) => scale,
            None => match request.default_scale {
                DefaultScale::One => 1.0,
                DefaultScale::Cloud => {
                    let thin = if fire.is_some() { SOOT_SHARE } else { 1.0 };
                    let scale = automatic_scale(&grid, &index_to_world);
                    scale.map_err(|source| Error::medium(place("/density"), source))? * thin
                }
            },
        };
        if !(scale >= 0.0 && scale.is_finite()) {
            return Err(Error::invalid(
                place("/density/scale"),
                format!("the density scale is {scale}"),
                "use a finite number of at least 0",
            ));
        }
        let build = grid.report().clone();
        let sigma_t = extinction.map(|e| (e * scale) as f32);
        let medium = Medium::from_grid(grid.clone(), index_to_world, sigma_t, albedo, phase)
            .map_err(|source| Error::medium(place(""), source))?
            .with_transmittance_function(law);
        let emission = match spec.emission.as_ref().or(fire.as_ref()) {
            None => None,
            Some(emission) => {
                let parts = EmissionParts {
                    emission,
                    place,
                    file: &file,
                    path: &path,
                    interpolation,
                    placement,
                    medium: &medium,
                    density: grid,
                    medium_to_world: index_to_world,
                    sigma_t,
                };
                Some(Arc::new(self.emission(&parts)?))
            }
        };
        Ok(Volume {
            name: name(request),
            medium: Arc::new(medium),
            emission,
            source: VolumeSource::Vdb {
                grid: info.full_name(),
                path,
                density_scale: scale,
                fire: fire.map(|fire| Box::new((fire, SOOT_ALBEDO))),
                build,
            },
        })
    }

    /// Adds a note once, however many volumes are made alike.
    fn note(&mut self, note: String) {
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    /// Says which of several grids of one name was taken.
    fn note_grid(&mut self, file: &VdbFile, path: &Path, taken: &GridInfo, asked: &DensitySpec) {
        let alike: Vec<&GridInfo> =
            file.grids().iter().filter(|info| info.name == taken.name).collect();
        if alike.len() < 2 || asked.grid.as_ref().is_some_and(|name| *name != taken.name) {
            return;
        }
        let described: Vec<String> = alike
            .iter()
            .take(8)
            .map(|info| match box_by_metadata(info) {
                Some(Bounds3 { low, high }) => {
                    format!("`{}` from {low:.3} to {high:.3}", info.full_name())
                }
                None => format!("`{}`", info.full_name()),
            })
            .collect();
        self.note(format!(
            "{}: {} grids are named `{}`, of which `{}` is taken: {}",
            path.display(),
            alike.len(),
            taken.name,
            taken.full_name(),
            described.join(", ")
        ));
        self.hint(Hint::OtherGrid);
    }

    fn hint(&mut self, hint: Hint) {
        if !self.hints.contains(&hint) {
            self.hints.push(hint);
        }
    }

    /// Hints at files in which z is up, as in Blender: their plumes lie on their side.
    fn note_up_axis(
        &mut self,
        request: &VolumeRequest<'_>,
        info: &GridInfo,
        grid: &VoxelGrid,
        placement: &DAffine3,
    ) {
        if request.spec.up_axis.is_some() {
            return;
        }
        let (Some(bounds), Ok(matrix)) = (grid.bounds_index(), info.transform.matrix()) else {
            return;
        };
        let DVec3 { x, y, z } = Bounds3::moved(bounds, &affine(matrix)).size();
        // Clouds are wide along any axis; what is tall is about as wide as deep.
        let tall = z > 1.1 * x.max(y) && x.max(y) < 1.6 * x.min(y);
        let lies =
            (placement.matrix3 * DVec3::Z).try_normalize().is_some_and(|up| up.y.abs() < 0.5);
        if tall && lies {
            self.note(format!(
                "volume `{}`: the box of `{}` is tallest along z ({x:.3} x {y:.3} x {z:.3}); if it lies \
                 on its side, z is up in the file",
                name(request),
                info.full_name()
            ));
            self.hint(Hint::ZIsUp);
        }
    }

    /// The light of a file that looks like a fire and about whose light nothing was said.
    fn fire(
        &mut self,
        file: &VdbFile,
        path: &Path,
        interpolation: Interpolation,
        placement: &DAffine3,
        place: &dyn Fn(&str) -> Place,
    ) -> Result<Option<EmissionSpec>, Error> {
        let numbers = |info: &GridInfo| {
            matches!(info.value_type, ValueType::Float | ValueType::Double | ValueType::Half)
                && info.class != GridClass::LevelSet
        };
        let found = FIRES.iter().find_map(|name| {
            let grids = file.grids();
            grids.iter().position(|info| numbers(info) && info.name.eq_ignore_ascii_case(name))
        });
        let Some(index) = found else { return Ok(None) };
        let info = grid_info(file, index, path)?;
        let grid = self.grid(file, path, index, interpolation, &|| place("/emission"))?;
        let (_, hottest) = grid.range();
        let (hottest, background) = (f64::from(hottest), f64::from(grid.background()));
        // Values far above 1 are kelvin; what is colder than the first glow is no fire.
        let coldest =
            if hottest > KELVIN { FIRST_GLOW.max(background) } else { background.max(0.0) };
        if !(hottest > coldest) {
            return Ok(None);
        }
        let error = |source| Error::vdb(place("/emission"), source);
        let to_world = *placement * affine(info.transform.matrix().map_err(error)?);
        let depth = median_depth(&grid, &to_world)
            .map_err(|source| Error::medium(place("/emission"), source))?;
        let scale = FIRE_RADIANCE * hottest / depth;
        let scale = if scale.is_finite() && scale < 1e30 { scale } else { 1.0 };
        let ramp = FIRE_RAMP.map(|(share, color)| RampNodeSpec {
            value: coldest + (hottest - coldest) * share,
            color: Rgb::Channels(color),
        });
        self.note(format!(
            "{}: grid `{}` burns, since nothing was said about light: colours of fire for values from \
             {coldest:.4} to {hottest:.4}, scale {scale:.4}, in soot of albedo {SOOT_ALBEDO} (a job \
             with `emission` says otherwise)",
            path.display(),
            info.full_name()
        ));
        let grid = info.full_name();
        Ok(Some(EmissionSpec::Grid {
            grid,
            color: None,
            scale: Some(scale),
            ramp: Some(ramp.into()),
        }))
    }

    /// The OpenVDB files that were read so far, in no order.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.files.keys().map(PathBuf::as_path)
    }

    fn open(&mut self, path: &Path, place: &dyn Fn() -> Place) -> Result<Arc<VdbFile>, Error> {
        if let Some(file) = self.files.get(path) {
            return Ok(file.clone());
        }
        let start = Instant::now();
        let file = VdbFile::open(path).map_err(|source| Error::vdb(place(), source))?;
        let file = Arc::new(file);
        self.files.insert(path.to_owned(), file.clone());
        self.seconds_load += start.elapsed().as_secs_f64();
        Ok(file)
    }

    pub(crate) fn grid(
        &mut self,
        file: &VdbFile,
        path: &Path,
        index: usize,
        interpolation: Interpolation,
        place: &dyn Fn() -> Place,
    ) -> Result<Arc<VoxelGrid>, Error> {
        let key = (path.to_owned(), index, None, interpolation == Interpolation::Nearest);
        if let Some(grid) = self.grids.get(&key) {
            return Ok(grid.clone());
        }
        let start = Instant::now();
        let tree = file
            .read(index)
            .and_then(pileus_vdb::Grid::to_float)
            .map_err(|source| Error::vdb(place(), source))?;
        self.seconds_load += start.elapsed().as_secs_f64();
        self.render_grid(key, &tree, interpolation, place)
    }

    /// The channels of a vector grid.
    pub(crate) fn channels(
        &mut self,
        file: &VdbFile,
        path: &Path,
        index: usize,
        interpolation: Interpolation,
        place: &dyn Fn() -> Place,
    ) -> Result<[Arc<VoxelGrid>; 3], Error> {
        let keys = [0, 1, 2].map(|channel| {
            (path.to_owned(), index, Some(channel), interpolation == Interpolation::Nearest)
        });
        if let [Some(r), Some(g), Some(b)] = [0, 1, 2].map(|i| self.grids.get(&keys[i])) {
            return Ok([r.clone(), g.clone(), b.clone()]);
        }
        let start = Instant::now();
        let grid = file.read(index).map_err(|source| Error::vdb(place(), source))?;
        let channel = |i: usize| match &grid.values {
            Values::Vec3f(tree) => Some(tree.clone().map(|v| v[i])),
            Values::Vec3d(tree) => Some(tree.clone().map(|v| v[i] as f32)),
            Values::Vec3i(tree) => Some(tree.clone().map(|v| v[i] as f32)),
            _ => None,
        };
        let [Some(r), Some(g), Some(b)] = [channel(0), channel(1), channel(2)] else {
            return Err(Error::invalid(
                place(),
                format!("{}: the grid holds numbers, not vectors", path.display()),
                "write the file again",
            ));
        };
        self.seconds_load += start.elapsed().as_secs_f64();
        let [at_r, at_g, at_b] = keys;
        Ok([
            self.render_grid(at_r, &r, interpolation, place)?,
            self.render_grid(at_g, &g, interpolation, place)?,
            self.render_grid(at_b, &b, interpolation, place)?,
        ])
    }

    fn render_grid(
        &mut self,
        key: GridKey,
        tree: &Tree<f32>,
        interpolation: Interpolation,
        place: &dyn Fn() -> Place,
    ) -> Result<Arc<VoxelGrid>, Error> {
        let start = Instant::now();
        let grid = VoxelGrid::from_tree(tree, &VoxelGridOptions { interpolation })
            .map_err(|source| Error::medium(place(), source))?;
        self.seconds_build += start.elapsed().as_secs_f64();
        let report = grid.report();
        for (count, what) in
            [(report.replaced_non_finite, "not finite"), (report.replaced_negative, "negative")]
        {
            if count > 0 {
                tracing::warn!("{}: {count} values are {what} and count as 0", key.0.display());
            }
        }
        let grid = Arc::new(grid);
        self.grids.insert(key, grid.clone());
        Ok(grid)
    }

    fn albedo(
        &mut self,
        request: &VolumeRequest<'_>,
        file: &VdbFile,
        path: &Path,
        density: &GridInfo,
    ) -> Result<Albedo, Error> {
        let place = request.place;
        let name = match &request.spec.albedo {
            Some(AlbedoSpec::Grid(name)) => name,
            Some(AlbedoSpec::Constant(rgb)) => {
                return constant_albedo(*rgb, place).map(Albedo::Constant);
            }
            None => return constant_albedo(Rgb::Grey(DEFAULT_ALBEDO), place).map(Albedo::Constant),
        };
        let vdb_error = |source| Error::vdb(place("/albedo/grid"), source);
        let index = file.find(name).map_err(vdb_error)?;
        let info = grid_info(file, index, path)?;
        let key = (path.to_owned(), index, density.full_name());
        if let Some(grid) = self.albedos.get(&key) {
            return Ok(Albedo::Grid(grid.clone()));
        }
        let start = Instant::now();
        let values = file.read(index).map_err(vdb_error)?;
        self.seconds_load += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let to_own = between(density, info, &|| place("/albedo/grid"))?;
        let grid = match &values.values {
            Values::Vec3f(tree) => ColorGrid::from_vec3_tree(tree, to_own),
            _ => ColorGrid::from_float_tree(&values.to_float().map_err(vdb_error)?, to_own),
        };
        let grid = grid.map_err(|source| Error::medium(place("/albedo/grid"), source))?;
        warn_of_clamped(&grid.clamped(), path, info, "albedo", (0.0, 1.0));
        if let Some(albedo) = grid.constant() {
            tracing::warn!(
                "{}: grid `{}` holds nothing but its background: the albedo is {albedo} everywhere",
                path.display(),
                info.full_name()
            );
        }
        self.seconds_build += start.elapsed().as_secs_f64();
        let grid = Arc::new(grid);
        self.albedos.insert(key, grid.clone());
        Ok(Albedo::Grid(grid))
    }

    fn phase(
        &mut self,
        request: &VolumeRequest<'_>,
        file: &VdbFile,
        path: &Path,
        density: &GridInfo,
        placement: &DAffine3,
    ) -> Result<Phase, Error> {
        let place = request.place;
        let spec = request.spec.phase.as_ref();
        let Some(PhaseSpec::HenyeyGreenstein { g: CosineSpec::Grid(by_grid) }) = spec else {
            let mut grids = PhaseGrids { loader: self, place, file, path, density };
            return phase::phase(spec, placement, place, Some(&mut grids));
        };
        let at = || place("/phase/g/grid");
        let vdb_error = |source| Error::vdb(at(), source);
        let index = file.find(&by_grid.grid).map_err(vdb_error)?;
        let info = grid_info(file, index, path)?;
        let to_own = between(density, info, &at)?;
        let start = Instant::now();
        let tree = file.read(index).and_then(pileus_vdb::Grid::to_float).map_err(vdb_error)?;
        self.seconds_load += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let number = |value: Option<f64>, default| value.unwrap_or(default) as f32;
        let (scale, offset) = (number(by_grid.scale, 1.0), number(by_grid.offset, 0.0));
        let grid = CosineGrid::new(&tree, scale, offset, to_own)
            .map_err(|source| Error::medium(place("/phase/g"), source))?;
        warn_of_clamped(&grid.clamped(), path, info, "mean cosine", (-1.0, 1.0));
        self.seconds_build += start.elapsed().as_secs_f64();
        Ok(Phase::ByGrid(Arc::new(grid)))
    }
}

/// Says what of a grid counts as something else.
pub(crate) fn warn_of_clamped(
    clamped: &Clamped,
    path: &Path,
    grid: &GridInfo,
    what: &str,
    (low, high): (f32, f32),
) {
    let Clamped { non_finite, below, above, largest } = *clamped;
    let of = format!("{}: grid `{}`, {what}", path.display(), grid.full_name());
    if non_finite > 0 {
        tracing::warn!("{of}: {non_finite} values are not finite and count as 0");
    }
    if below > 0 {
        tracing::warn!("{of}: {below} values are below {low} and count as {low}");
    }
    if above > 0 {
        let bytes = if low == 0.0 && largest > 2.0 && largest <= 255.0 {
            "; if they are bytes, divide them by 255"
        } else {
            ""
        };
        tracing::warn!(
            "{of}: {above} values are above {high} and count as {high}, the largest is {largest}{bytes}"
        );
    }
}

/// Grids of a phase function, from the file of its density.
struct PhaseGrids<'a> {
    loader: &'a mut VolumeLoader,
    place: &'a dyn Fn(&str) -> Place,
    file: &'a VdbFile,
    path: &'a Path,
    density: &'a GridInfo,
}

impl PhaseGrids<'_> {
    fn read(
        &mut self,
        name: &str,
        key: &str,
    ) -> Result<(pileus_vdb::Grid, DAffine3, Place), Error> {
        let at = || (self.place)(&format!("{}/{key}", flakes::POINTER));
        let vdb_error = |source| Error::vdb(at(), source);
        let index = self.file.find(name).map_err(vdb_error)?;
        let info = grid_info(self.file, index, self.path)?;
        let map = between(self.density, info, &at)?;
        let start = Instant::now();
        let grid = self.file.read(index).map_err(vdb_error)?;
        self.loader.seconds_load += start.elapsed().as_secs_f64();
        Ok((grid, map, at()))
    }
}

impl FlakeGrids for PhaseGrids<'_> {
    fn vectors(&mut self, name: &str, key: &str) -> Result<(Tree<[f32; 3]>, DAffine3), Error> {
        let (grid, map, place) = self.read(name, key)?;
        let info = grid.info.clone();
        let tree = match grid.values {
            Values::Vec3f(tree) => tree,
            Values::Vec3d(tree) => tree.map(|v| v.map(|c| c as f32)),
            _ => {
                return Err(Error::invalid(
                    place,
                    format!("grid {} holds no vectors", describe(&grid.info)),
                    "name a grid of type vec3s or vec3d",
                ));
            }
        };
        let all = (f32::NEG_INFINITY, f32::INFINITY);
        warn_of_clamped(&Clamped::vectors(&tree, all), self.path, &info, "flakes", all);
        Ok((tree, map))
    }

    fn numbers(&mut self, name: &str, key: &str) -> Result<(Tree<f32>, DAffine3), Error> {
        let (grid, map, place) = self.read(name, key)?;
        let info = grid.info.clone();
        let tree = grid.to_float().map_err(|source| Error::vdb(place, source))?;
        let range = (0.0, 1.0);
        warn_of_clamped(&Clamped::numbers(&tree, range), self.path, &info, "roughness", range);
        Ok((tree, map))
    }
}

/// From the index space of the density to that of another grid of the same file; both share the
/// world transform.
fn between(
    density: &GridInfo,
    other: &GridInfo,
    place: &dyn Fn() -> Place,
) -> Result<DAffine3, Error> {
    let matrix = |info: &GridInfo| {
        info.transform.matrix().map(affine).map_err(|source| Error::vdb(place(), source))
    };
    let map = matrix(other)?.inverse() * matrix(density)?;
    if map.is_finite() {
        return Ok(map);
    }
    Err(Error::invalid(
        place(),
        format!("the transform of grid `{}` is singular", other.full_name()),
        "write the grid again",
    ))
}

fn load_homogeneous(
    request: &VolumeRequest<'_>,
    homogeneous: &HomogeneousSpec,
    extinction: [f64; 3],
    placement: &DAffine3,
) -> Result<Volume, Error> {
    let (spec, place) = (request.spec, request.place);
    for (given, key) in [
        (spec.density.is_some(), "/density"),
        (spec.interpolation.is_some(), "/interpolation"),
        (spec.frame.is_some(), "/frame"),
        (spec.emission.is_some(), "/emission"),
    ] {
        if given {
            return Err(Error::invalid(
                place(key),
                "this key belongs to volumes with a grid",
                "remove it, or replace `homogeneous` by `vdb`; light and fog can be two volumes that overlap",
            ));
        }
    }
    let albedo = match &spec.albedo {
        Some(AlbedoSpec::Grid(_)) => {
            return Err(Error::invalid(
                place("/albedo"),
                "a homogeneous volume has no grids",
                "give the albedo as numbers",
            ));
        }
        Some(AlbedoSpec::Constant(rgb)) => constant_albedo(*rgb, place)?,
        None => constant_albedo(Rgb::Grey(DEFAULT_ALBEDO), place)?,
    };
    let phase = phase::phase(spec.phase.as_ref(), placement, place, None)?;
    let law = law(spec, place)?;
    let bounds = homogeneous.bounds.map(|bounds| bounds.map(DVec3::from_array));
    let bounds = match bounds {
        None => None,
        Some([low, high]) => {
            Some(move_box(Bounds3::new(low, high), placement).ok_or_else(|| {
                Error::unsupported(
                    place("/homogeneous/bounds"),
                    "the box of a homogeneous volume is turned by its transform",
                    "only translation and scale are possible: boxes stay parallel to the axes",
                )
            })?)
        }
    };
    let sigma_t = extinction.map(|e| (e * homogeneous.sigma_t) as f32);
    let medium = Medium::homogeneous(sigma_t, bounds, albedo, phase)
        .map_err(|source| Error::medium(place("/homogeneous"), source))?
        .with_transmittance_function(law);
    Ok(Volume {
        name: name(request),
        medium: Arc::new(medium),
        emission: None,
        source: VolumeSource::Homogeneous,
    })
}

fn name(request: &VolumeRequest<'_>) -> String {
    let file = request.spec.vdb.as_ref().map(Path::new).and_then(Path::file_stem);
    match &request.spec.name {
        Some(name) => name.clone(),
        None if !request.fallback_name.is_empty() => request.fallback_name.to_owned(),
        None => file.map_or_else(|| "volume".into(), |stem| stem.to_string_lossy().into_owned()),
    }
}

/// A box moved by a transform that keeps it parallel to the axes; `None` for any other transform.
fn move_box(bounds: Bounds3, transform: &DAffine3) -> Option<Bounds3> {
    let matrix = transform.matrix3;
    let largest = matrix.to_cols_array().into_iter().fold(0.0f64, |a, v| a.max(v.abs()));
    for column in [matrix.x_axis, matrix.y_axis, matrix.z_axis] {
        let nonzero = column.to_array().iter().filter(|v| v.abs() > 1e-12 * largest).count();
        if nonzero != 1 {
            return None;
        }
    }
    Some(Bounds3::of_points([bounds.low, bounds.high].map(|p| transform.transform_point3(p))))
}

/// What to do where it is not clear which grid is the density: what the remedy of that error begins
/// with, so that programs can say it in words of their own.
pub const NAME_THE_GRID: &str = "name one with `density`: {\"grid\": ...}";

/// The grid that gives the density: as named, else `density`, else the only fog volume.
fn density_grid(
    file: &VdbFile,
    path: &Path,
    density: &DensitySpec,
    place: &dyn Fn(&str) -> Place,
) -> Result<usize, Error> {
    let place_of_grid = || place(if density.grid.is_some() { "/density/grid" } else { "/vdb" });
    let index = match &density.grid {
        Some(name) => file.find(name).map_err(|source| Error::vdb(place_of_grid(), source))?,
        None => default_density_grid(file).ok_or_else(|| {
            let names: Vec<String> = file.grids().iter().map(describe).collect();
            let (what, remedy) = if names.is_empty() {
                ("the file has no grids".to_owned(), "write it again with a fog volume".to_owned())
            } else {
                (
                    "it is not clear which grid is the density".to_owned(),
                    format!("{NAME_THE_GRID}; the file has {}", names.join(", ")),
                )
            };
            Error::missing(place_of_grid(), format!("{}: {what}", path.display()), remedy)
        })?,
    };
    let info = grid_info(file, index, path)?;
    if info.class == GridClass::LevelSet {
        return Err(Error::unsupported(
            place_of_grid(),
            format!(
                "{}: grid `{}` is a level set (distances), not a density",
                path.display(),
                info.name
            ),
            "convert it to a fog volume (Houdini: Convert VDB, OpenVDB: sdfToFogVolume)",
        ));
    }
    if matches!(info.value_type, ValueType::Vec3f | ValueType::Vec3d | ValueType::Vec3i) {
        return Err(Error::unsupported(
            place_of_grid(),
            format!("{}: grid `{}` holds vectors ({})", path.display(), info.name, info.type_name),
            "name a grid of numbers as the density",
        ));
    }
    Ok(index)
}

/// The index of the grid that a file without further word means: the first `density`, else the
/// only grid of floating-point numbers that is not a level set.
pub fn default_density_grid(file: &VdbFile) -> Option<usize> {
    let possible = |info: &GridInfo| {
        matches!(info.value_type, ValueType::Float | ValueType::Double | ValueType::Half)
            && info.class != GridClass::LevelSet
    };
    let grids = file.grids();
    if let Some(index) = grids.iter().position(|info| info.name == "density") {
        return Some(index);
    }
    let mut fogs = grids.iter().enumerate().filter(|(_, info)| possible(info));
    match (fogs.next(), fogs.next()) {
        (Some((index, _)), None) => Some(index),
        _ => None,
    }
}

pub(crate) fn grid_info<'a>(
    file: &'a VdbFile,
    index: usize,
    path: &Path,
) -> Result<&'a GridInfo, Error> {
    file.grids().get(index).ok_or_else(|| {
        Error::missing(Place::file(path), format!("grid {index} does not exist"), "")
    })
}

fn describe(info: &GridInfo) -> String {
    let level_set = if info.class == GridClass::LevelSet { ", level set" } else { "" };
    format!("`{}` ({}{level_set})", info.full_name(), info.value_type)
}

/// The box of a grid's active voxels in the file's world, by what its metadata say.
fn box_by_metadata(info: &GridInfo) -> Option<Bounds3> {
    let corner = |name: &str| match info.metadata.get(name) {
        Some(MetaValue::Vec3i(corner)) => Some(DVec3::from_array(corner.map(f64::from))),
        _ => None,
    };
    let (low, high) = (corner("file_bbox_min")?, corner("file_bbox_max")?);
    Some(Bounds3::new(low, high).moved(&affine(info.transform.matrix().ok()?)))
}

/// Row vectors as OpenVDB writes them, `world = [i, j, k, 1] * M`, to an affine transform.
pub fn affine(matrix: [[f64; 4]; 4]) -> DAffine3 {
    let [x, y, z, w] = matrix.map(|[a, b, c, _]| DVec3::new(a, b, c));
    DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: w }
}

/// Everything after the grid's own transform: up axis, the volume's transform, the node's.
fn placement(
    spec: &VolumeSpec,
    to_world: &DAffine3,
    place: &dyn Fn(&str) -> Place,
) -> Result<DAffine3, Error> {
    let up = match spec.up_axis().0 {
        UpAxis::Y => DAffine3::IDENTITY,
        // (x, y, z) to (x, z, -y)
        UpAxis::Z => DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y)),
    };
    let own = match &spec.transform {
        None => DAffine3::IDENTITY,
        Some(TransformSpec { translation, rotation, scale }) => {
            let rotation = DQuat::from_array(rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
            if !(rotation.is_finite() && (rotation.length() - 1.0).abs() < 1e-2) {
                return Err(Error::invalid(
                    place("/transform/rotation"),
                    "the rotation is not a unit quaternion",
                    "give x, y, z, w with squares that add up to 1; [0, 0, 0, 1] is no rotation",
                ));
            }
            DAffine3::from_scale_rotation_translation(
                DVec3::from_array(scale.unwrap_or([1.0; 3])),
                rotation.normalize(),
                DVec3::from_array(translation.unwrap_or([0.0; 3])),
            )
        }
    };
    let placement = *to_world * own * up;
    if !(placement.is_finite() && placement.matrix3.determinant().is_normal()) {
        return Err(Error::invalid(
            place(if spec.transform.is_some() { "/transform" } else { "" }),
            "the volume's transform is singular or not finite",
            "use scales other than 0",
        ));
    }
    Ok(placement)
}

pub(crate) fn channels(
    rgb: Rgb,
    range: std::ops::RangeInclusive<f64>,
    place: &dyn Fn() -> Place,
    what: &str,
) -> Result<[f64; 3], Error> {
    let channels = rgb.channels();
    if channels.iter().all(|c| range.contains(c)) {
        return Ok(channels);
    }
    Err(Error::invalid(
        place(),
        format!("{what} is {channels:?}"),
        format!("use numbers between {} and {}", range.start(), range.end()),
    ))
}

fn constant_albedo(rgb: Rgb, place: &dyn Fn(&str) -> Place) -> Result<[f32; 3], Error> {
    let channels = channels(rgb, 0.0..=1.0, &|| place("/albedo"), "albedo")?;
    Ok(channels.map(|c| c as f32))
}

/// Median optical depth that [`automatic_scale`] aims at.
pub const CLOUD_OPTICAL_DEPTH: f64 = 20.0;

/// Names of grids that say where there is fire, the clearest first.
const FIRES: [&str; 4] = ["flame", "flames", "heat", "temperature"];
/// Colours by the value of such a grid, from none to the largest: a picture of fire, no
/// measurement.
const FIRE_RAMP: [(f64, [f64; 3]); 4] = [
    (0.0, [0.0; 3]),
    (0.35, [0.1, 0.012, 0.0]),
    (0.65, [0.55, 0.13, 0.01]),
    (1.0, [1.0, 0.52, 0.14]),
];
/// What such a grid is scaled to: radiance times the length of typical rays, where it is hottest.
const FIRE_RADIANCE: f64 = 3.0;
/// Largest values above this are taken for kelvin.
const KELVIN: f64 = 100.0;
/// Where bodies begin to glow, kelvin (Draper's point, roughly).
const FIRST_GLOW: f64 = 800.0;
/// Albedo of the smoke around a fire that nobody described.
const SOOT_ALBEDO: f64 = 0.6;
/// Optical depth of the smoke around a fire that nobody described, as a share of that of a cloud:
/// flames are seen through it.
const SOOT_SHARE: f64 = 0.2;

/// The extinction per scene unit at grid value 1 that makes a volume look like a cloud.
///
/// The exact optical depths along a fixed lattice of rays through the volume's bounds, parallel to
/// each axis, are computed; the scale lifts the median of those that are not negligible to
/// [`CLOUD_OPTICAL_DEPTH`]. 1 for a volume without density.
pub fn automatic_scale(
    grid: &Arc<VoxelGrid>,
    index_to_world: &DAffine3,
) -> Result<f64, pileus_media::Error> {
    let scale = CLOUD_OPTICAL_DEPTH / median_depth(grid, index_to_world)?;
    Ok(if scale.is_finite() { scale } else { 1.0 })
}

/// The median of the optical depths at scale 1 that are not negligible, see [`automatic_scale`]; 0
/// for a volume without density.
fn median_depth(
    grid: &Arc<VoxelGrid>,
    index_to_world: &DAffine3,
) -> Result<f64, pileus_media::Error> {
    /// Rays along each axis: 16 x 16.
    const SIDE: usize = 16;
    let albedo = Albedo::Constant([1.0; 3]);
    let medium =
        Medium::from_grid(grid.clone(), *index_to_world, [1.0; 3], albedo, Phase::Isotropic)?;
    let Some(bounds) = medium.bounds_world() else { return Ok(0.0) };
    let size = bounds.size();
    let mut depths = Vec::with_capacity(3 * SIDE * SIDE);
    for axis in 0..3 {
        let along = DVec3::AXES[axis];
        let (across, beside) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
        for i in 0..SIDE * SIDE {
            let at = |k: usize| (k as f64 + 0.5) / SIDE as f64;
            let offset = across * at(i % SIDE) + beside * at(i / SIDE);
            let length = size.dot(along);
            let mut tally = pileus_media::Tally::default();
            depths.push(pileus_media::optical_depth(
                &medium,
                bounds.low + size * offset,
                along,
                0.0,
                length,
                &mut tally,
            ));
        }
    }
    let largest = depths.iter().copied().fold(0.0f64, f64::max);
    depths.retain(|&depth| depth > 0.01 * largest);
    depths.sort_by(f64::total_cmp);
    Ok(depths.get(depths.len() / 2).copied().unwrap_or(0.0))
}
