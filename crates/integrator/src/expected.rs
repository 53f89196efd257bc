//! What a path may be expected to bring, from a pilot: whether a shadow ray is worth its walk.
//!
//! Cells of a coarse grid over the media hold the mean radiance that paths brought after a scattering there [in the manner of Vorba and Krivanek 2016], and
//! how much of distant lights arrives. A fixed number of paths with fixed seeds, summed in order: a function of scene, majorants and longest path alone. Whatever
//! the estimates are, the picture is unbiased: they only decide how often a shadow ray is sent, never with probability zero.

use crate::lights::Lights;
use crate::media::{Flown, Leg, Media, Methods, Overlapping, Ray, Together};
use crate::plan::PlannedMedia;
use crate::sampler::PathSampler;
use crate::world::luminance;
use glam::{DVec3, Vec3};
use pileus_media::phase::ISOTROPIC;
use pileus_media::random::uniform;
use pileus_media::{PhaseAt, Tally};
use pileus_scene::Scene;
use rayon::prelude::*;

/// Cells along the longest edge.
const CELLS: f64 = 16.0;

/// Paths of the pilot: 2 to 16 ms of processor time.
const PATHS: u32 = 4096;

/// Scatterings after which a path of the pilot ends: bounds its time.
const MAX_BOUNCES: u32 = 128;

/// Throughput below which a path of the pilot ends.
const NEGLIGIBLE: f32 = 1e-3;

/// Scatterings that a cell is taken to have had without any: of the mean radiance, in full light.
const PRIOR: f64 = 8.0;

/// Least radiance expected, over the mean: keeps quotients finite.
const DARKEST: f32 = 0.01;

/// A shadow ray is certain if it may bring one over this of what its path was expected to. Measured: `docs/charts/methods.md`.
const SHARE: f32 = 2.0;

/// Least probability of a shadow ray over that which it has without the estimate: an error of the estimate costs no more variance than its inverse.
const FLOOR: f32 = 0.1;

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
pub(crate) struct Expected {
    low: DVec3,
    cells_per_length: f64,
    size: [usize; 3],
    cells: Vec<Cell>,
    /// Radiance that unshadowed lights scatter alike into all directions, over the mean of all paths.
    unshadowed: f32,
    /// Mean over all paths.
    scatterings: f64,
}

/// A scattering of a pilot path.
struct Visit {
    cell: usize,
    /// Luminance gathered until then.
    before: f32,
    beta: f32,
    gathered: Gathered,
}

/// Light of one shadow ray.
#[derive(Default)]
struct Gathered {
    scattered: Vec3,
    transmittance: f32,
    /// If scattering were isotropic and nothing in the way.
    unshadowed: f32,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f64,
    radiance: f64,
    clear2: f64,
}

impl Expected {
    /// Estimates for media under distant lights; `None` if media have no bounds, or nothing is lit.
    pub(crate) fn new(
        scene: &Scene,
        media: &PlannedMedia,
        methods: Methods,
        lights: &Lights,
        max_bounces: Option<u32>,
    ) -> Option<Expected> {
        let bounds: Option<Vec<_>> = media.media.iter().map(|m| m.bounds_world()).collect();
        let union = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let (low, high) = bounds?.into_iter().reduce(union)?;
        let extent = high - low;
        let cells_per_length = CELLS / extent.max_element();
        if !(extent.min_element() > 0.0 && cells_per_length > 0.0 && cells_per_length.is_finite()) {
            return None;
        }
        let size = (extent * cells_per_length).ceil().to_array();
        let size = size.map(|n| n.clamp(1.0, CELLS) as usize);
        let cells = vec![Cell::default(); size.iter().product()];
        let mut expected =
            Expected { low, cells_per_length, size, cells, unshadowed: 0.0, scatterings: 0.0 };
        let overlapping = Overlapping { media: &media.media, index: &media.index, methods };
        let bounces = max_bounces.unwrap_or(MAX_BOUNCES).min(MAX_BOUNCES);
        let traced: Vec<(f32, Vec<Visit>)> = (0..PATHS)
            .into_par_iter()
            .with_min_len(64)
            .map(|number| expected.walk(scene, &overlapping, lights, bounces, number))
            .collect();
        expected.learn(&traced).then_some(expected)
    }

    /// Takes means over paths, in their order; whether they brought any light.
    fn learn(&mut self, traced: &[(f32, Vec<Visit>)]) -> bool {
        let (mut total, mut paths, mut unshadowed, mut count) = (0.0f64, 0.0, 0.0f64, 0.0);
        let mut sums = vec![Sums::default(); self.cells.len()];
        for (radiance, visits) in traced.iter().filter(|(_, visits)| !visits.is_empty()) {
            total += f64::from(*radiance);
            paths += 1.0;
            for visit in visits {
                let transmittance = f64::from(visit.gathered.transmittance);
                unshadowed += f64::from(visit.gathered.unshadowed);
                count += 1.0;
                let Some(sum) = sums.get_mut(visit.cell) else { continue };
                sum.count += 1.0;
                sum.radiance += f64::from((radiance - visit.before) / visit.beta);
                sum.clear2 += transmittance * transmittance;
            }
        }
        let mean = total / paths;
        if !(mean > 0.0 && mean.is_finite() && unshadowed.is_finite()) {
            return false;
        }
        for (cell, sum) in self.cells.iter_mut().zip(&sums) {
            let count = sum.count + PRIOR;
            cell.radiance = (((sum.radiance / mean + PRIOR) / count) as f32).max(DARKEST);
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

    /// Radiance that a path is expected to bring after a scattering at a point, over the mean; positive.
    #[inline]
    pub(crate) fn radiance(&self, p: DVec3) -> f32 {
        self.cells.get(self.index(p)).map_or(1.0, |cell| cell.radiance)
    }

    /// Probability of a shadow ray from a point of a medium: in proportion to what it may bring, over the radiance that its path was expected to bring at its first
    /// scattering. `importance`: of the lights, times the throughput; `without`: the probability without this estimate, in (0, 1].
    #[inline]
    pub(crate) fn survive(&self, p: DVec3, first: f32, importance: f32, without: f32) -> f32 {
        let clear = self.cells.get(self.index(p)).map_or(1.0, |cell| cell.clear);
        let share = importance * self.unshadowed * clear / first;
        // `min` and `max` ignore what is not a number.
        (SHARE * share).max(FLOOR * without).min(1.0)
    }

    /// One path from the camera: the luminance that it brings after scattering, and where it scattered.
    fn walk(
        &self,
        scene: &Scene,
        media: &Overlapping<'_>,
        lights: &Lights,
        max_bounces: u32,
        number: u32,
    ) -> (f32, Vec<Visit>) {
        let [width, height] = scene.camera.resolution();
        // A lattice of rank one covers the picture evenly whatever the number of paths.
        let at = |step: f64, n: u32| (f64::from(number) * step).fract() * f64::from(n);
        let film = [at(0.754_877_666_246_692_7, width), at(0.569_840_290_998_053_3, height)];
        let (origin, direction) = scene.camera.ray(film);
        let mut ray = Ray { origin, direction };
        let mut sampler = PathSampler::new(1, film[0] as u32, film[1] as u32, u64::from(number));
        let mut tally = Tally::default();
        let (mut beta, mut radiance) = (Vec3::ONE, 0.0f32);
        let mut visits: Vec<Visit> = Vec::new();
        loop {
            let mut flown = Flown { beta, null_probability: 1.0 };
            let leg = Leg { ray: &ray, start: None, t_max: f64::INFINITY };
            let others = &mut Together::default();
            let flight = media.flight(leg, None, &mut flown, others, &mut sampler, &mut tally);
            beta = flown.beta;
            let Some(collision) = flight else {
                // Suns and what is bright in an image have been gathered by shadow rays.
                let sky = &scene.environment;
                let gathered = lights.covers_image();
                let light = if gathered { sky.constant } else { sky.radiance(ray.direction) };
                radiance += luminance(beta * light);
                break;
            };
            let p = ray.at(collision.t);
            let (phase, albedo) = media.properties(&collision, p, ray.direction, &mut sampler);
            beta *= albedo;
            let strength = luminance(beta);
            if visits.len() >= max_bounces as usize || !(strength > NEGLIGIBLE) {
                break;
            }
            let at = (p, ray.direction);
            let gathered =
                gather(media, lights, at, phase, &mut sampler, &mut tally).unwrap_or_default();
            radiance += luminance(beta * gathered.scattered);
            visits.push(Visit { cell: self.index(p), before: radiance, beta: strength, gathered });
            let u = [uniform(&mut sampler), uniform(&mut sampler)];
            let (wi, _) = phase.sample(ray.direction, u);
            ray = Ray { origin: p, direction: wi };
        }
        (radiance, visits)
    }
}

/// Light scattered at a point into a path that came along a direction, from one light; `None` if it sends nothing there.
fn gather(
    media: &Overlapping<'_>,
    lights: &Lights,
    (p, direction): (DVec3, Vec3),
    phase: PhaseAt<'_>,
    sampler: &mut PathSampler,
    tally: &mut Tally,
) -> Option<Gathered> {
    /// Walks that have become as dark as this are played roulette.
    const DARK: f32 = 0.1;
    let u = [uniform(sampler), uniform(sampler), uniform(sampler)];
    let choice = lights.choose(p, |_| ISOTROPIC, u[0])?;
    let light = lights.sample(choice.index, p, [u[1], u[2]], sampler)?;
    let ray = Ray { origin: p, direction: light.wi };
    let leg = Leg { ray: &ray, start: None, t_max: light.distance };
    let arrives = media.transmittance(leg, DARK, Vec3::ONE, sampler, tally).transmittance;
    let value = phase.eval(direction, light.wi) / choice.probability;
    Some(Gathered {
        scattered: arrives * light.weight * value,
        transmittance: arrives.max_element(),
        unshadowed: luminance(light.weight) * ISOTROPIC / choice.probability,
    })
}
