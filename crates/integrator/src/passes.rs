//! Runs a kernel: tiles over threads, passes over samples.

use crate::camera_ray::camera_ray;
use crate::counters::Counters;
use crate::dispatch::{Job, Parts};
use crate::error::Error;
use crate::kernel::{Kernel, World, luminance};
use crate::layers::{RenderRecorder, SceneRecord};
use crate::media::Media;
use crate::sampler::PathSampler;
use crate::settings::RenderSettings;
use pileus_film::{Film, PixelSample, Tile};
use pileus_scene::Scene;
use rayon::prelude::*;
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
pub(crate) struct Watch<'a> {
    monitor: &'a dyn Monitor,
    stopped: AtomicBool,
}

impl<'a> Watch<'a> {
    pub(crate) fn new(monitor: &'a dyn Monitor) -> Watch<'a> {
        Watch { monitor, stopped: AtomicBool::new(false) }
    }

    pub(crate) fn stopped(&self) -> bool {
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

/// How much longer than the last a pass may be: each goes through the whole film once.
const PASS_GROWTH: u64 = 16;

/// Traces one sample of one pixel.
#[inline(always)]
fn trace<M: Media, W: World>(
    kernel: &Kernel<'_, M, W>,
    scene: &Scene,
    settings: &RenderSettings,
    [x, y]: [u32; 2],
    sample: u64,
    recorder: &mut RenderRecorder<'_>,
) -> PixelSample {
    let mut sampler = PathSampler::new(settings.seed, x, y, sample);
    let [u, v, depth, decision] = sampler.stratified(0);
    let offset = settings.filter.sample([u, v]);
    let film =
        [f64::from(x) + 0.5 + f64::from(offset[0]), f64::from(y) + 0.5 + f64::from(offset[1])];
    let ray = camera_ray(&scene.camera, film, &sampler);
    let mut value = kernel.trace(ray, [depth, decision], &mut sampler, recorder);
    if let Some(most) = settings.clamp {
        let found = luminance(value.radiance);
        if found > most {
            value.radiance *= most / found;
            recorder.counters.clamped += 1;
            if let Some(layers) = &mut recorder.layers {
                layers.scale_light(most / found);
            }
        }
    }
    PixelSample::new(value.radiance.to_array(), value.alpha)
}

/// Renders the samples of these numbers into `film`, in passes.
pub(crate) fn render_passes(
    parts: &Parts<'_>,
    samples: Range<u64>,
    film: &mut Film,
    watch: &Watch<'_>,
) -> Result<Counters, Error> {
    let mut tiles: Vec<Tile> = film
        .tiles(parts.settings.tile_size)
        .into_iter()
        .map(|(x0, y0, width, height)| film.tile(x0, y0, width, height))
        .collect();
    let crop = film.crop();
    let pixels = u64::from(crop.width) * u64::from(crop.height);
    let total = pixels * (samples.end.saturating_sub(samples.start));
    let done = AtomicU64::new(0);
    let mut counters = Counters::default();
    let mut next = samples.start;
    let mut length = 1u64;
    while next < samples.end && !watch.stopped() {
        let numbers = next..(next + length).min(samples.end);
        let start = Instant::now();
        let mut pass = Pass {
            scene: parts.scene,
            settings: parts.settings,
            numbers: numbers.clone(),
            records: film.takes_records(),
            tiles: &mut tiles,
            watch,
            done: &done,
            total,
        };
        let Some(mut pass_counters) = parts.with_planned_kernel(&mut pass)? else { break };
        let dropped_before = film.dropped();
        film.add_tiles(&tiles)?;
        film.commit_pass(numbers.end - numbers.start);
        pass_counters.dropped += film.dropped() - dropped_before;
        counters.merge(&pass_counters);
        next = numbers.end;
        // Longer passes cost less overhead, shorter ones lose less when cancelled and take less
        // memory.
        let seconds = start.elapsed().as_secs_f64();
        let wanted = length as f64 * PASS_SECONDS / seconds.max(1e-6);
        if wanted >= 2.0 * length as f64 {
            length = (wanted as u64).min(length * PASS_GROWTH).min(film.samples_per_pass());
        } else if seconds > 2.0 * PASS_SECONDS {
            length = (length / 2).max(1);
        }
    }
    Ok(counters)
}

/// One pass: the samples of these numbers in all pixels of the tiles, which then hold them.
struct Pass<'a> {
    scene: &'a Scene,
    settings: &'a RenderSettings,
    numbers: Range<u64>,
    /// Whether layers ask for what paths tell.
    records: bool,
    tiles: &'a mut [Tile],
    watch: &'a Watch<'a>,
    /// Pixel samples done so far, and to do, in all passes.
    done: &'a AtomicU64,
    total: u64,
}

/// What was counted in a tile or a pass; `None` if it was cancelled.
type Counted = Result<Option<Counters>, Error>;

impl Job for Pass<'_> {
    type Output = Counted;

    fn run<M: Media, W: World>(&mut self, kernel: &Kernel<'_, M, W>) -> Counted {
        let Pass { scene, settings, watch, done, total, records, .. } = *self;
        let numbers = &self.numbers;
        let render = |tile: &mut Tile| -> Counted {
            tile.start(numbers.clone())?;
            let (columns, rows) = (tile.x0..tile.x0 + tile.width, tile.y0..tile.y0 + tile.height);
            let mut before_look = 1u32;
            let layers = records.then(|| SceneRecord::new(scene));
            let mut recorder = RenderRecorder { counters: Counters::default(), layers };
            for y in rows {
                for x in columns.clone() {
                    for sample in numbers.clone() {
                        before_look -= 1;
                        if before_look == 0 {
                            if watch.stopped() {
                                return Ok(None);
                            }
                            before_look = PATHS_BETWEEN_LOOKS;
                        }
                        let value = trace(kernel, scene, settings, [x, y], sample, &mut recorder);
                        match &mut recorder.layers {
                            None => tile.add(x, y, sample, &value),
                            Some(path) => tile.add_recorded(x, y, sample, &value, &path.take()),
                        };
                    }
                }
            }
            // A path in here may have been cut.
            if watch.stopped() {
                return Ok(None);
            }
            let pixels = u64::from(tile.width) * u64::from(tile.height);
            let count = pixels * (numbers.end - numbers.start);
            let before = done.fetch_add(count, Ordering::Relaxed);
            watch.monitor.progress(before + count, total);
            Ok(Some(recorder.counters))
        };
        in_parallel(self.tiles, &render)
    }
}

/// Renders tiles on the current rayon pool. Compiled once for all kernels.
fn in_parallel(tiles: &mut [Tile], render: &(dyn Fn(&mut Tile) -> Counted + Sync)) -> Counted {
    let rendered: Vec<Option<Counters>> =
        tiles.par_iter_mut().map(render).collect::<Result<_, Error>>()?;
    let mut counters = Counters::default();
    for tile in rendered {
        let Some(tile) = tile else { return Ok(None) };
        counters.merge(&tile);
    }
    Ok(Some(counters))
}
