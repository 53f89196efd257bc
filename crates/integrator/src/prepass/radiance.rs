//! A radiance cache for adjoint-driven Russian roulette: what a path may be expected to bring, and
//! so whether a shadow ray is worth its walk.
//!
//! Cells of a coarse grid over the media hold the mean radiance that paths brought after a
//! scattering there [in the manner of Vorba and Krivanek 2016], and how much of distant lights
//! arrives. A fixed number of paths with fixed seeds, summed in order: a function of scene,
//! majorants and longest path alone. Whatever the estimates are, the picture is unbiased: they only
//! decide how often a shadow ray is sent, never with probability zero.

use super::lattice;
use crate::camera_ray::camera_ray;
use crate::counters::Counters;
use crate::dispatch::{Job, Parts};
use crate::kernel::{DirectLight, Kernel, Recorder, World, luminance};
use crate::media::Media;
use crate::sampler::PathSampler;
use glam::{DVec3, Vec3};
use pileus_math::Bounds3;
use pileus_scene::Scene;
use rayon::prelude::*;

/// Cells along the longest edge.
const CELLS: f64 = 16.0;

/// Paths that are traced: some 10 ms of processor time.
const PATHS: u32 = 4096;

/// Scatterings after which one ends: bounds the time.
const MAX_BOUNCES: u32 = 128;

/// Events after which one is cut, for the same reason.
const MAX_EVENTS: u64 = 1 << 14;

/// Scatterings that a cell is taken to have had without any: of the mean radiance, in full light.
const PRIOR: f64 = 8.0;

/// Least radiance expected, over the mean: keeps quotients finite.
const MIN_RADIANCE: f32 = 0.01;

/// A shadow ray is certain if it may bring one over this of what its path was expected to.
/// Measured: `docs/charts/methods.md`.
const CERTAIN_SHARE: f32 = 2.0;

/// Least probability of a shadow ray over that which it has without the estimate: an error of the
/// estimate costs no more variance than its inverse.
const MIN_SURVIVAL_RATIO: f32 = 0.1;

/// What is known of a cell.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Cell {
    /// Mean radiance that a path brings after a scattering here, over the mean of all paths.
    radiance: f32,
    /// Root mean square of the transmittance towards lights, as shadow rays estimate it.
    clear: f32,
}

/// A coarse grid of estimates over the media.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RadianceCache {
    low: DVec3,
    cells_per_length: f64,
    size: [usize; 3],
    cells: Vec<Cell>,
    /// Radiance that unshadowed lights scatter alike into all directions, over the mean of all
    /// paths.
    unshadowed: f32,
    /// Mean over all paths.
    scatterings: f64,
}

/// A medium interaction of a path.
struct Visit {
    cell: usize,
    /// Luminance gathered until then.
    before: f32,
    beta: f32,
    /// Square of the transmittance towards a light, over the probability of asking for it.
    clear2: f32,
    /// Luminance of lights if scattering were isotropic and nothing in the way, over the
    /// probability of asking for it.
    unshadowed: f32,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f64,
    radiance: f64,
    clear2: f64,
}

impl RadianceCache {
    /// Estimates for media under distant lights; `None` if media have no bounds, or nothing is lit.
    pub(super) fn new(parts: &Parts<'_>) -> Option<RadianceCache> {
        let bounds: Option<Vec<_>> = parts.media.media.iter().map(|m| m.bounds_world()).collect();
        let bounds = bounds?.into_iter().reduce(Bounds3::union)?;
        let (low, extent) = (bounds.low, bounds.size());
        let cells_per_length = CELLS / extent.max_element();
        if !(extent.min_element() > 0.0 && cells_per_length > 0.0 && cells_per_length.is_finite()) {
            return None;
        }
        let size = (extent * cells_per_length).ceil().to_array();
        let size = size.map(|n| n.clamp(1.0, CELLS) as usize);
        let cells = vec![Cell::default(); size.iter().product()];
        let mut cache =
            RadianceCache { low, cells_per_length, size, cells, unshadowed: 0.0, scatterings: 0.0 };
        let limits = parts.limits.with_max_bounces(MAX_BOUNCES).with_max_events(MAX_EVENTS);
        let parts = Parts { limits, ..*parts };
        let traced = parts.with_coupled_kernel(&mut Paths { scene: parts.scene, cache: &cache });
        cache.learn(&traced).then_some(cache)
    }

    /// Takes means over paths, in their order; whether they brought any light.
    fn learn(&mut self, traced: &[(f32, Vec<Visit>)]) -> bool {
        let (mut total, mut paths, mut unshadowed, mut count) = (0.0f64, 0.0, 0.0f64, 0.0);
        let mut sums = vec![Sums::default(); self.cells.len()];
        for (radiance, visits) in traced.iter().filter(|(_, visits)| !visits.is_empty()) {
            total += f64::from(*radiance);
            paths += 1.0;
            for visit in visits {
                unshadowed += f64::from(visit.unshadowed);
                count += 1.0;
                let Some(sum) = sums.get_mut(visit.cell) else { continue };
                sum.count += 1.0;
                sum.radiance += f64::from((radiance - visit.before) / visit.beta);
                sum.clear2 += f64::from(visit.clear2);
            }
        }
        let mean = total / paths;
        if !(mean > 0.0 && mean.is_finite() && unshadowed.is_finite()) {
            return false;
        }
        for (cell, sum) in self.cells.iter_mut().zip(&sums) {
            let count = sum.count + PRIOR;
            cell.radiance = (((sum.radiance / mean + PRIOR) / count) as f32).max(MIN_RADIANCE);
            cell.clear = ((sum.clear2 + PRIOR) / count).sqrt() as f32;
        }
        self.unshadowed = (unshadowed / count / mean) as f32;
        self.scatterings = count / f64::from(PATHS);
        true
    }

    /// Scatterings of a path, in the mean.
    pub(crate) fn scatterings(&self) -> f64 {
        self.scatterings
    }

    fn index(&self, p: DVec3) -> usize {
        let at = (p - self.low) * self.cells_per_length;
        let [nx, ny, nz] = self.size;
        // Casts saturate: points outside take the nearest cell.
        let [x, y, z] = [at.x as usize, at.y as usize, at.z as usize];
        (z.min(nz - 1) * ny + y.min(ny - 1)) * nx + x.min(nx - 1)
    }

    /// Radiance that a path is expected to bring after a scattering at a point, over the mean;
    /// positive.
    #[inline]
    pub(crate) fn radiance(&self, p: DVec3) -> f32 {
        self.cells.get(self.index(p)).map_or(1.0, |cell| cell.radiance)
    }

    /// Probability of a shadow ray from a point of a medium: in proportion to what it may bring,
    /// over the radiance that its path was expected to bring at its first scattering. `importance`:
    /// of the lights, times the throughput; `without`: the probability without this estimate, in
    /// (0, 1].
    #[inline]
    pub(crate) fn survival(&self, p: DVec3, first: f32, importance: f32, without: f32) -> f32 {
        let clear = self.cells.get(self.index(p)).map_or(1.0, |cell| cell.clear);
        let share = importance * self.unshadowed * clear / first;
        // `min` and `max` ignore what is not a number.
        (CERTAIN_SHARE * share).max(MIN_SURVIVAL_RATIO * without).min(1.0)
    }
}

/// Remembers the medium interactions of a path.
struct InteractionRecorder<'a> {
    cache: &'a RadianceCache,
    counters: Counters,
    /// Of the interaction at hand: square of the transmittance, and unshadowed luminance.
    light: [f32; 2],
    visits: Vec<Visit>,
}

impl Recorder for InteractionRecorder<'_> {
    fn counters(&mut self) -> &mut Counters {
        &mut self.counters
    }

    fn direct_light(&mut self, light: DirectLight) {
        let DirectLight { survival, transmittance, unshadowed } = light;
        self.light = [transmittance * transmittance, unshadowed].map(|x| x / survival);
    }

    fn medium_interaction(&mut self, p: DVec3, beta: Vec3, radiance: Vec3) {
        let [clear2, unshadowed] = std::mem::take(&mut self.light);
        let (cell, beta) = (self.cache.index(p), luminance(beta));
        if beta > 0.0 {
            let before = luminance(radiance);
            self.visits.push(Visit { cell, before, beta, clear2, unshadowed });
        }
    }
}

/// Paths over a lattice of pixels: the luminance that each brings, and where it scattered.
struct Paths<'a> {
    scene: &'a Scene,
    cache: &'a RadianceCache,
}

impl Job for Paths<'_> {
    type Output = Vec<(f32, Vec<Visit>)>;

    fn run<M: Media, W: World>(&mut self, kernel: &Kernel<'_, M, W>) -> Self::Output {
        let trace = |number: u32| {
            let film = lattice(self.scene.camera.resolution(), number);
            let pixel = film.map(|x| x as u32);
            let mut sampler = PathSampler::new(1, pixel[0], pixel[1], u64::from(number));
            let [_, _, depth, decision] = sampler.stratified(0);
            let mut recorder = InteractionRecorder {
                cache: self.cache,
                counters: Counters::default(),
                light: [0.0; 2],
                visits: Vec::new(),
            };
            let ray = camera_ray(&self.scene.camera, film, &sampler);
            let sample = kernel.trace(ray, [depth, decision], &mut sampler, &mut recorder);
            (luminance(sample.radiance), recorder.visits)
        };
        (0..PATHS).into_par_iter().with_min_len(64).map(trace).collect()
    }
}
