//! A renderer: scene, plan, media, lights and prepass of one render.

use crate::counters::Counters;
use crate::dispatch::{Parts, PlannedMedia};
use crate::error::Error;
use crate::kernel::PathLimits;
use crate::lights::Lights;
use crate::passes::{Monitor, Unmonitored, Watch, render_passes};
use crate::plan::Plan;
use crate::prepass::Prepass;
use crate::settings::RenderSettings;
use pileus_film::{Crop, Film, PixelSample};
use pileus_scene::Scene;
use std::ops::Range;

/// All that a render needs beside a film: the scene, what is planned for it, and what was made for
/// that.
#[derive(Debug)]
pub struct Renderer<'a> {
    scene: &'a Scene,
    settings: RenderSettings,
    plan: Plan,
    media: PlannedMedia,
    lights: Lights,
    prepass: Prepass,
}

impl<'a> Renderer<'a> {
    /// Plans a render of `scene`, makes what it needs, and traces the prepass: some seconds of work
    /// at most, whatever the scene.
    ///
    /// # Errors
    /// If the settings ask for what the scene does not allow, or if paths would not end by
    /// construction.
    pub fn new(scene: &'a Scene, settings: &RenderSettings) -> Result<Renderer<'a>, Error> {
        let lights = Lights::new(scene, settings.light_sampling);
        let plan = Plan::with_lights(scene, settings, &lights)?;
        let media = PlannedMedia::new(scene, settings)?;
        let settings = settings.clone();
        let mut renderer =
            Renderer { scene, settings, plan, media, lights, prepass: Prepass::default() };
        renderer.prepass = renderer.with_parts(Prepass::new);
        Ok(renderer)
    }

    /// What is modelled, by which methods, and why.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// What some paths ahead have told.
    pub fn prepass(&self) -> &Prepass {
        &self.prepass
    }

    /// How the scene is sampled.
    pub fn settings(&self) -> &RenderSettings {
        &self.settings
    }

    /// Renders the settings' samples of every pixel of the film's window into it, on the current
    /// rayon pool.
    ///
    /// The value of a sample depends on scene, settings, pixel and sample number alone, and the
    /// film's sums are exact: threads, tile size, the length of passes and any split of the samples
    /// change nothing, bit for bit. When the monitor cancels, paths end where they are and count
    /// nowhere; the film, and the counters returned, hold all whole passes done so far: the first
    /// `film.samples()` of the range.
    ///
    /// # Errors
    /// If film and camera differ in resolution, or if there is no memory for the samples of a pass.
    pub fn render(&self, film: &mut Film, monitor: &dyn Monitor) -> Result<Counters, Error> {
        self.render_samples(self.settings.samples.clone(), film, monitor)
    }

    /// Renders the samples of these numbers, instead of the settings', into `film`.
    ///
    /// # Errors
    /// If film and camera differ in resolution, or if there is no memory for the samples of a pass.
    pub fn render_samples(
        &self,
        samples: Range<u64>,
        film: &mut Film,
        monitor: &dyn Monitor,
    ) -> Result<Counters, Error> {
        if self.scene.camera.resolution() != film.resolution() {
            return Err(Error::Film {
                what: format!(
                    "the camera was made for {:?} pixels, the film has {:?}: make both from one resolution",
                    self.scene.camera.resolution(),
                    film.resolution()
                ),
            });
        }
        let watch = Watch::new(monitor);
        let stop = || watch.stopped();
        render_passes(&self.parts(&stop), samples, film, &watch)
    }

    /// The value of one sample of one pixel: what [`Renderer::render`] adds to the film; `None` if
    /// that would drop it, because it is not finite.
    ///
    /// # Errors
    /// If the pixel is not in the camera's image.
    pub fn sample_pixel(
        &self,
        [x, y]: [u32; 2],
        sample: u64,
    ) -> Result<Option<PixelSample>, Error> {
        let pixel = Crop { x0: x, y0: y, width: 1, height: 1 };
        let mut film = Film::new(self.scene.camera.resolution(), Some(pixel))?;
        self.render_samples(sample..sample + 1, &mut film, &Unmonitored)?;
        let counted = film.pixel(x, y).filter(|pixel| pixel.count() > 0);
        Ok(counted.map(|pixel| {
            // The mean of one sample is that sample, exactly.
            let [r, g, b, alpha] = pixel.mean().map(|value| value as f32);
            PixelSample::new([r, g, b], alpha)
        }))
    }

    fn parts<'p>(&'p self, stop: &'p (dyn Fn() -> bool + Sync)) -> Parts<'p> {
        Parts {
            scene: self.scene,
            plan: &self.plan,
            settings: &self.settings,
            media: &self.media,
            lights: &self.lights,
            radiance_cache: self.prepass.radiance_cache.as_ref(),
            limits: PathLimits::new(&self.settings, stop),
        }
    }

    pub(crate) fn with_parts<T>(&self, f: impl FnOnce(&Parts<'_>) -> T) -> T {
        f(&self.parts(&|| false))
    }
}
