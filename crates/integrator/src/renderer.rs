//! A renderer: scene, plan, media, lights and prepass of one render, and the one place where a plan
//! turns into a compiled kernel.

use crate::counters::Counters;
use crate::error::{Error, Parameter, Remedy};
use crate::kernel::{
    Kernel, MediumStack, PathLimits, VolumesAndSurfaces, VolumesOnly, World, luminance,
};
use crate::lights::Lights;
use crate::media::channels::{ChannelMode, Grey, Spectral, Split};
use crate::media::{
    AnyPhase, IsotropicOrHenyeyGreenstein, Media, MediaIndex, Merged, NoMedia, OneGrid, PhaseAxis,
    Ray,
};
use crate::plan::thickness::typical_sigma_t;
use crate::plan::{self, Channels, Events, PhaseFunctions, Plan, extinguishes};
use crate::prepass::{Prepass, RadianceCache};
use crate::sampler::PathSampler;
use crate::settings::RenderSettings;
use pileus_film::{Film, PixelSample, Tile};
use pileus_media::distance::DistanceSampler;
use pileus_media::transmittance::Telescope;
use pileus_media::{GridShape, MajorantStructure, Medium, Voxel, VoxelKernel};
use pileus_scene::Scene;
use rayon::prelude::*;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

/// Watches a render and may stop it.
pub trait Monitor: Sync {
    /// Whether to stop: the running pass is given up, what was committed before stands. Asked from
    /// all threads, between paths and within long ones; once it was true it is not asked again.
    fn cancelled(&self) -> bool {
        false
    }
    /// Called after every tile with the pixel samples done and to do in total.
    fn progress(&self, _done: u64, _total: u64) {}
}

/// A monitor that does nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unmonitored;

impl Monitor for Unmonitored {}

/// A monitor that has stopped a render stays that way: a path that was cut is in no tile that
/// counts.
struct Watch<'a> {
    monitor: &'a dyn Monitor,
    stopped: AtomicBool,
}

impl Watch<'_> {
    fn stopped(&self) -> bool {
        if self.stopped.load(Ordering::Relaxed) {
            return true;
        }
        let stopped = self.monitor.cancelled();
        if stopped {
            self.stopped.store(true, Ordering::Relaxed);
        }
        stopped
    }
}

/// Paths of a tile between two looks at the monitor.
const PATHS_BETWEEN_LOOKS: u32 = 64;

/// Seconds that a pass should take: what a cancelled render loses at most, roughly.
const PASS_SECONDS: f64 = 2.0;

/// The media of a scene that have any extinction, with the majorants that the settings ask for.
#[derive(Debug)]
pub(crate) struct PlannedMedia {
    pub(crate) media: Vec<Arc<Medium>>,
    pub(crate) index: MediaIndex,
}

impl PlannedMedia {
    fn new(scene: &Scene, settings: &RenderSettings) -> Result<PlannedMedia, Error> {
        let (structure, factor) = (settings.majorants, settings.majorant_scale);
        let default = structure == MajorantStructure::default() && factor == 1.0;
        let media: Vec<Arc<Medium>> = scene
            .volumes
            .iter()
            .filter(|volume| extinguishes(&volume.medium))
            .map(|volume| {
                if default {
                    return Ok(Arc::clone(&volume.medium));
                }
                volume.medium.with_majorants(structure, factor).map(Arc::new).map_err(|error| {
                    Error::Parameter {
                        parameter: Parameter::MajorantScale,
                        value: factor.to_string(),
                        why: format!("volume `{}`: {error}", volume.name),
                        remedies: vec![Remedy::Default(&[
                            Parameter::Majorants,
                            Parameter::MajorantScale,
                        ])],
                    }
                })
            })
            .collect::<Result<_, Error>>()?;
        let index = MediaIndex::new(&media);
        Ok(PlannedMedia { media, index })
    }
}

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

    /// Renders the given samples of every pixel of the film's window into it, whatever the settings
    /// say of samples, on the current rayon pool.
    ///
    /// When the monitor cancels, paths end where they are and count nowhere; the film, and the
    /// counters returned, hold all whole passes done so far. Values of samples are those of
    /// [`Renderer::render`], bit for bit.
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
        let watch = Watch { monitor, stopped: AtomicBool::new(false) };
        let stop = || watch.stopped();
        let (scene, settings) = (self.scene, &self.settings);
        let mut run = Run { scene, settings, samples, film, watch: &watch };
        self.parts(&stop).with_planned_kernel(&mut run)
    }

    /// The value of one sample of one pixel: what [`Renderer::render`] adds to the film.
    pub fn sample_pixel(&self, pixel: [u32; 2], sample: u64) -> PixelSample {
        let (scene, settings) = (self.scene, &self.settings);
        let mut one = OneSample { scene, settings, pixel, sample };
        self.parts(&|| false).with_planned_kernel(&mut one)
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

/// What kernels are made of.
#[derive(Clone, Copy)]
pub(crate) struct Parts<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) plan: &'a Plan,
    pub(crate) settings: &'a RenderSettings,
    pub(crate) media: &'a PlannedMedia,
    pub(crate) lights: &'a Lights,
    pub(crate) radiance_cache: Option<&'a RadianceCache>,
    pub(crate) limits: PathLimits<'a>,
}

/// Work that is compiled for each kernel.
pub(crate) trait Job {
    type Output;
    fn run<M: Media, W: World>(&mut self, kernel: &Kernel<'_, M, W>) -> Self::Output;
}

impl<'a> Parts<'a> {
    /// Runs a job with the plan's kernel.
    fn with_planned_kernel<J: Job>(&self, job: &mut J) -> J::Output {
        let kernel = self.plan.kernel;
        match (kernel.events, kernel.channels) {
            (Events::None, _) => self.with_world(NoMedia, job),
            (Events::OneGrid, _) => self.with_one_grid(job),
            (Events::MergedList, Channels::Grey) => self.with_world(self.merged(Grey), job),
            (Events::MergedList, Channels::Split) => {
                self.with_world(self.merged(self.split()), job)
            }
            (Events::MergedList, Channels::Spectral) => {
                self.with_world(self.merged(self.spectral()), job)
            }
        }
    }

    /// Runs a job with the kernel that every scene can run: a merged list, split where the plan
    /// says so, beside surfaces.
    pub(crate) fn with_general_kernel<J: Job>(&self, job: &mut J) -> J::Output {
        if self.plan.kernel.channels == Channels::Split {
            return job.run(&self.kernel(
                self.merged(self.split()),
                self.volumes_and_surfaces(&self.emissive_volumes()),
            ));
        }
        self.with_coupled_kernel(job)
    }

    /// Runs a job with a kernel that every scene can run and whose channels do not decouple: a
    /// merged list, spectral, beside surfaces.
    pub(crate) fn with_coupled_kernel<J: Job>(&self, job: &mut J) -> J::Output {
        let emissive_volumes = self.emissive_volumes();
        let world = self.volumes_and_surfaces(&emissive_volumes);
        job.run(&self.kernel(self.merged(self.spectral()), world))
    }

    fn split(&self) -> Split {
        Split { weighted: self.plan.mis }
    }

    fn spectral(&self) -> Spectral {
        Spectral { by_throughput: self.plan.methods.distance != DistanceSampler::Delta }
    }

    fn merged<C: ChannelMode>(&self, channels: C) -> Merged<'a, C> {
        Merged::new(
            (&self.media.media, &self.media.index),
            self.plan.methods,
            channels,
            Telescope::with_exponent(self.settings.level_exponent),
        )
    }

    fn with_one_grid<J: Job>(&self, job: &mut J) -> J::Output {
        match self.media.media.as_slice() {
            [medium] if let Some(grid) = medium.default_grid() => {
                grid.with_voxels(OnVoxels { parts: self, medium, grid, job })
            }
            // The plan chose one grid: there is no other case.
            _ => self.with_world(self.merged(Grey), job),
        }
    }

    fn emissive_volumes(&self) -> Vec<Arc<pileus_media::EmissionField>> {
        self.scene.fires().cloned().collect()
    }

    fn volumes_and_surfaces<'w>(
        &self,
        emissive_volumes: &'w [Arc<pileus_media::EmissionField>],
    ) -> VolumesAndSurfaces<'w>
    where
        'a: 'w,
    {
        let surfaces = self.scene.surfaces.as_deref();
        let camera = self.scene.camera.position();
        let camera_in = surfaces.map_or_else(MediumStack::new, |s| MediumStack::around(s, camera));
        VolumesAndSurfaces { surfaces, emissive_volumes, camera_in }
    }

    fn with_world<J: Job, M: Media>(&self, media: M, job: &mut J) -> J::Output {
        match self.plan.kernel.world {
            plan::World::Volumes => job.run(&self.kernel(media, VolumesOnly)),
            plan::World::VolumesAndSurfaces => {
                let emissive_volumes = self.emissive_volumes();
                job.run(&self.kernel(media, self.volumes_and_surfaces(&emissive_volumes)))
            }
        }
    }

    fn kernel<M: Media, W: World>(&self, media: M, world: W) -> Kernel<'a, M, W> {
        let plan = self.plan;
        Kernel {
            media,
            world,
            lights: self.lights,
            environment: &self.scene.environment,
            limits: self.limits,
            mis: plan.mis,
            equiangular: plan.equiangular,
            typical_sigma_t: if plan.equiangular { typical_sigma_t(self.scene) } else { 0.0 },
            analog_flights: plan.analog_flights,
            radiance_cache: self.radiance_cache,
        }
    }
}

/// The kernels of one grid, waiting for its voxel type.
struct OnVoxels<'p, 'a, J> {
    parts: &'p Parts<'a>,
    medium: &'p Medium,
    grid: &'p GridShape,
    job: &'p mut J,
}

impl<J: Job> VoxelKernel for OnVoxels<'_, '_, J> {
    type Output = J::Output;

    fn run<V: Voxel>(self, voxels: &[V]) -> J::Output {
        let OnVoxels { parts, medium, grid, job } = self;
        let grid = OfGrid { parts, medium, grid, voxels };
        let kernel = parts.plan.kernel;
        match (kernel.channels == Channels::Grey, kernel.phase) {
            (true, PhaseFunctions::IsotropicOrHenyeyGreenstein) => {
                grid.run::<_, IsotropicOrHenyeyGreenstein, _>(Grey, job)
            }
            (true, PhaseFunctions::Any) => grid.run::<_, AnyPhase, _>(Grey, job),
            (false, PhaseFunctions::IsotropicOrHenyeyGreenstein) => {
                grid.run::<_, IsotropicOrHenyeyGreenstein, _>(parts.split(), job)
            }
            (false, PhaseFunctions::Any) => grid.run::<_, AnyPhase, _>(parts.split(), job),
        }
    }
}

/// A grid with its voxels in their type.
struct OfGrid<'p, 'a, V> {
    parts: &'p Parts<'a>,
    medium: &'p Medium,
    grid: &'p GridShape,
    voxels: &'p [V],
}

impl<V: Voxel> OfGrid<'_, '_, V> {
    fn run<C: ChannelMode, P: PhaseAxis, J: Job>(&self, channels: C, job: &mut J) -> J::Output {
        let OfGrid { parts, medium, grid, voxels } = *self;
        let media = OneGrid { medium, grid, voxels, channels, phase: PhantomData::<P> };
        parts.with_world(media, job)
    }
}

/// Traces one sample of one pixel.
#[inline(always)]
fn trace<M: Media, W: World>(
    kernel: &Kernel<'_, M, W>,
    scene: &Scene,
    settings: &RenderSettings,
    [x, y]: [u32; 2],
    sample: u64,
    counters: &mut Counters,
) -> PixelSample {
    let mut sampler = PathSampler::new(settings.seed, x, y, sample);
    let [u, v, depth, decision] = sampler.stratified(0);
    let offset = settings.filter.sample([u, v]);
    let film =
        [f64::from(x) + 0.5 + f64::from(offset[0]), f64::from(y) + 0.5 + f64::from(offset[1])];
    let (origin, direction) = scene.camera.ray(film);
    let ray = Ray { origin, direction };
    let mut value = kernel.trace(ray, [depth, decision], &mut sampler, counters);
    if let Some(most) = settings.clamp {
        let found = luminance(value.radiance);
        if found > most {
            value.radiance *= most / found;
            counters.clamped += 1;
        }
    }
    PixelSample { rgb: value.radiance.to_array(), alpha: value.alpha }
}

/// One sample of one pixel.
struct OneSample<'a> {
    scene: &'a Scene,
    settings: &'a RenderSettings,
    pixel: [u32; 2],
    sample: u64,
}

impl Job for OneSample<'_> {
    type Output = PixelSample;

    fn run<M: Media, W: World>(&mut self, kernel: &Kernel<'_, M, W>) -> PixelSample {
        let OneSample { scene, settings, pixel, sample } = *self;
        trace(kernel, scene, settings, pixel, sample, &mut Counters::default())
    }
}

struct Run<'a> {
    scene: &'a Scene,
    settings: &'a RenderSettings,
    samples: Range<u64>,
    film: &'a mut Film,
    watch: &'a Watch<'a>,
}

impl Job for Run<'_> {
    type Output = Result<Counters, Error>;

    fn run<M: Media, W: World>(&mut self, kernel: &Kernel<'_, M, W>) -> Self::Output {
        let mut tiles: Vec<Tile> = self
            .film
            .tiles(self.settings.tile_size)
            .into_iter()
            .map(|(x0, y0, width, height)| self.film.tile(x0, y0, width, height))
            .collect();
        let range = self.samples.clone();
        let crop = self.film.crop();
        let pixels = u64::from(crop.width) * u64::from(crop.height);
        let total = pixels * (range.end.saturating_sub(range.start));
        let done = AtomicU64::new(0);
        let mut counters = Counters::default();
        let mut next = range.start;
        let mut length = 1u64;
        while next < range.end && !self.watch.stopped() {
            let pass = next..(next + length).min(range.end);
            let start = Instant::now();
            let Some(mut pass_counters) =
                self.pass(kernel, &mut tiles, pass.clone(), &done, total)?
            else {
                break;
            };
            let dropped_before = self.film.dropped();
            self.film.add_tiles(&tiles)?;
            self.film.commit_pass(pass.end - pass.start);
            pass_counters.dropped += self.film.dropped() - dropped_before;
            counters.merge(&pass_counters);
            next = pass.end;
            // Longer passes cost less overhead, shorter ones lose less when cancelled and take less
            // memory.
            let seconds = start.elapsed().as_secs_f64();
            if seconds < 0.5 * PASS_SECONDS {
                length = (length * 2).min(self.film.samples_per_pass());
            } else if seconds > 2.0 * PASS_SECONDS {
                length = (length / 2).max(1);
            }
        }
        Ok(counters)
    }
}

impl Run<'_> {
    /// One pass over all tiles, which then hold its samples; `None` if it was cancelled.
    fn pass<M: Media, W: World>(
        &self,
        kernel: &Kernel<'_, M, W>,
        tiles: &mut [Tile],
        samples: Range<u64>,
        done: &AtomicU64,
        total: u64,
    ) -> Result<Option<Counters>, Error> {
        let rendered: Vec<Option<Counters>> = tiles
            .par_iter_mut()
            .map(|tile| {
                tile.start(samples.clone())?;
                let (columns, rows) =
                    (tile.x0..tile.x0 + tile.width, tile.y0..tile.y0 + tile.height);
                let mut before_look = 1u32;
                let mut counters = Counters::default();
                for y in rows {
                    for x in columns.clone() {
                        for sample in samples.clone() {
                            before_look -= 1;
                            if before_look == 0 {
                                if self.watch.stopped() {
                                    return Ok(None);
                                }
                                before_look = PATHS_BETWEEN_LOOKS;
                            }
                            let value = trace(
                                kernel,
                                self.scene,
                                self.settings,
                                [x, y],
                                sample,
                                &mut counters,
                            );
                            tile.add(x, y, sample, &value);
                        }
                    }
                }
                // A path in here may have been cut.
                if self.watch.stopped() {
                    return Ok(None);
                }
                let pixels = u64::from(tile.width) * u64::from(tile.height);
                let count = pixels * (samples.end - samples.start);
                let before = done.fetch_add(count, Ordering::Relaxed);
                self.watch.monitor.progress(before + count, total);
                Ok(Some(counters))
            })
            .collect::<Result<_, pileus_film::Error>>()?;
        let mut counters = Counters::default();
        for tile in rendered {
            let Some(tile) = tile else { return Ok(None) };
            counters.merge(&tile);
        }
        Ok(Some(counters))
    }
}
