//! What glows: emission as a function of a point in index space, and its bounds over boxes.

use super::blackbody::{BlackbodyRadiance, blackbody, blackbody_bound};
use super::ramp::ColorRamp;
use crate::Error;
use crate::grid::VoxelGrid;
use crate::index_map::{box_over, snapped};
use crate::medium::Albedo;
use crate::phase::Phase;
use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;
use std::sync::Arc;

/// Where emission comes from. Index space is that of the first grid of each kind; emission is
/// radiance per length in linear Rec. 709.
#[derive(Debug, Clone)]
pub enum EmissionSource {
    /// `color * value`.
    Grid {
        /// The values.
        grid: Arc<VoxelGrid>,
        /// Emission where the value is 1.
        color: [f32; 3],
    },
    /// `color * value`, channel by channel.
    Channels {
        /// Red, green and blue.
        channels: [Arc<VoxelGrid>; 3],
        /// Emission where the value is 1.
        color: [f32; 3],
    },
    /// A colour for every value.
    Ramp {
        /// The values.
        grid: Arc<VoxelGrid>,
        /// Emission by value; black at the grid's background.
        ramp: ColorRamp,
    },
    /// `sigma_a` times the radiance of a black body.
    Blackbody {
        /// The density that absorbs.
        density: Arc<VoxelGrid>,
        /// Extinction where the density is 1, 1/length.
        sigma_t: [f32; 3],
        /// Single-scattering albedo: what is not scattered is absorbed, and absorption emits
        /// (Kirchhoff).
        albedo: Albedo,
        /// The temperature.
        temperature: Arc<VoxelGrid>,
        /// From the index space of the density to that of the temperature.
        to_temperature: DAffine3,
        /// Kelvin per unit of the temperature grid, at least 0.
        kelvin_per_unit: f64,
        /// Kelvin where the temperature grid is 0.
        kelvin_offset: f64,
        /// Absolute, or of luminance 1.
        radiance: BlackbodyRadiance,
        /// Factor on the radiance.
        intensity: f32,
        /// Phase function of the medium: microflakes absorb, and so emit, by the area that they
        /// show to the ray.
        phase: Phase,
    },
}

/// What is known of the emission over a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bound {
    /// No channel exceeds it anywhere in the box.
    pub(crate) max: f32,
    /// The emission is the same everywhere in the box.
    pub(crate) constant: bool,
}

impl Bound {
    const BLACK: Bound = Bound { max: 0.0, constant: true };
}

/// Factor on bounds for rounding in the evaluation.
const MARGIN: f32 = 1.0 + 1e-5;

impl EmissionSource {
    /// The source if it can be used: numbers in range, black outside its grids.
    pub(crate) fn checked(mut self) -> Result<EmissionSource, Error> {
        let color = match &self {
            EmissionSource::Grid { color, .. } | EmissionSource::Channels { color, .. } => *color,
            EmissionSource::Blackbody { sigma_t, .. } => *sigma_t,
            EmissionSource::Ramp { .. } => [0.0; 3],
        };
        if !color.iter().all(|c| c.is_finite() && *c >= 0.0) {
            return Err(Error::invalid(
                format!("the emission's factors {color:?} are negative or not finite"),
                "give numbers of at least 0",
            ));
        }
        if let EmissionSource::Blackbody {
            albedo,
            to_temperature,
            kelvin_per_unit,
            kelvin_offset,
            intensity,
            ..
        } = &mut self
        {
            albedo.check()?;
            let finite = kelvin_per_unit.is_finite() && kelvin_offset.is_finite();
            if !(finite && *kelvin_per_unit >= 0.0) {
                return Err(Error::invalid(
                    format!("the temperature is {kelvin_per_unit} x value + {kelvin_offset}"),
                    "give finite numbers, and a scale of at least 0",
                ));
            }
            if !(intensity.is_finite() && *intensity >= 0.0) {
                return Err(Error::invalid(
                    format!("the intensity is {intensity}"),
                    "give a finite number of at least 0",
                ));
            }
            if !to_temperature.is_finite() {
                return Err(Error::invalid(
                    "the transform of the temperature grid is singular",
                    "write the grid again",
                ));
            }
            *to_temperature = snapped(*to_temperature);
        }
        let backgrounds = match &self {
            EmissionSource::Ramp { grid, ramp } if ramp.at(grid.background()) != Vec3::ZERO => {
                return Err(Error::invalid(
                    format!(
                        "the emission does not end: the ramp is not black at {}, the grid's background",
                        grid.background()
                    ),
                    "let the ramp begin with black there",
                ));
            }
            EmissionSource::Ramp { .. } => [0.0; 3],
            EmissionSource::Channels { channels, .. } => {
                [0, 1, 2].map(|channel: usize| channels[channel].background())
            }
            EmissionSource::Grid { grid, .. } | EmissionSource::Blackbody { density: grid, .. } => {
                [grid.background(); 3]
            }
        };
        if backgrounds != [0.0; 3] {
            return Err(Error::unsupported(
                format!(
                    "the emission does not end: the grid's background is {}",
                    backgrounds.into_iter().fold(0.0, f32::max)
                ),
                "set the background to 0",
            ));
        }
        Ok(self)
    }

    /// The box of index space outside which there is no emission; `None` if there is none at all.
    pub(crate) fn support(&self) -> Option<Bounds3> {
        match self {
            EmissionSource::Grid { grid, .. }
            | EmissionSource::Ramp { grid, .. }
            | EmissionSource::Blackbody { density: grid, .. } => grid.bounds_index(),
            EmissionSource::Channels { channels, .. } => {
                channels.iter().filter_map(|grid| grid.bounds_index()).reduce(Bounds3::union)
            }
        }
    }

    /// Bricks of all its grids.
    pub(crate) fn bricks(&self) -> u64 {
        let of = |grid: &VoxelGrid| grid.report().bricks;
        match self {
            EmissionSource::Grid { grid, .. } | EmissionSource::Ramp { grid, .. } => of(grid),
            EmissionSource::Channels { channels, .. } => channels.iter().map(|g| of(g)).sum(),
            EmissionSource::Blackbody { density, temperature, .. } => of(density) + of(temperature),
        }
    }

    /// Emission at a point of index space along a ray of unit `direction` (world).
    pub(crate) fn along(&self, p_index: DVec3, direction: Vec3) -> Vec3 {
        let emission = self.at(p_index);
        match self {
            EmissionSource::Blackbody { phase: Phase::Microflakes(microflakes), .. }
                if emission != Vec3::ZERO =>
            {
                emission * microflakes.projected_area(|| p_index, direction)
            }
            _ => emission,
        }
    }

    /// Emission at a point of index space; that of microflakes were the area that they show 1.
    pub(crate) fn at(&self, p_index: DVec3) -> Vec3 {
        match self {
            EmissionSource::Grid { grid, color } => {
                Vec3::from_array(*color) * grid.interpolate(p_index) as f32
            }
            EmissionSource::Channels { channels, color } => {
                let value = |i: usize| channels[i].interpolate(p_index) as f32;
                Vec3::from_array(*color) * Vec3::new(value(0), value(1), value(2))
            }
            EmissionSource::Ramp { grid, ramp } => ramp.at(grid.interpolate(p_index) as f32),
            EmissionSource::Blackbody {
                density,
                sigma_t,
                albedo,
                temperature,
                to_temperature,
                kelvin_per_unit,
                kelvin_offset,
                radiance,
                intensity,
                ..
            } => {
                let density = density.interpolate(p_index) as f32;
                if density == 0.0 {
                    return Vec3::ZERO;
                }
                let value = temperature.interpolate(to_temperature.transform_point3(p_index));
                let le = blackbody(kelvin_per_unit * value + kelvin_offset, *radiance);
                if le == Vec3::ZERO {
                    return Vec3::ZERO;
                }
                let albedo = match albedo {
                    Albedo::Constant(albedo) => Vec3::from_array(*albedo),
                    Albedo::Grid(grid) => grid.at_index(p_index),
                };
                Vec3::from_array(*sigma_t) * density * (1.0 - albedo) * le * *intensity
            }
        }
    }

    /// Bound of the emission over a closed box of index space, along any direction.
    pub(crate) fn bound(&self, bounds: Bounds3) -> Bound {
        match self {
            EmissionSource::Grid { grid, color } => {
                let (min, max) = grid.range_over(bounds);
                let color = Vec3::from_array(*color).max_element();
                Bound { max: color * max * MARGIN, constant: min == max }
            }
            EmissionSource::Channels { channels, color } => {
                let mut bound = Bound::BLACK;
                for (grid, color) in channels.iter().zip(color) {
                    let (min, max) = grid.range_over(bounds);
                    bound.max = bound.max.max(color * max * MARGIN);
                    bound.constant &= min == max;
                }
                bound
            }
            EmissionSource::Ramp { grid, ramp } => {
                let (min, max) = grid.range_over(bounds);
                // Values may lie beyond the range by rounding, where the ramp may be steep: nodes
                // that close count.
                let (below, above) = (min * (2.0 - MARGIN), max * MARGIN);
                Bound { max: ramp.bound(below, above) * MARGIN, constant: min == max }
            }
            EmissionSource::Blackbody { density, .. } => {
                let (min, max) = density.range_over(bounds);
                if max == 0.0 {
                    return Bound::BLACK;
                }
                self.thermal_bound(bounds, (min, max))
            }
        }
    }

    /// Bound of the emission of a black body in a box, where there is density.
    fn thermal_bound(&self, bounds: Bounds3, density: (f32, f32)) -> Bound {
        let EmissionSource::Blackbody {
            sigma_t,
            albedo,
            temperature,
            to_temperature,
            kelvin_per_unit,
            kelvin_offset,
            radiance,
            intensity,
            phase,
            ..
        } = self
        else {
            return Bound::BLACK;
        };
        let (coldest, hottest) = temperature.range_over(box_over(to_temperature, bounds));
        let kelvin = |value: f32| kelvin_per_unit * f64::from(value) + kelvin_offset;
        // A hair warmer than the range, for rounding; only radiance near 500 K would notice.
        let hottest_kelvin = kelvin(hottest) + kelvin_offset.abs() * 1e-12;
        let le = blackbody_bound(kelvin(coldest), hottest_kelvin * (1.0 + 1e-12), *radiance);
        if le == 0.0 {
            return Bound::BLACK;
        }
        let (absorbing, same_albedo) = match albedo {
            Albedo::Constant(albedo) => (1.0 - Vec3::from_array(*albedo), true),
            Albedo::Grid(grid) => (1.0 - grid.least_over(bounds), grid.is_constant_over(bounds)),
        };
        let shown =
            phase.microflakes().map_or(1.0, |microflakes| microflakes.largest_area_to_any());
        let sigma_a = (Vec3::from_array(*sigma_t) * absorbing).max_element() * shown;
        Bound {
            max: sigma_a * density.1 * le * *intensity * MARGIN,
            constant: density.0 == density.1 && coldest == hottest && same_albedo,
        }
    }
}
