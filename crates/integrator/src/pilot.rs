//! A few paths ahead of a render: which rays it will walk, and what a majorant structure would cost on them.
//!
//! The rays hold what no formula knows: how often light scatters where. On a flight the cost of any structure is an integral: the majorants' optical depth is the expected
//! number of tentative collisions, the cells on the way are the steps. Shadow rays, whose roulette ends them, are walked once.

use crate::Error;
use crate::counters::Counters;
use crate::interior::Inside;
use crate::limits::PathLimits;
use crate::media::{Collision, Flown, Leg, Media, MediaIndex, Overlapping, Ray, Shadow, Together};
use crate::path::Kernel;
use crate::plan::{Plan, PlannedMedia};
use crate::sampler::PathSampler;
use crate::settings::RenderSettings;
use crate::world::Whole;
use glam::{DVec3, Vec3};
use pileus_media::transmittance::ratio_tracking_with_roulette;
use pileus_media::{
    MajorantStructure, Medium, PhaseAt, RayField, Relative, StructureCost, Tally,
    TentativeCollisions,
};
use pileus_scene::Scene;
use rand_core::Rng;
use rand_pcg::Pcg32;
use rayon::prelude::*;
use std::sync::{Arc, Mutex};

/// Events after which a path of the pilot is cut: bounds its time, and what the few longer paths
/// cost is underrated.
const MAX_EVENTS: u64 = 1 << 14;

/// A ray that a path walked.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PilotRay {
    origin: DVec3,
    direction: Vec3,
    /// Where the flight ended or the light stands; infinite if nowhere.
    length: f64,
    /// Transmittance below which a shadow walk is played roulette; zero for flights, which are walked whole.
    threshold: f32,
}

/// The rays of some paths of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Pilot {
    paths: u64,
    collisions: u64,
    rays: Vec<PilotRay>,
}

/// Media that remember what they were asked.
struct Recorder<'a> {
    media: Overlapping<'a>,
    rays: Mutex<Vec<PilotRay>>,
}

impl Recorder<'_> {
    fn record(&self, ray: &Ray, length: f64, threshold: f32) {
        let Ray { origin, direction } = *ray;
        // One path per recorder: nobody else holds the lock, and what a panicked holder left is whole.
        let mut rays = self.rays.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        rays.push(PilotRay { origin, direction, length, threshold });
    }
}

impl Media for Recorder<'_> {
    type Nulls = f32;
    type Others = Together;

    fn flight<R: Rng>(
        &self,
        leg: Leg<'_>,
        first: Option<[f32; 2]>,
        flown: &mut Flown<f32>,
        others: &mut Together,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let collision = self.media.flight(leg, first, flown, others, rng, tally);
        self.record(leg.ray, collision.map_or(leg.t_max, |c| c.t), 0.0);
        collision
    }

    fn transmittance<R: Rng>(
        &self,
        leg: Leg<'_>,
        threshold: f32,
        beta: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        self.record(leg.ray, leg.t_max, threshold);
        self.media.transmittance(leg, threshold, beta, rng, tally)
    }

    fn scattering<R: Rng>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
        visit: impl FnMut(Vec3, PhaseAt<'_>),
    ) {
        self.media.scattering(p_world, incoming, rng, visit);
    }

    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)> {
        self.media.extent(ray, t_max)
    }

    fn properties<R: Rng>(
        &self,
        collision: &Collision,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> (PhaseAt<'_>, Vec3) {
        self.media.properties(collision, p_world, incoming, rng)
    }
}

impl Pilot {
    /// Traces `paths` paths over a lattice of pixels, each for some 16,000 events at most. A
    /// function of scene, plan and settings (but for the seed), whatever the number of threads.
    pub fn new(scene: &Scene, plan: &Plan, settings: &RenderSettings, paths: u32) -> Pilot {
        let fires: Vec<_> = scene.fires().cloned().collect();
        let world = Whole { surfaces: scene.surfaces.as_deref(), fires: &fires };
        let [width, height] = scene.camera.resolution();
        let limits = PathLimits::new(settings, &|| false).with_max_events(MAX_EVENTS);
        let traced: Vec<(Vec<PilotRay>, u64)> = (0..paths)
            .into_par_iter()
            .map(|i| {
                let kernel = Kernel {
                    media: Recorder {
                        media: Overlapping {
                            media: &plan.media.media,
                            index: &plan.media.index,
                            methods: plan.methods,
                        },
                        rays: Mutex::new(Vec::new()),
                    },
                    world,
                    lights: &plan.lights.0,
                    environment: &scene.environment,
                    max_bounces: limits.max_bounces(),
                    limits,
                    typical_sigma_t: 1.0,
                    analog_flights: plan.analog_flights,
                    inside: Inside::new(),
                    expected: None,
                };
                // A lattice of rank one covers the picture evenly whatever the number of paths.
                let at = |step: f64, n: u32| (f64::from(i) * step).fract() * f64::from(n);
                let film =
                    [at(0.754_877_666_246_692_7, width), at(0.569_840_290_998_053_3, height)];
                let (origin, direction) = scene.camera.ray(film);
                let mut sampler = PathSampler::new(0, film[0] as u32, film[1] as u32, u64::from(i));
                let [_, _, depth, decision] = sampler.stratified(0);
                let mut counters = Counters::default();
                let ray = Ray { origin, direction };
                let first = [depth, decision];
                kernel.trace::<true, false>(ray, &mut sampler, first, &mut counters);
                let rays = kernel.media.rays.into_inner();
                (rays.unwrap_or_else(std::sync::PoisonError::into_inner), counters.collisions)
            })
            .collect();
        Pilot {
            paths: u64::from(paths),
            collisions: traced.iter().map(|(_, collisions)| collisions).sum(),
            rays: traced.into_iter().flat_map(|(rays, _)| rays).collect(),
        }
    }

    /// Real collisions per path.
    pub fn collisions(&self) -> f64 {
        self.collisions as f64 / self.paths as f64
    }

    /// Expected tentative collisions and steps per path by delta and ratio tracking under a majorant structure.
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
            .map_err(|error| Error::Invalid {
                what: format!("{}: {error}", structure.name()),
                remedy: "take another structure".into(),
            })?;
        let index = Arc::new(MediaIndex::new(&media));
        Ok(self.cost_on(&PlannedMedia { media, index }))
    }

    /// The same for media as they are.
    pub(crate) fn cost_on(&self, planned: &PlannedMedia) -> StructureCost {
        let of_ray = |(number, ray): (usize, &PilotRay)| {
            let PilotRay { origin, direction, .. } = *ray;
            let met = planned.index.along(&Ray { origin, direction }, ray.length);
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

/// Steps and tentative collisions of ray number `number` in one medium: expected ones of a flight, those of one walk of a shadow ray, whose roulette
/// depends on the collisions themselves.
fn walk(medium: &Medium, ray: &PilotRay, number: u64) -> (f64, f64) {
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
        let channels = Relative(medium.chromatic_ratio());
        ratio_tracking_with_roulette(walk, channels, ray.threshold, &mut rng, &mut tally);
        return (tally.majorant_steps as f64, tally.lookups as f64);
    }
    let mut collisions = 0.0;
    while let Some(segment) = field.next_segment() {
        collisions += f64::from(segment.t1 - segment.t0) * f64::from(segment.majorant);
    }
    (field.steps() as f64, collisions)
}
