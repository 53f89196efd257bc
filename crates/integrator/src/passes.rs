//! Runs a kernel: tiles over threads, passes over samples.

use crate::camera_ray::camera_ray;
use crate::counters::Counters;
use crate::dispatch::Job;
use crate::error::Error;
use crate::kernel::{Kernel, World, luminance};
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
    let ray = camera_ray(&scene.camera, film, &sampler);
    let mut value = kernel.trace(ray, [depth, decision], &mut sampler, counters);
    if let Some(most) = settings.clamp {
        let found = luminance(value.radiance);
        if found > most {
            value.radiance *= most / found;
            counters.clamped += 1;
        }
    }
    PixelSample::new(value.radiance.to_array(), value.alpha)
}

/// One sample of one pixel.
pub(crate) struct OneSample<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) settings: &'a RenderSettings,
    pub(crate) pixel: [u32; 2],
    pub(crate) sample: u64,
}

impl Job for OneSample<'_> {
    type Output = PixelSample;

    fn run<M: Media, W: World>(&mut self, kernel: &Kernel<'_, M, W>) -> PixelSample {
        let OneSample { scene, settings, pixel, sample } = *self;
        trace(kernel, scene, settings, pixel, sample, &mut Counters::default())
    }
}

/// Samples of all pixels, in passes over the tiles of a film.
pub(crate) struct Passes<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) settings: &'a RenderSettings,
    pub(crate) samples: Range<u64>,
    pub(crate) film: &'a mut Film,
    pub(crate) watch: &'a Watch<'a>,
}

impl Job for Passes<'_> {
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

impl Passes<'_> {
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
