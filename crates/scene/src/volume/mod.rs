//! From what a user wrote about a volume to a medium placed in the world.

mod color;
mod emission;
mod grids;
mod homogeneous;
mod loader;
mod microflakes;
mod phase;
mod phase_grids;
mod placement;
mod request;
mod scale;
mod transmittance_function;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DVec3};
use pileus_math::Bounds3;
use pileus_media::phase::CosineGrid;
use pileus_media::{Albedo, ColorGrid, Interpolation, Medium, Phase, VoxelGrid};
use pileus_vdb::{GridClass, GridInfo, ValueType, Values, VdbFile};

pub use grids::{NAME_THE_GRID, default_density_grid};
pub use loader::VolumeLoader;
pub use placement::affine;
pub use request::{Volume, VolumeRequest, VolumeSource};
pub use scale::{CLOUD_OPTICAL_DEPTH, DefaultScale, automatic_scale};

use color::{channels, constant_albedo};
use emission::EmissionParts;
use grids::{box_by_metadata, density_grid, grid_info, warn_of_clamped};
use homogeneous::load_homogeneous;
use phase_grids::PhaseGrids;
use placement::{between, placement};
use request::name;
use scale::median_depth;
use transmittance_function::transmittance_function;

use crate::error::{Error, Place};
use crate::spec::Hint;
use crate::spec::by_name::ByName;
use crate::spec::phase_spec::{CosineSpec, PhaseSpec};
use crate::spec::volume_spec::{
    AlbedoSpec, DEFAULT_ALBEDO, DensitySpec, EmissionSpec, RampNodeSpec, Rgb,
};
use crate::uri::with_frame;

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
        let function = transmittance_function(spec, place)?;
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
            .with_transmittance_function(function);
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
            let mut grids =
                PhaseGrids { seconds_load: &mut self.seconds_load, place, file, path, density };
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
