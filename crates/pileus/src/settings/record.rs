//! The job as it is remembered: with what was chosen, so that it tells how the image came about.

use std::convert::Infallible;
use std::hash::Hasher;
use std::path::Path;

use fnv::FnvHasher;
use pileus_scene::volume_spec::{AlbedoSpec, DensitySpec, Rgb};
use pileus_scene::{Camera, Projection, Scene, VolumeSource};

use super::{LayersTo, Outputs, Settings};
use crate::job::{CameraKind, CameraSpec, Job, LightSpec, OutputSpec};

impl Settings {
    /// The job with what loading decided and with the files that the command line names.
    pub(crate) fn recorded_job(&self, scene: &Scene) -> Job {
        let mut job = self.job.clone();
        let camera = &scene.camera;
        job.film.get_or_insert_default().resolution = Some(camera.resolution());
        job.camera = Some(self.recorded_camera(camera));
        let sampling = job.sampling.get_or_insert_default();
        sampling.spp = Some(self.render.samples.end);
        sampling.seed = Some(self.render.seed);
        // Volumes of the glTF file come first, see `Scene::load`.
        let own = job.volumes.iter_mut().flatten();
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
        self.record_outputs(&mut job);
        job
    }

    /// The camera, whatever chose it, in numbers that place it again.
    fn recorded_camera(&self, camera: &Camera) -> CameraSpec {
        let told = self.job.camera.clone().unwrap_or_default();
        if told.node.is_some() || told.position.is_some() {
            return told;
        }
        let [look_at, up] = camera.placement();
        let (kind, fov_y, height) = match camera.projection() {
            Projection::Perspective { fov_y_degrees } => (None, Some(fov_y_degrees), None),
            Projection::Orthographic { height } => {
                (Some(CameraKind::Orthographic), None, Some(height))
            }
            Projection::Panorama => (Some(CameraKind::Panorama), None, None),
        };
        CameraSpec {
            kind,
            position: Some(camera.position().to_array()),
            look_at: Some(look_at.to_array()),
            up: Some(up.to_array()),
            fov_y,
            height,
            // The lens as it was told: beside it nothing chooses one.
            ..told
        }
    }

    /// Puts the files that the command line names, or moves, into the job.
    fn record_outputs(&self, job: &mut Job) {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let (options, outputs) = (&self.overrides, &self.outputs);
        let moved = options.image.is_some();
        if moved {
            job.output.get_or_insert_default().image = Some(text(&outputs.image));
        }
        if moved || options.preview.is_some() || options.no_preview {
            let preview = outputs.preview.as_deref().map(text);
            job.output.get_or_insert_default().preview = Some(preview);
        }
        let named = job.output.as_ref().is_some_and(|output| output.stats.is_some());
        if options.no_layers {
            let output = job.output.get_or_insert_default();
            (output.layers, output.aovs, output.layers_in_image) = (Some(None), None, None);
        } else if moved && job.output.as_ref().is_some_and(|output| output.layers.is_some()) {
            let layers = match &outputs.layers {
                LayersTo::File(path) => Some(Some(text(path))),
                LayersTo::Image => None,
                LayersTo::Nowhere => Some(None),
            };
            job.output.get_or_insert_default().layers = layers;
        }
        if options.no_stats || moved && !named {
            job.output.get_or_insert_default().stats = Some(outputs.stats.as_deref().map(text));
        }
    }

    /// The job that renders the same image again, whatever folder it lies in: with all paths from
    /// the root on.
    pub(crate) fn saved_job(&self, scene: &Scene) -> Job {
        let here = |path: &Path| {
            std::path::absolute(path).unwrap_or(path.to_owned()).to_string_lossy().into_owned()
        };
        let whole = |name: &str| here(&self.base.join(name));
        let mut job = self.recorded_job(scene);
        job.scene = job.scene.map(|name| whole(&name));
        for spec in job.volumes.iter_mut().flatten() {
            let Ok(()) = spec.resolve_files(|_, name| Ok::<_, Infallible>(whole(name)));
        }
        for light in job.lights.iter_mut().flatten() {
            if let LightSpec::Environment(spec) = light {
                spec.image = spec.image.as_deref().map(whole);
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
}

/// A number that tells jobs apart: FNV-1a over what determines the value of a sample. Where the
/// files go and how many samples are taken does not count.
pub(crate) fn job_hash(job: &Job) -> String {
    let mut job = Job { output: None, schema: None, ..job.clone() };
    if let Some(sampling) = &mut job.sampling {
        sampling.spp = None;
    }
    let mut hasher = FnvHasher::default();
    hasher.write(serde_json::to_string(&job).unwrap_or_default().as_bytes());
    format!("{:016x}", hasher.finish())
}
