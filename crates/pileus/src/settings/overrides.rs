//! What the command line changes about a job.

use std::path::{Path, PathBuf};

use glam::DVec3;
use pileus_film::DENOISED;
use pileus_scene::phase_spec::{CosineSpec, PhaseSpec};
use pileus_scene::volume_spec::{AlbedoSpec, Rgb};
use pileus_scene::{ByName, ClearSky, Orbit};

use crate::failure::Failure;
use crate::job::{CameraSpec, DenoiseWhen, EnvironmentSpec, Job, LightSpec, SkySpec, SunSpec};

/// Factor on a clear sky that takes the place of the default one, for the same exposure: a white
/// cloud is as bright within a seventh when the sun stands 51 degrees high, 1.4 times as bright
/// under a sun in the zenith, half as bright at 10 degrees.
const SKY_INTENSITY: f64 = 0.04;
/// Irradiance of a sun that is added to an environment: that of the default sky.
const SUN_IRRADIANCE: [f64; 3] = [6.0, 5.6, 4.9];
/// Opening angle of that sun's disc, degrees.
const SUN_ANGULAR_DIAMETER: f64 = 0.53;

/// Where the sun stands, as in [`SkySpec`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunPosition {
    /// Clockwise seen from above, degrees: 0 is at -Z, 90 at +X.
    pub azimuth: f64,
    /// Above the horizon, degrees.
    pub elevation: f64,
}

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
    /// Width and height of the full image, pixels.
    pub resolution: Option<[u32; 2]>,
    /// The window that is rendered: left, top, width and height, pixels.
    pub crop: Option<[u32; 4]>,
    /// Name of a camera of the scene, which takes the place of the job's; the job's lens stays.
    pub camera: Option<String>,
    /// From where the camera looks.
    pub orbit: Option<Orbit>,
    /// Where the sun stands.
    pub sun: Option<SunPosition>,
    /// An image of the environment, relative to the current folder.
    pub environment: Option<PathBuf>,
    /// Albedo of the job's volumes, per channel.
    pub albedo: Option<[f64; 3]>,
    /// Mean cosine of the job's volumes, by Henyey-Greenstein.
    pub g: Option<f64>,
    /// Exposure of the preview, stops.
    pub exposure: Option<f32>,
    /// Layers to keep besides those of the job.
    pub aovs: Vec<String>,
    /// Denoise the preview and keep the denoised picture as a layer, or do neither.
    pub denoise: Option<bool>,
    /// Write no preview.
    pub no_preview: bool,
    /// Write no statistics.
    pub no_stats: bool,
    /// Write no layers.
    pub no_layers: bool,
    /// Where to write the job that renders the same image again, relative to the current folder.
    pub save_job: Option<PathBuf>,
}

impl Overrides {
    /// A job with what is rendered changed; where files go is not. Names in the job are relative to
    /// `base`.
    pub(super) fn applied_to(&self, mut job: Job, base: &Path) -> Result<Job, Failure> {
        if self.spp.is_some() || self.seed.is_some() {
            let sampling = job.sampling.get_or_insert_default();
            sampling.spp = self.spp.or(sampling.spp);
            sampling.seed = self.seed.or(sampling.seed);
        }
        if self.resolution.is_some() || self.crop.is_some() {
            let film = job.film.get_or_insert_default();
            film.resolution = self.resolution.or(film.resolution);
            film.crop = self.crop.or(film.crop);
        }
        if self.exposure.is_some() || !self.aovs.is_empty() {
            let output = job.output.get_or_insert_default();
            output.exposure = self.exposure.or(output.exposure);
            let kept = output.aovs.get_or_insert_default();
            for layer in &self.aovs {
                if !kept.contains(layer) {
                    kept.push(layer.clone());
                }
            }
        }
        let layer_asked = self.aovs.iter().any(|layer| layer == DENOISED);
        if layer_asked && self.denoise == Some(false) {
            return Err(Failure::usage(
                "the layer `denoised` is asked for, and that nothing is denoised",
                "remove --no-denoise, or `denoised` from --aov",
            ));
        }
        // Who asks for the layer wants it made, whatever the job says.
        if let Some(denoise) = self.denoise.or(layer_asked.then_some(true)) {
            let when = if denoise { DenoiseWhen::End } else { DenoiseWhen::Never };
            job.denoise.get_or_insert_default().when = Some(ByName(when));
            let layers = job.output.get_or_insert_default().aovs.get_or_insert_default();
            layers.retain(|layer| layer != DENOISED);
            if denoise {
                layers.push(DENOISED.into());
            }
        }
        self.change_camera(&mut job);
        self.change_lights(&mut job, base);
        self.change_volumes(&mut job)?;
        Ok(job)
    }

    fn change_camera(&self, job: &mut Job) {
        if self.camera.is_some() {
            let told = job.camera.take().unwrap_or_default();
            // A glTF camera has no lens of its own: it takes the job's, and what that was focused
            // on stays sharp.
            let looked_at =
                told.look_at.filter(|_| told.aperture() > 0.0 && told.focus_distance.is_none());
            job.camera = Some(CameraSpec {
                node: self.camera.clone(),
                aperture: told.aperture,
                focus_distance: told.focus_distance,
                focus_on: told.focus_on.or(looked_at),
                blades: told.blades,
                ..CameraSpec::default()
            });
        }
        // Around what the job's camera looks at; other cameras make way for one that frames all.
        if let (Some(orbit), Some(told)) = (&self.orbit, &mut job.camera) {
            told.node = None;
            if let (Some(position), Some(target)) = (told.position, told.look_at) {
                let [position, target] = [position, target].map(DVec3::from_array);
                let distance = orbit.distance.unwrap_or((position - target).length());
                told.position = Some((target + orbit.backward() * distance).to_array());
                told.up = Some(orbit.up().to_array());
            }
        }
    }

    fn change_lights(&self, job: &mut Job, base: &Path) {
        if let Some(path) = &self.environment {
            // Names of a job are relative to its folder, this one to the current folder.
            let here = base.as_os_str().is_empty();
            let whole = std::path::absolute(path).ok().filter(|_| !here);
            let image = whole.as_deref().unwrap_or(path).to_string_lossy().into_owned();
            let lights = job.lights.get_or_insert_default();
            lights.retain(|light| !matches!(light, LightSpec::Environment(_) | LightSpec::Sky(_)));
            lights.push(LightSpec::Environment(EnvironmentSpec {
                image: Some(image),
                ..EnvironmentSpec::default()
            }));
        }
        let Some(SunPosition { azimuth, elevation }) = self.sun else { return };
        let to_light = ClearSky::direction(elevation, azimuth).to_array();
        let lights = job.lights.get_or_insert_default();
        let mut found = false;
        for light in lights.iter_mut() {
            match light {
                LightSpec::Sun(sun) => sun.to_light = to_light,
                LightSpec::Sky(sky) => {
                    (sky.to_sun, sky.azimuth) = (None, Some(azimuth));
                    sky.elevation = Some(elevation);
                }
                LightSpec::Environment(_) | LightSpec::Point(_) => continue,
            }
            found = true;
        }
        if found {
            return;
        }
        let lit = lights.iter().any(|light| matches!(light, LightSpec::Environment(_)));
        lights.push(if lit {
            LightSpec::Sun(SunSpec {
                to_light,
                irradiance: Rgb::Channels(SUN_IRRADIANCE),
                angular_diameter: Some(SUN_ANGULAR_DIAMETER),
            })
        } else {
            LightSpec::Sky(SkySpec {
                azimuth: Some(azimuth),
                elevation: Some(elevation),
                intensity: Some(SKY_INTENSITY),
                ..SkySpec::default()
            })
        });
    }

    fn change_volumes(&self, job: &mut Job) -> Result<(), Failure> {
        if self.albedo.is_none() && self.g.is_none() {
            return Ok(());
        }
        let volumes = job.volumes.as_mut().filter(|volumes| !volumes.is_empty());
        let Some(volumes) = volumes else {
            return Err(Failure::usage(
                "--albedo and --g change the volumes of a job or of an OpenVDB file, and there are none",
                "set them where the scene has its volumes, or give the OpenVDB file itself",
            ));
        };
        for volume in volumes {
            if let Some(albedo) = self.albedo {
                volume.albedo = Some(AlbedoSpec::Constant(Rgb::Channels(albedo)));
            }
            if let Some(g) = self.g {
                volume.phase = Some(PhaseSpec::HenyeyGreenstein { g: CosineSpec::Constant(g) });
            }
        }
        Ok(())
    }
}
