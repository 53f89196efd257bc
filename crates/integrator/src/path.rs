//! One path: the null-scattering path integral [Miller et al. 2019] by free flights, phase sampling and next-event estimation.
//!
//! Light that a path can only reach one way has weight one: delta lights by shadow rays, the constant part of the environment by escape.
//! What both can reach (the bright part of an environment image, a sun's disc) is weighted by the balance heuristic over the
//! densities of the whole null-scattering path. Both walks share the majorants, so all exponentials cancel: the ratio of the light
//! sampling's density to the path sampling's is `p_light / (p_phase * product of null probabilities)`.
//!
//! Equiangular points near point-like lights [Kulla and Fajardo 2012] are weighted against flights by a density that stands for theirs.

use crate::counters::Counters;
use crate::lights::Lights;
use crate::media::{Flown, Media, Ray};
use crate::sampler::PathSampler;
use glam::{DVec3, Vec3};
use pileus_film::PixelSample;
use pileus_media::distance::Equiangular;
use pileus_media::phase::ISOTROPIC;
use pileus_media::random::uniform;
use pileus_media::{Phase, Tally};
use pileus_scene::Environment;

/// Throughput below which a path is played roulette.
const ROULETTE_THROUGHPUT: f32 = 0.25;

/// A shadow ray is certain if the lights' importance times the throughput is at least this; below it is played roulette. Importance
/// one is what isotropic scattering gives.
const SHADOW_IMPORTANCE: f32 = 1.0;

/// Shadow walks whose product of transmittance and importance falls below this are played roulette.
const SHADOW_ROULETTE: f32 = 0.3;

/// What a kernel is compiled for and what it reads.
pub(crate) struct Kernel<'a, M> {
    pub(crate) media: M,
    pub(crate) lights: &'a Lights,
    pub(crate) environment: &'a Environment,
    pub(crate) max_bounces: u32,
    /// Extinction, 1/length, by which flights are taken to be distributed when they are weighted against equiangular points. Any positive value
    /// is unbiased.
    pub(crate) typical_sigma_t: f64,
}

/// Where the last flight began, for the weights of light it may run into.
struct Vertex {
    p: DVec3,
    phase: Phase,
    /// Propagation direction before the scattering.
    incoming: Vec3,
    /// Density of the direction taken.
    pdf: f32,
}

impl<M: Media> Kernel<'_, M> {
    /// Traces one path. `MIS`: some light can be met both by shadow rays and by paths. `EQUIANGULAR`: points seen by point-like lights at equal
    /// angles are sampled besides flights.
    #[inline(always)]
    pub(crate) fn trace<const MIS: bool, const EQUIANGULAR: bool>(
        &self,
        mut ray: Ray,
        sampler: &mut PathSampler,
        first: f32,
        counters: &mut Counters,
    ) -> PixelSample {
        let mut tally = Tally::default();
        let mut radiance = Vec3::ZERO;
        let mut beta = Vec3::ONE;
        let mut bounces = 0u32;
        let mut first =
            Some(pileus_media::random::exponential_from((first * 4_294_967_296.0) as u32));
        let mut vertex: Option<Vertex> = None;
        loop {
            let part = if EQUIANGULAR { self.media.extent(&ray) } else { None };
            if EQUIANGULAR
                && bounces < self.max_bounces
                && let Some(part) = part
            {
                radiance += self.equiangular(&ray, part, beta, sampler, &mut tally, counters);
            }
            let mut flown = Flown { beta, null_probability: 1.0 };
            let collision = self.media.flight(&ray, first.take(), &mut flown, sampler, &mut tally);
            beta = flown.beta;
            let Some(collision) = collision else {
                radiance +=
                    beta * self.escape::<MIS>(&ray, vertex.as_ref(), flown.null_probability);
                break;
            };
            if bounces >= self.max_bounces {
                counters.cut_by_max_bounces += 1;
                bounces += 1;
                break;
            }
            bounces += 1;
            let p = ray.at(collision.t);
            let (phase, albedo) = self.media.properties(&collision, p);
            beta *= albedo;
            let strongest = beta.max_element();
            if !(strongest > 0.0) {
                break;
            }
            // Stratified numbers for the first scattering only: later ones gain nothing measurable.
            let [u_light, u_shadow, u_phase0, u_phase1] = if bounces == 1 {
                sampler.stratified(1)
            } else {
                [uniform(sampler), uniform(sampler), uniform(sampler), uniform(sampler)]
            };
            if !self.lights.is_empty() {
                let flight = Flight { ray: &ray, part, t: collision.t };
                let shadow =
                    Shading { p, direction: ray.direction, phase, beta, strongest, flight };
                radiance += self.next_event::<MIS, EQUIANGULAR>(
                    &shadow,
                    [u_light, u_shadow],
                    sampler,
                    &mut tally,
                    counters,
                );
            }
            if strongest < ROULETTE_THROUGHPUT {
                let survive = strongest / ROULETTE_THROUGHPUT;
                if uniform(sampler) >= survive {
                    break;
                }
                beta /= survive;
            }
            let (wi, pdf) = phase.sample(ray.direction, [u_phase0, u_phase1]);
            if MIS {
                vertex = Some(Vertex { p, phase, incoming: ray.direction, pdf });
            }
            ray = Ray { origin: p, direction: wi };
        }
        counters.paths += 1;
        counters.bounces += u64::from(bounces);
        counters.add_tally(&tally);
        let alpha = if bounces > 0 { 1.0 } else { 0.0 };
        PixelSample { rgb: radiance.to_array(), alpha }
    }

    /// Radiance from infinity along an escaping ray, weighted against shadow rays where they cover it.
    #[inline(always)]
    fn escape<const MIS: bool>(
        &self,
        ray: &Ray,
        vertex: Option<&Vertex>,
        null_probability: f32,
    ) -> Vec3 {
        if !MIS {
            return self.environment.radiance(ray.direction);
        }
        let mut radiance = self.environment.constant;
        if !self.lights.covers_image() {
            radiance = self.environment.radiance(ray.direction);
        }
        self.lights.met_at_infinity(ray.direction, |light, sampled| {
            let weight = match (vertex, sampled) {
                (Some(vertex), Some((index, pdf))) => {
                    let phase = |wi: Vec3| vertex.phase.eval(vertex.incoming.dot(wi));
                    let pdf_light = pdf * self.lights.probability(index, vertex.p, phase);
                    let pdf_path = vertex.pdf * null_probability;
                    if pdf_light > 0.0 { pdf_path / (pdf_path + pdf_light) } else { 1.0 }
                }
                // Seen directly, or never sent a shadow ray.
                _ => 1.0,
            };
            radiance += light * weight;
        });
        radiance
    }

    /// Radiance scattered at a vertex from one light, by a shadow ray.
    #[inline(always)]
    fn next_event<const MIS: bool, const EQUIANGULAR: bool>(
        &self,
        at: &Shading<'_>,
        u: [f32; 2],
        sampler: &mut PathSampler,
        tally: &mut Tally,
        counters: &mut Counters,
    ) -> Vec3 {
        let phase = |wi: Vec3| at.phase.eval(at.direction.dot(wi));
        let Some(choice) = self.lights.choose(at.p, phase, u[0]) else {
            return Vec3::ZERO;
        };
        let direction = if MIS || self.lights.len() > 1 {
            [uniform(sampler), uniform(sampler)]
        } else {
            [0.0; 2]
        };
        let Some(light) = self.lights.sample(choice.index, at.p, direction) else {
            return Vec3::ZERO;
        };
        let value = phase(light.wi);
        // The choice could not know where in an image the sample would lie; now it is known.
        let aimed = if light.everywhere { value / ISOTROPIC } else { 1.0 };
        let importance = choice.importance * at.strongest * aimed;
        let survive = (importance / SHADOW_IMPORTANCE).min(1.0);
        if survive < 1.0 && u[1] >= survive {
            return Vec3::ZERO;
        }
        counters.shadow_rays += 1;
        let ray = Ray { origin: at.p, direction: light.wi };
        let threshold = (SHADOW_ROULETTE / (importance / survive)).min(0.5);
        let shadow = self.media.transmittance(&ray, light.distance, threshold, sampler, tally);
        let mut weight = value / (choice.probability * survive);
        if MIS && light.pdf > 0.0 {
            // Density of the same path under path sampling: its null decisions are weighted by the throughput of their channels.
            let nulls = at.beta.dot(shadow.null_probability) / at.beta.element_sum();
            let pdf_light = light.pdf * choice.probability;
            weight *= pdf_light / (pdf_light + value * nulls);
        }
        if EQUIANGULAR
            && let Some(position) = self.lights.position(choice.index)
            && let Some(part) = at.flight.part
        {
            weight *=
                1.0 - self.equiangular_weight(at.flight.ray, part, position, at.flight.t) as f32;
        }
        at.beta * shadow.transmittance * light.weight * weight
    }
}

impl<M: Media> Kernel<'_, M> {
    /// Weight of an equiangular point at `t` against a flight that ends there: the balance heuristic between the density of the points and that
    /// of flights in a medium of typical extinction. A function of ray, light and `t` alone, the same for both techniques: whatever it is, the
    /// sum of both is unbiased.
    fn equiangular_weight(&self, ray: &Ray, part: (f64, f64), light: DVec3, t: f64) -> f64 {
        let Some(points) = Equiangular::new(ray.origin, ray.direction, light, part) else {
            return 0.0;
        };
        let share = points.received() / self.received_from_all(ray, part);
        let pdf = share * points.pdf(t);
        let flights = self.typical_sigma_t * (-self.typical_sigma_t * (t - part.0)).exp();
        if pdf > 0.0 { pdf / (pdf + flights) } else { 0.0 }
    }

    /// Sum over the point-like lights of what a part of a ray receives: a light is chosen in proportion.
    fn received_from_all(&self, ray: &Ray, part: (f64, f64)) -> f64 {
        self.lights
            .positions()
            .filter_map(|(_, light)| Equiangular::new(ray.origin, ray.direction, light, part))
            .map(|points| points.received())
            .sum()
    }

    /// Radiance scattered into a ray from one point-like light at one point seen from it at equal angles, with its weight against flights.
    #[inline(never)]
    fn equiangular(
        &self,
        ray: &Ray,
        part: (f64, f64),
        beta: Vec3,
        sampler: &mut PathSampler,
        tally: &mut Tally,
        counters: &mut Counters,
    ) -> Vec3 {
        let total = self.received_from_all(ray, part);
        let mut u = f64::from(uniform(sampler)) * total;
        let mut chosen = None;
        for (index, light) in self.lights.positions() {
            if let Some(points) = Equiangular::new(ray.origin, ray.direction, light, part) {
                chosen = Some((index, light, points));
                if u < points.received() {
                    break;
                }
                u -= points.received();
            }
        }
        let (t, Some((index, light, points))) = (uniform(sampler), chosen) else {
            return Vec3::ZERO;
        };
        let t = points.sample(t);
        let weight = self.equiangular_weight(ray, part, light, t);
        let pdf = points.received() / total * points.pdf(t);
        let p = ray.at(t);
        let Some(sample) = self.lights.sample(index, p, [0.0; 2]) else {
            return Vec3::ZERO;
        };
        let mut scattered = Vec3::ZERO;
        self.media.scattering(p, |sigma_s, phase| {
            scattered += sigma_s * phase.eval(ray.direction.dot(sample.wi));
        });
        tally.lookups += 1;
        let unshadowed = beta * scattered * sample.weight * (weight / pdf) as f32;
        if !(unshadowed.max_element() > 0.0) {
            return Vec3::ZERO;
        }
        counters.shadow_rays += 1;
        let there = self.media.transmittance(ray, t, SHADOW_ROULETTE, sampler, tally);
        if there.transmittance == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let to_light = Ray { origin: p, direction: sample.wi };
        let on =
            self.media.transmittance(&to_light, sample.distance, SHADOW_ROULETTE, sampler, tally);
        unshadowed * there.transmittance * on.transmittance
    }
}

/// How a vertex was reached.
struct Flight<'a> {
    ray: &'a Ray,
    /// Of the ray, what equiangular points cover.
    part: Option<(f64, f64)>,
    t: f64,
}

/// A vertex at which light is gathered.
struct Shading<'a> {
    p: DVec3,
    /// Propagation direction of the path that arrives.
    direction: Vec3,
    phase: Phase,
    /// Throughput, with the albedo of this vertex.
    beta: Vec3,
    strongest: f32,
    flight: Flight<'a>,
}
