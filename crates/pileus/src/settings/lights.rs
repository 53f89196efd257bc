//! The lights that a job adds to those of the scene.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec3};
use pileus_scene::volume_spec::Rgb;
use pileus_scene::{ClearSky, Environment, EnvironmentImage, Error, Light, Place, Point, Sun};

use super::places::Places;
use crate::failure::Failure;
use crate::job::{Job, LightSpec, SkySpec, SunSpec};

/// The lights of a job.
#[derive(Debug, Clone, Default)]
pub(super) struct JobLights {
    /// Suns and points.
    pub(super) lights: Vec<Light>,
    /// Sum of the constant environments.
    constant: Option<Vec3>,
    image: Option<EnvironmentSource>,
}

/// Where the environment's image comes from.
#[derive(Debug, Clone)]
enum EnvironmentSource {
    File { path: PathBuf, intensity: f32, rotation_y: f64, pointer: String },
    Sky { sky: ClearSky, pointer: String },
}

impl JobLights {
    /// The lights of a job. Colours, angles and factors the schema has checked.
    pub(super) fn resolve(job: &Job, base: &Path, places: &Places) -> Result<Self, Failure> {
        let mut found = Self::default();
        for (i, light) in job.lights.iter().flatten().enumerate() {
            let pointer = format!("/lights/{i}");
            match light {
                LightSpec::Sun(spec) => found.lights.push(Light::Sun(sun(spec, &pointer, places)?)),
                LightSpec::Point(spec) => found.lights.push(Light::Point(Point {
                    position: DVec3::from_array(spec.position),
                    intensity: colour(&spec.intensity),
                })),
                LightSpec::Environment(spec) => {
                    if let Some(radiance) = &spec.radiance {
                        let sum = found.constant.unwrap_or(Vec3::ZERO) + colour(radiance);
                        found.constant = Some(sum.min(Vec3::splat(f32::MAX)));
                    }
                    if let Some(name) = &spec.image {
                        found.image = Some(EnvironmentSource::File {
                            path: base.join(name),
                            intensity: spec.intensity() as f32,
                            rotation_y: spec.rotation_y(),
                            pointer: format!("{pointer}/image"),
                        });
                    }
                }
                LightSpec::Sky(spec) => {
                    let sky = clear_sky(spec, &pointer, places)?;
                    found.lights.extend(sky.sun()?);
                    found.image = Some(EnvironmentSource::Sky { sky, pointer });
                }
            }
        }
        Ok(found)
    }

    /// The image that is read, if there is one.
    pub(super) fn file(&self) -> Option<&Path> {
        match &self.image {
            Some(EnvironmentSource::File { path, .. }) => Some(path),
            _ => None,
        }
    }

    /// Loads or makes the environment; `None` if the job has none.
    pub(super) fn environment(&self, places: &Places) -> Result<Option<Environment>, Failure> {
        let image = match &self.image {
            Some(EnvironmentSource::File { path, intensity, rotation_y, pointer }) => {
                let image = EnvironmentImage::open(path, *intensity, *rotation_y);
                Some(image.map_err(|error| name_place(error, &places.at(pointer)))?)
            }
            Some(EnvironmentSource::Sky { sky, pointer }) => {
                Some(sky.image().map_err(|error| {
                    Error::invalid(places.at(pointer), error.to_string(), error.remedy())
                })?)
            }
            None => None,
        };
        let any = self.constant.is_some() || image.is_some();
        Ok(any.then(|| Environment {
            constant: self.constant.unwrap_or(Vec3::ZERO),
            image: image.map(Arc::new),
        }))
    }
}

fn colour(rgb: &Rgb) -> Vec3 {
    Vec3::from_array(rgb.channels().map(|c| c as f32))
}

fn sun(spec: &SunSpec, pointer: &str, places: &Places) -> Result<Sun, Failure> {
    let Some(to_light) = direction(spec.to_light) else {
        return Err(places.invalid(
            &format!("{pointer}/to_light"),
            "the sun has no direction",
            "give a vector that is not zero",
        ));
    };
    Ok(Sun {
        to_light: to_light.as_vec3().normalize(),
        irradiance: colour(&spec.irradiance),
        angular_diameter: spec.angular_diameter().to_radians() as f32,
    })
}

/// The sky of a job's light. Where its sun stands is either a direction or two angles; whether that
/// is high enough only the sky knows.
fn clear_sky(spec: &SkySpec, pointer: &str, places: &Places) -> Result<ClearSky, Failure> {
    let to_sun = match (spec.to_sun, spec.elevation) {
        // What has no direction is refused below.
        (Some(to_sun), _) => match DVec3::from_array(to_sun).try_normalize() {
            Some(_) => DVec3::from_array(to_sun),
            None => direction(to_sun).unwrap_or_default(),
        },
        (None, elevation) => {
            ClearSky::direction(elevation.unwrap_or_default(), spec.azimuth.unwrap_or_default())
        }
    };
    let sky = ClearSky {
        to_sun,
        turbidity: spec.turbidity(),
        ground_albedo: spec.ground_albedo().channels(),
        intensity: spec.intensity(),
        sun: spec.sun(),
        sun_angular_diameter: spec.sun_angular_diameter(),
    };
    match sky.fault() {
        None => Ok(sky),
        Some(fault) => {
            let key = match fault.field {
                "to_sun" if spec.elevation.is_some() => "elevation",
                field => field,
            };
            Err(places.invalid(&format!("{pointer}/{key}"), fault.what, fault.remedy))
        }
    }
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
