//! Runs a plan: tiles over threads, passes over samples.

use crate::counters::Counters;
use crate::error::Error;
use crate::interior::Inside;
use crate::limits::PathLimits;
use crate::media::{
    AnyStructure, DefaultStructure, Media, Overlapping, Ray, SingleChromatic, SingleGrey,
    Structures, UnderLaw,
};
use crate::path::Kernel;
use crate::plan::{KernelKind, Plan};
use crate::sampler::PathSampler;
use crate::settings::RenderSettings;
use crate::thickness::typical_sigma_t;
use crate::world::{MediaAlone, Whole, World, luminance};
use glam::Vec3;
use pileus_film::{Film, PixelSample, Tile};
use pileus_media::transmittance::Telescope;
use pileus_media::{GridShape, MajorantStructure, Medium, Voxel, VoxelKernel};
use pileus_scene::Scene;
use rayon::prelude::*;
use std::marker::PhantomData;
use std::ops::Range;
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

/// Renders `settings.samples` of every pixel of the film's window into it, on the current rayon pool.
///
/// The value of a sample depends on scene, plan, settings, pixel and sample number alone, and the film's sums are exact: threads, tile
/// size, the length of passes and any split of the samples change nothing, bit for bit. When the
/// monitor cancels, paths end where they are and count nowhere; the film, and the counters
/// returned, hold all whole passes done so far: the first `film.samples()` of the range.
///
/// # Errors
/// If film and camera differ in resolution.
pub fn render(
    scene: &Scene,
    plan: &Plan,
    settings: &RenderSettings,
    film: &mut Film,
    monitor: &dyn Monitor,
) -> Result<Counters, Error> {
    if scene.camera.resolution() != film.resolution() {
        return Err(Error::Invalid {
            what: format!(
                "the camera was made for {:?} pixels, the film has {:?}",
                scene.camera.resolution(),
                film.resolution()
            ),
            remedy: "make both from one resolution".into(),
        });
    }
    let watch = Watch { monitor, stopped: AtomicBool::new(false) };
    let mut run = Run { scene, settings, film, watch: &watch };
    Ok(dispatch(scene, plan, settings, &|| watch.stopped(), &mut run))
}

/// The value of one sample of one pixel: what [`render`] adds to the film.
pub fn sample_pixel(
    scene: &Scene,
    plan: &Plan,
    settings: &RenderSettings,
    pixel: [u32; 2],
    sample: u64,
) -> PixelSample {
    struct One<'a> {
        scene: &'a Scene,
        settings: &'a RenderSettings,
        pixel: [u32; 2],
        sample: u64,
    }
    impl Job for One<'_> {
        type Output = PixelSample;
        fn run<M: Media, W: World, const MIS: bool, const EQUIANGULAR: bool>(
            &mut self,
            kernel: &Kernel<'_, M, W>,
        ) -> PixelSample {
            let mut counters = Counters::default();
            trace::<M, W, MIS, EQUIANGULAR>(
                kernel,
                self.scene,
                self.settings,
                self.pixel,
                self.sample,
                &mut counters,
            )
        }
    }
    dispatch(scene, plan, settings, &|| false, &mut One { scene, settings, pixel, sample })
}

/// Work that is compiled for each kernel.
trait Job {
    type Output;
    fn run<M: Media, W: World, const MIS: bool, const EQUIANGULAR: bool>(
        &mut self,
        kernel: &Kernel<'_, M, W>,
    ) -> Self::Output;
}

/// Compiles a job's kernel with what the plan needs.
fn run_planned<J: Job, M: Media>(
    plan: &Plan,
    job: &mut J,
    kernel: &Kernel<'_, M, MediaAlone>,
) -> J::Output {
    match (plan.mis, plan.equiangular) {
        (false, false) => job.run::<M, MediaAlone, false, false>(kernel),
        (true, false) => job.run::<M, MediaAlone, true, false>(kernel),
        (false, true) => job.run::<M, MediaAlone, false, true>(kernel),
        (true, true) => job.run::<M, MediaAlone, true, true>(kernel),
    }
}

/// What all kernels of a render share.
#[derive(Clone, Copy)]
struct Common<'a> {
    scene: &'a Scene,
    plan: &'a Plan,
    limits: PathLimits<'a>,
    typical_sigma_t: f64,
}

impl<'a> Common<'a> {
    fn kernel<M: Media, W: World>(&self, media: M, world: W) -> Kernel<'a, M, W> {
        Kernel {
            media,
            world,
            lights: &self.plan.lights.0,
            environment: &self.scene.environment,
            max_bounces: self.limits.max_bounces(),
            limits: self.limits,
            typical_sigma_t: self.typical_sigma_t,
            analog_flights: self.plan.analog_flights,
            inside: Inside::new(),
            expected: self.plan.expected.as_deref(),
        }
    }
}

/// The one place where a plan turns into a compiled kernel.
fn dispatch<J: Job>(
    scene: &Scene,
    plan: &Plan,
    settings: &RenderSettings,
    stop: &(dyn Fn() -> bool + Sync),
    job: &mut J,
) -> J::Output {
    let media = plan.media.media.as_slice();
    let limits = PathLimits::new(settings, stop);
    let typical_sigma_t = if plan.equiangular { typical_sigma_t(scene) } else { 0.0 };
    let common = Common { scene, plan, limits, typical_sigma_t };
    if let (KernelKind::SingleGrey | KernelKind::SingleChromatic, [medium]) = (plan.kernel, media)
        && let Some(grid) = medium.grid()
    {
        let own = grid.majorants().structure() == MajorantStructure::Adaptive
            && !settings.shared_kernel;
        let single = Single { medium, grid, common, job };
        return if own {
            grid.with_voxels(On::<_, DefaultStructure>(single, PhantomData))
        } else {
            grid.with_voxels(On::<_, AnyStructure>(single, PhantomData))
        };
    }
    let media = Overlapping { media, index: &plan.media.index, methods: plan.methods };
    if !matches!(plan.kernel, KernelKind::Whole | KernelKind::UnderLaw) {
        return run_planned(plan, job, &common.kernel(media, MediaAlone));
    }
    let fires: Vec<_> = scene.fires().cloned().collect();
    let surfaces = scene.surfaces.as_deref();
    let world = Whole { surfaces, fires: &fires };
    let camera = scene.camera.position();
    let inside = surfaces.map_or_else(Inside::new, |s| Inside::around(s, camera));
    if plan.kernel == KernelKind::UnderLaw {
        // One kernel for all such scenes: the plan keeps equiangular points away from them.
        let telescope = Telescope::with_exponent(settings.level_exponent);
        let media = UnderLaw { plain: media, telescope };
        let kernel = Kernel { inside, ..common.kernel(media, world) };
        return job.run::<_, _, true, false>(&kernel);
    }
    let kernel = Kernel { inside, ..common.kernel(media, world) };
    if plan.equiangular {
        job.run::<_, _, true, true>(&kernel)
    } else {
        job.run::<_, _, true, false>(&kernel)
    }
}

/// The single-grid kernels, waiting for their voxel type.
struct Single<'a, J> {
    medium: &'a Medium,
    grid: &'a GridShape,
    common: Common<'a>,
    job: &'a mut J,
}

/// The same, with the majorant structures that it is compiled for.
struct On<T, S>(T, PhantomData<S>);

impl<J: Job, S: Structures> VoxelKernel for On<Single<'_, J>, S> {
    type Output = J::Output;
    fn run<V: Voxel>(self, voxels: &[V]) -> J::Output {
        let Single { medium, grid, common, job } = self.0;
        let (structures, plan) = (PhantomData::<S>, common.plan);
        let one = SingleGrid { medium, grid, voxels };
        if plan.kernel == KernelKind::SingleChromatic {
            let media = SingleChromatic { structures, one, weighted: plan.mis };
            return run_planned(plan, job, &common.kernel(media, MediaAlone));
        }
        let media = SingleGrey { structures, one, methods: plan.methods };
        run_planned(plan, job, &common.kernel(media, MediaAlone))
    }
}

/// Traces one sample of one pixel.
#[inline(always)]
fn trace<M: Media, W: World, const MIS: bool, const EQUIANGULAR: bool>(
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
    let mut value =
        kernel.trace::<MIS, EQUIANGULAR>(ray, &mut sampler, [depth, decision], counters);
    if let Some(most) = settings.clamp {
        let rgb = Vec3::from_array(value.rgb);
        let found = luminance(rgb);
        if found > most {
            value.rgb = (rgb * (most / found)).to_array();
            counters.clamped += 1;
        }
    }
    value
}

struct Run<'a> {
    scene: &'a Scene,
    settings: &'a RenderSettings,
    film: &'a mut Film,
    watch: &'a Watch<'a>,
}

impl Job for Run<'_> {
    type Output = Counters;

    fn run<M: Media, W: World, const MIS: bool, const EQUIANGULAR: bool>(
        &mut self,
        kernel: &Kernel<'_, M, W>,
    ) -> Counters {
        let tiles = self.film.tiles(self.settings.tile_size);
        let range = self.settings.samples.clone();
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
            let Some((rendered, pass_counters)) =
                self.pass::<M, W, MIS, EQUIANGULAR>(kernel, &tiles, pass.clone(), &done, total)
            else {
                break;
            };
            for tile in &rendered {
                self.film.add_tile(tile);
            }
            self.film.commit_pass(pass.end - pass.start);
            counters.merge(&pass_counters);
            next = pass.end;
            // Longer passes cost less overhead, shorter ones lose less when cancelled.
            let seconds = start.elapsed().as_secs_f64();
            if seconds < 0.5 * PASS_SECONDS {
                length *= 2;
            } else if seconds > 2.0 * PASS_SECONDS {
                length = (length / 2).max(1);
            }
        }
        counters
    }
}

impl Run<'_> {
    /// One pass over all tiles; `None` if it was cancelled.
    fn pass<M: Media, W: World, const MIS: bool, const EQUIANGULAR: bool>(
        &self,
        kernel: &Kernel<'_, M, W>,
        tiles: &[(u32, u32, u32, u32)],
        samples: Range<u64>,
        done: &AtomicU64,
        total: u64,
    ) -> Option<(Vec<Tile>, Counters)> {
        let rendered: Option<Vec<(Tile, Counters)>> = tiles
            .par_iter()
            .map(|&(x0, y0, width, height)| {
                let mut before_look = 1u32;
                let mut tile = Tile::new(x0, y0, width, height);
                let mut counters = Counters::default();
                for y in y0..y0 + height {
                    for x in x0..x0 + width {
                        for sample in samples.clone() {
                            before_look -= 1;
                            if before_look == 0 {
                                if self.watch.stopped() {
                                    return None;
                                }
                                before_look = PATHS_BETWEEN_LOOKS;
                            }
                            let value = trace::<M, W, MIS, EQUIANGULAR>(
                                kernel,
                                self.scene,
                                self.settings,
                                [x, y],
                                sample,
                                &mut counters,
                            );
                            counters.dropped += u64::from(!tile.add(x, y, sample, &value));
                        }
                    }
                }
                // A path in here may have been cut.
                if self.watch.stopped() {
                    return None;
                }
                let count = u64::from(width) * u64::from(height) * (samples.end - samples.start);
                let before = done.fetch_add(count, Ordering::Relaxed);
                self.watch.monitor.progress(before + count, total);
                Some((tile, counters))
            })
            .collect();
        let mut counters = Counters::default();
        let mut result = Vec::with_capacity(tiles.len());
        for (tile, tile_counters) in rendered? {
            counters.merge(&tile_counters);
            result.push(tile);
        }
        Some((result, counters))
    }
}
