//! From what a user wrote about a volume's light to a field of emission.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::DAffine3;
use pileus_media::emission::{
    BlackbodyRadiance, ColorRamp, EmissionField, EmissionSource, HOTTEST_KELVIN,
};
use pileus_media::{Interpolation, Medium, VoxelGrid};
use pileus_vdb::{GridClass, GridInfo, ValueType, VdbFile};

use super::color::channels;
use super::grids::grid_info;
use super::loader::VolumeLoader;
use super::placement::affine;
use crate::error::{Error, Place};
use crate::spec::volume_spec::{EmissionSpec, RampNodeSpec, Rgb, TemperatureSpec};

/// What a field of emission is made of.
pub(crate) struct EmissionParts<'a> {
    /// What the user wrote.
    pub(crate) emission: &'a EmissionSpec,
    /// The place of a key of the volume.
    pub(crate) place: &'a dyn Fn(&str) -> Place,
    pub(crate) file: &'a VdbFile,
    pub(crate) path: &'a Path,
    pub(crate) interpolation: Interpolation,
    /// Everything after a grid's own transform.
    pub(crate) placement: DAffine3,
    pub(crate) medium: &'a Medium,
    pub(crate) density: Arc<VoxelGrid>,
    /// From the index space of the density.
    pub(crate) medium_to_world: DAffine3,
    /// Extinction per channel where the density is 1.
    pub(crate) sigma_t: [f32; 3],
}

impl VolumeLoader {
    /// The light of a volume. Grids come from the cache; only bounds and tables are built anew.
    pub(crate) fn emission(&mut self, parts: &EmissionParts<'_>) -> Result<EmissionField, Error> {
        let (source, to_world) = match parts.emission {
            EmissionSpec::Grid { grid, color, scale, ramp } => {
                let what = (color.as_ref(), *scale, ramp.as_deref());
                self.emission_of_grid(parts, grid, what)?
            }
            EmissionSpec::Blackbody { temperature, intensity, normalised } => {
                let radiance = match normalised {
                    Some(true) => BlackbodyRadiance::Normalised,
                    _ => BlackbodyRadiance::Absolute,
                };
                let intensity = intensity.unwrap_or(1.0);
                let source = self.blackbody(parts, temperature, intensity, radiance)?;
                (source, parts.medium_to_world)
            }
        };
        let start = Instant::now();
        let field = EmissionField::new(source, to_world)
            .map_err(|source| Error::medium((parts.place)("/emission"), source))?;
        self.seconds_build += start.elapsed().as_secs_f64();
        Ok(field)
    }

    fn emission_of_grid(
        &mut self,
        parts: &EmissionParts<'_>,
        name: &str,
        (color, scale, ramp): (Option<&Rgb>, Option<f64>, Option<&[RampNodeSpec]>),
    ) -> Result<(EmissionSource, DAffine3), Error> {
        let place = parts.place;
        let scale = scale.unwrap_or(1.0);
        if !(0.0..=1e30).contains(&scale) {
            return Err(Error::invalid(
                place("/emission/scale"),
                format!("the emission's scale is {scale}"),
                "use a number between 0 and 1e30",
            ));
        }
        let at_color = || place("/emission/color");
        let rgb = channels(
            color.copied().unwrap_or(Rgb::Grey(1.0)),
            0.0..=1e30,
            &at_color,
            "the emission's color",
        )?;
        let at_grid = || place("/emission/grid");
        let (index, info) = find(parts, name, "/emission/grid")?;
        let own = info.transform.matrix().map_err(|source| Error::vdb(at_grid(), source))?;
        let to_world = parts.placement * affine(own);
        let (file, path, interpolation) = (parts.file, parts.path, parts.interpolation);
        let is_vector =
            matches!(info.value_type, ValueType::Vec3f | ValueType::Vec3d | ValueType::Vec3i);
        let color = rgb.map(|c| (c * scale) as f32);
        let source = match ramp {
            None if is_vector => EmissionSource::Channels {
                channels: self.channels(file, path, index, interpolation, &at_grid)?,
                color,
            },
            None => EmissionSource::Grid {
                grid: self.grid(file, path, index, interpolation, &at_grid)?,
                color,
            },
            Some(_) if parts.has_color() => {
                return Err(Error::invalid(
                    at_color(),
                    "the emission has both `color` and `ramp`",
                    "remove `color`, and use `scale` for brightness",
                ));
            }
            Some(_) if is_vector => {
                return Err(Error::invalid(
                    place("/emission/ramp"),
                    format!(
                        "grid `{name}` holds colours ({}), which need no ramp",
                        info.value_type
                    ),
                    "remove `ramp`, or name a grid of numbers",
                ));
            }
            Some(nodes) => EmissionSource::Ramp {
                grid: self.grid(file, path, index, interpolation, &at_grid)?,
                ramp: ramp_of(nodes, scale, place)?,
            },
        };
        Ok((source, to_world))
    }

    /// A black body's light, where there is both density and heat.
    fn blackbody(
        &mut self,
        parts: &EmissionParts<'_>,
        temperature: &TemperatureSpec,
        intensity: f64,
        radiance: BlackbodyRadiance,
    ) -> Result<EmissionSource, Error> {
        let place = parts.place;
        let name = &temperature.grid;
        let (scale, offset) = (temperature.scale(), temperature.offset());
        for (number, range, key, what) in [
            (scale, 0.0..=1e30, "/emission/temperature/scale", "the temperature's scale"),
            (offset, -1e30..=1e30, "/emission/temperature/offset", "the temperature's offset"),
            (intensity, 0.0..=1e30, "/emission/intensity", "the emission's intensity"),
        ] {
            if !range.contains(&number) {
                return Err(Error::invalid(
                    place(key),
                    format!("{what} is {number}"),
                    format!("use a number between {} and {}", range.start(), range.end()),
                ));
            }
        }
        let at_grid = || place("/emission/temperature/grid");
        let (index, info) = find(parts, name, "/emission/temperature/grid")?;
        let own = affine(info.transform.matrix().map_err(|source| Error::vdb(at_grid(), source))?);
        let grid = self.grid(parts.file, parts.path, index, parts.interpolation, &at_grid)?;
        warn_of_heat(parts.path, name, &grid, scale, offset);
        Ok(EmissionSource::Blackbody {
            density: parts.density.clone(),
            sigma_t: parts.sigma_t,
            albedo: parts.medium.optics().albedo().clone(),
            temperature: grid,
            to_temperature: (parts.placement * own).inverse() * parts.medium_to_world,
            kelvin_per_unit: scale,
            kelvin_offset: offset,
            radiance,
            intensity: intensity as f32,
            phase: parts.medium.phase().clone(),
        })
    }
}

impl EmissionParts<'_> {
    fn has_color(&self) -> bool {
        matches!(self.emission, EmissionSpec::Grid { color: Some(_), .. })
    }
}

/// A grid of the volume's file by name; distances are no light.
fn find<'a>(
    parts: &EmissionParts<'a>,
    name: &str,
    key: &str,
) -> Result<(usize, &'a GridInfo), Error> {
    let place = || (parts.place)(key);
    let index = parts.file.find(name).map_err(|source| Error::vdb(place(), source))?;
    let info = grid_info(parts.file, index, parts.path)?;
    if info.class == GridClass::LevelSet {
        return Err(Error::unsupported(
            place(),
            format!("{}: grid `{name}` is a level set (distances)", parts.path.display()),
            "name a fog volume",
        ));
    }
    Ok((index, info))
}

fn ramp_of(
    nodes: &[RampNodeSpec],
    scale: f64,
    place: &dyn Fn(&str) -> Place,
) -> Result<ColorRamp, Error> {
    let mut colors = Vec::with_capacity(nodes.len());
    for (i, node) in nodes.iter().enumerate() {
        let at = || place(&format!("/emission/ramp/{i}/color"));
        let color = channels(node.color, 0.0..=1e30, &at, "the color")?;
        colors.push((node.value as f32, color.map(|c| (c * scale) as f32)));
    }
    ColorRamp::new(colors).map_err(|source| Error::medium(place("/emission/ramp"), source))
}

/// Heat beyond the table is seldom meant: kelvin are expected, but grids hold anything.
fn warn_of_heat(path: &Path, name: &str, grid: &Arc<VoxelGrid>, scale: f64, offset: f64) {
    let hottest = scale * f64::from(grid.range().1) + offset;
    let path = path.display();
    if hottest > HOTTEST_KELVIN {
        tracing::warn!(
            "{path}: grid `{name}` reaches {hottest:.0} K; what is hotter than {HOTTEST_KELVIN} K glows as that"
        );
    } else if hottest < 500.0 {
        tracing::warn!(
            "{path}: grid `{name}` reaches {hottest:.1} K only and emits no light; \
             `temperature`: {{\"scale\": ...}} turns its values into kelvin"
        );
    }
}
