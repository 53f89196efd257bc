//! What the command line changes about a job.

use std::path::PathBuf;

use crate::job::{CameraSpec, Job};

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
    /// A job with what is rendered changed; where files go is not.
    pub(super) fn applied_to(&self, mut job: Job) -> Job {
        if self.spp.is_some() || self.seed.is_some() {
            let sampling = job.sampling.get_or_insert_default();
            sampling.spp = self.spp.or(sampling.spp);
            sampling.seed = self.seed.or(sampling.seed);
        }
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
        if self.resolution.is_some() || self.crop.is_some() {
            let film = job.film.get_or_insert_default();
            film.resolution = self.resolution.or(film.resolution);
            film.crop = self.crop.or(film.crop);
        }
        job
    }
}
