//! Which rays a render will walk, and what a majorant structure would cost on them.
//!
//! The rays hold what no formula knows: how often light scatters where. On a flight the cost of any
//! structure is an integral: the majorants' optical depth is the expected number of tentative
//! collisions, the cells on the way are the steps. Shadow rays, whose roulette ends them, are
//! walked once.

use super::lattice;
use crate::camera_ray::camera_ray;
use crate::cost::PathCost;
use crate::counters::Counters;
use crate::dispatch::{Job, Parts, PlannedMedia};
use crate::error::{Error, Parameter, Remedy};
use crate::kernel::{Kernel, Recorder, World};
use crate::media::{Media, MediaIndex, MetMedia, Ray};
use crate::renderer::Renderer;
use crate::sampler::PathSampler;
use glam::{DVec3, Vec3};
use pileus_media::majorant::{MajorantStructure, StructureCost};
use pileus_media::transmittance::ratio_tracking_with_roulette;
use pileus_media::{ChromaticRatio, Medium, RayField, Tally, TentativeCollisions};
use pileus_scene::Scene;
use rand_pcg::Pcg32;
use rayon::prelude::*;
use std::sync::Arc;

/// Events after which a path is cut: bounds the time, and what the few longer paths cost is
/// underrated.
const MAX_EVENTS: u64 = 1 << 14;

/// A ray that a path walked.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RecordedRay {
    origin: DVec3,
    direction: Vec3,
    /// Where the flight ended or the light stands; infinite if nowhere.
    length: f64,
    /// Transmittance below which a shadow walk undergoes Russian roulette; zero for flights, which
    /// are walked whole.
    threshold: f32,
}

/// The rays of some paths of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedRays {
    paths: u64,
    collisions: u64,
    rays: Vec<RecordedRay>,
}

/// Remembers the rays of a path.
#[derive(Default)]
struct RayRecorder {
    counters: Counters,
    rays: Vec<RecordedRay>,
}

impl RayRecorder {
    fn record(&mut self, ray: &Ray, length: f64, threshold: f32) {
        let Ray { origin, direction } = *ray;
        self.rays.push(RecordedRay { origin, direction, length, threshold });
    }
}

impl Recorder for RayRecorder {
    fn counters(&mut self) -> &mut Counters {
        &mut self.counters
    }

    fn flight(&mut self, ray: &Ray, length: f64) {
        self.record(ray, length, 0.0);
    }

    fn shadow_ray(&mut self, ray: &Ray, length: f64, threshold: f32) {
        self.record(ray, length, threshold);
    }
}

/// Paths over a lattice of pixels, each heard by a recorder of its own.
struct Paths<'a> {
    scene: &'a Scene,
    paths: u32,
}

impl Job for Paths<'_> {
    type Output = Vec<RayRecorder>;

    fn run<M: Media, W: World>(&mut self, kernel: &Kernel<'_, M, W>) -> Vec<RayRecorder> {
        let trace = |number: u32| {
            let film = lattice(self.scene.camera.resolution(), number);
            let pixel = film.map(|x| x as u32);
            let mut sampler = PathSampler::new(0, pixel[0], pixel[1], u64::from(number));
            let [_, _, depth, decision] = sampler.stratified(0);
            let mut recorder = RayRecorder::default();
            let ray = camera_ray(&self.scene.camera, film, &sampler);
            kernel.trace(ray, [depth, decision], &mut sampler, &mut recorder);
            recorder
        };
        (0..self.paths).into_par_iter().map(trace).collect()
    }
}

fn record(parts: &Parts<'_>, paths: u32) -> Vec<RayRecorder> {
    let limits = parts.limits.with_max_events(MAX_EVENTS);
    let parts = Parts { limits, ..*parts };
    parts.with_general_kernel(&mut Paths { scene: parts.scene, paths })
}

/// Cost per path, by `paths` paths, and whether any has met a medium. A function of scene, plan and
/// settings (but for the seed), whatever the number of threads.
pub(super) fn predict(parts: &Parts<'_>, paths: u32) -> (PathCost, bool) {
    let mut counters = Counters::default();
    for recorder in record(parts, paths) {
        counters.merge(&recorder.counters);
    }
    let per_path = |n: u64| n as f64 / f64::from(paths.max(1));
    let Counters { lookups, majorant_steps, collisions, .. } = counters;
    let cost = PathCost::new(per_path(lookups), per_path(majorant_steps), per_path(collisions));
    (cost, majorant_steps > 0)
}

impl RecordedRays {
    /// Traces `paths` paths over a lattice of pixels, each for some 16,000 events at most. A
    /// function of the renderer's scene, plan and settings (but for the seed), whatever the number
    /// of threads.
    pub fn new(renderer: &Renderer<'_>, paths: u32) -> RecordedRays {
        let traced = renderer.with_parts(|parts| record(parts, paths));
        RecordedRays {
            paths: u64::from(paths),
            collisions: traced.iter().map(|recorder| recorder.counters.collisions).sum(),
            rays: traced.into_iter().flat_map(|recorder| recorder.rays).collect(),
        }
    }

    /// Real collisions per path.
    pub fn collisions(&self) -> f64 {
        self.collisions as f64 / self.paths as f64
    }

    /// Expected tentative collisions and steps per path by delta and ratio tracking under a
    /// majorant structure.
    ///
    /// # Errors
    /// If a medium cannot have that structure.
    pub fn cost(
        &self,
        scene: &Scene,
        structure: MajorantStructure,
        majorant_scale: f32,
    ) -> Result<StructureCost, Error> {
        let media: Vec<Arc<Medium>> = scene
            .volumes
            .iter()
            .map(|volume| volume.medium.with_majorants(structure, majorant_scale).map(Arc::new))
            .collect::<Result<_, _>>()
            .map_err(|error| Error::Parameter {
                parameter: Parameter::Majorants,
                value: structure.name(),
                why: error.to_string(),
                remedies: vec![Remedy::Default(&[Parameter::Majorants])],
            })?;
        let index = MediaIndex::new(&media);
        Ok(self.cost_on(&PlannedMedia { media, index }))
    }

    fn cost_on(&self, planned: &PlannedMedia) -> StructureCost {
        let of_ray = |(number, ray): (usize, &RecordedRay)| {
            let RecordedRay { origin, direction, .. } = *ray;
            let mut found = MetMedia::new();
            let met = planned.index.along(&Ray { origin, direction }, ray.length, &mut found);
            let walk = |i: u32| walk(&planned.media[i as usize], ray, number as u64);
            met.iter().fold((0.0, 0.0), |sum, &i| add(sum, walk(i)))
        };
        let sums: Vec<(f64, f64)> =
            self.rays.par_iter().enumerate().with_min_len(64).map(of_ray).collect();
        let (steps, collisions) = sums.into_iter().fold((0.0, 0.0), add);
        let paths = self.paths as f64;
        StructureCost { steps: steps / paths, collisions: collisions / paths }
    }
}

fn add(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 + b.0, a.1 + b.1)
}

/// Steps and tentative collisions of ray number `number` in one medium: expected ones of a flight,
/// those of one walk of a shadow ray, whose roulette depends on the collisions themselves.
fn walk(medium: &Medium, ray: &RecordedRay, number: u64) -> (f64, f64) {
    if medium.grid().is_none() {
        // Homogeneous media: real collisions alone, shadow rays in closed form.
        return (0.0, 0.0);
    }
    let Some(span) = medium.span(ray.origin, ray.direction, ray.length) else {
        return (0.0, 0.0);
    };
    let mut field = medium.any_ray(&span, 1.0);
    if ray.threshold > 0.0 {
        let mut rng = Pcg32::new(number, 0x9b1);
        let (walk, mut tally) = (TentativeCollisions::new(field), Tally::default());
        let channels = ChromaticRatio(medium.chromatic_ratio());
        ratio_tracking_with_roulette(walk, channels, ray.threshold, &mut rng, &mut tally);
        return (tally.majorant_steps as f64, tally.lookups as f64);
    }
    let mut collisions = 0.0;
    while let Some(segment) = field.next_segment() {
        collisions += f64::from(segment.t1 - segment.t0) * f64::from(segment.majorant);
    }
    (field.steps() as f64, collisions)
}
