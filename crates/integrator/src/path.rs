//! One path: the null-scattering path integral [Miller et al. 2019] by free flights, phase sampling and next-event estimation.
//!
//! Light that a path can only reach one way has weight one: delta lights by shadow rays, the constant part of the environment by escape.
//! What both can reach (the bright part of an environment image, a sun's disc, emissive triangles) is weighted by the balance heuristic over the
//! densities of the whole null-scattering path. Both walks share the majorants, so all exponentials cancel: the ratio of the light
//! sampling's density to the path sampling's is `p_light / (p_phase * product of null probabilities)`.
//!
//! Fires draw paths to themselves: a share of the directions is drawn by what a vertex sees of them, and all along each flight is collected, by the one density of the mixture.
//!
//! Surfaces are events along the ray, taken in order with the collisions. What a scene does not have is compiled out: see [`World`].
//!
//! Where channels part ([`Media::PARTS`]), a path is a tree of three branches at most: each channel is on one of them at any time.
//!
//! Equiangular points near point-like lights [Kulla and Fajardo 2012] are weighted against flights by a density that stands for theirs.

use crate::counters::Counters;
use crate::expected::Expected;
use crate::interior::{self, Inside};
use crate::lights::{Guide, Lights};
use crate::media::{Ending, Flown, Leg, Media, Ray, Start};
use crate::sampler::PathSampler;
use crate::world::{InMedium, Vertex, World, luminance};
use glam::{DVec3, Vec3};
use pileus_film::PixelSample;
use pileus_media::distance::Equiangular;
use pileus_media::phase::ISOTROPIC;
use pileus_media::random::uniform;
use pileus_media::{PhaseAt, Spectrum, Tally};
use pileus_scene::{Bsdf, Environment, Hit, Interaction};
use smallvec::SmallVec;

/// Throughput below which a path is played roulette.
const ROULETTE_THROUGHPUT: f32 = 0.25;

/// Bounces after which paths are played roulette at surfaces whatever their throughput.
const LONG_PATH: u32 = 64;

/// With this probability of going on.
const LONG_PATH_SURVIVAL: f32 = 0.95;

/// A shadow ray is certain if the lights' importance times the throughput is at least this; below it is played roulette. Importance
/// one is what isotropic scattering gives.
const SHADOW_IMPORTANCE: f32 = 1.0;

/// Shadow walks whose product of transmittance and importance falls below this are played roulette.
const SHADOW_ROULETTE: f32 = 0.3;

/// Distance of the points of a fire on flights after the first, over that on the first: what is seen directly is worth more of them.
const SPACING: f32 = 2.0;

/// Paths whose throughput has grown beyond this by directions drawn by fires are drawn no more, so that the weights of long paths stay bounded: at surfaces, and in media, where there are many.
const MOST_DRAWN_AT_SURFACES: f32 = 5.0;
const MOST_DRAWN_IN_MEDIA: f32 = 1.5;

/// What a kernel is compiled for and what it reads.
pub(crate) struct Kernel<'a, M, W> {
    pub(crate) media: M,
    pub(crate) world: W,
    pub(crate) lights: &'a Lights,
    pub(crate) environment: &'a Environment,
    pub(crate) max_bounces: u32,
    /// Extinction, 1/length, by which flights are taken to be distributed when they are weighted against equiangular points. Any positive value
    /// is unbiased.
    pub(crate) typical_sigma_t: f64,
    /// Whether flights end with the density of the medium and carry no weight, so that fire up to there may be counted as it is.
    pub(crate) analog_flights: bool,
    /// The bodies that the camera is in.
    pub(crate) inside: Inside,
    /// What shadow rays may bring, where the plan has asked a pilot.
    pub(crate) expected: Option<&'a Expected>,
}

/// Where the last flight began, for the weights of light it may run into.
#[derive(Clone, Copy)]
struct Last<V> {
    p: DVec3,
    vertex: V,
    /// Density of the direction taken; zero if no other could have been.
    pdf: f32,
}

/// A path from the end of a flight on, for channels that have left the others.
struct Branch<V, N> {
    ray: Ray,
    /// Throughput before the flight.
    beta: Vec3,
    /// How the flight ended; none: it has not been flown.
    ending: Option<Ending<N>>,
    last: Option<Last<V>>,
    bounces: u32,
}

/// Branches that wait.
type Branches<'k, M, W> = SmallVec<[Branch<<W as World>::Vertex<'k>, <M as Media>::Nulls>; 2]>;

/// How a flight ended.
enum Event<'a> {
    Collision { t: f64, phase: PhaseAt<'a>, albedo: Vec3 },
    Surface(Hit),
    Escape,
}

impl<M: Media, W: World> Kernel<'_, M, W> {
    /// Traces one path. `MIS`: some light can be met both by shadow rays and by paths. `EQUIANGULAR`: points seen by point-like lights at equal
    /// angles are sampled besides flights.
    #[inline(always)]
    pub(crate) fn trace<const MIS: bool, const EQUIANGULAR: bool>(
        &self,
        ray: Ray,
        sampler: &mut PathSampler,
        [depth, decision]: [f32; 2],
        counters: &mut Counters,
    ) -> PixelSample {
        let mut pixel = PixelSample { rgb: [0.0; 3], alpha: 0.0 };
        let mut radiance = Vec3::ZERO;
        let depth = pileus_media::random::exponential_from((depth * 4_294_967_296.0) as u32);
        let first = Some([depth, decision]);
        let mut branches = Branches::<'_, M, W>::new();
        let mut branch = Branch { ray, beta: Vec3::ONE, ending: None, last: None, bounces: 0 };
        loop {
            let first = if branch.ending.is_none() { first } else { None };
            let (light, alpha) =
                self.follow::<MIS, EQUIANGULAR>(branch, first, &mut branches, sampler, counters);
            radiance += light;
            pixel.alpha += alpha;
            match branches.pop() {
                Some(next) if M::PARTS => branch = next,
                _ => break,
            }
        }
        counters.paths += 1;
        pixel.rgb = radiance.to_array();
        pixel
    }

    /// Follows one branch of a path to its end; what parts from it joins `branches`. Returns its light, and the share of the channels that met something on it.
    #[inline(always)]
    fn follow<'k, const MIS: bool, const EQUIANGULAR: bool>(
        &'k self,
        branch: Branch<W::Vertex<'k>, M::Nulls>,
        mut first: Option<[f32; 2]>,
        branches: &mut Branches<'k, M, W>,
        sampler: &mut PathSampler,
        counters: &mut Counters,
    ) -> (Vec3, f32) {
        let Branch { mut ray, mut beta, ending: mut resumed, mut last, mut bounces } = branch;
        let begun = bounces;
        let mut tally = Tally::default();
        let mut radiance = Vec3::ZERO;
        let mut alpha = 0.0;
        // Of the channels, those whose first flight ends on this branch.
        let mut share = if begun == 0 { 1.0 } else { 0.0 };
        let mut inside = if W::WHOLE { self.inside.clone() } else { Inside::new() };
        // Radiance expected after the first scattering.
        let mut expected_first = 1.0;
        // What directions drawn by fires have put on the throughput.
        let mut drawn = 1.0f32;
        let mut start: Start = None;
        // Of faces that coincide, the one after the one that the path has left.
        let mut layer: Option<Hit> = None;
        loop {
            let hit = layer.take().or_else(|| self.world.intersect(&ray, sampler));
            if W::WHOLE && hit.is_none() {
                // Bodies end at their surface: a ray that meets none is in none, whatever holes it came through.
                inside.clear();
            }
            let t_surface = hit.as_ref().map_or(f64::INFINITY, |hit| hit.t);
            // Equal angles ignore what fills a body: inside one, flights do alone.
            let part = if EQUIANGULAR && inside.is_empty() {
                self.media.extent(&ray, t_surface)
            } else {
                None
            };
            if EQUIANGULAR
                && resumed.is_none()
                && bounces < self.max_bounces
                && let Some(part) = part
            {
                radiance += self.equiangular(&ray, part, beta, sampler, &mut tally, counters);
            }
            let before = beta;
            let mut flown = Flown { beta, null_probability: M::Nulls::ONE };
            let collision = if M::PARTS
                && let Some(ending) = resumed.take()
            {
                let Ending { channels, null_probability, collision } = ending;
                flown = Flown { beta: beta * channels, null_probability };
                collision
            } else {
                let first = first.take();
                let (flown, tally) = (&mut flown, &mut tally);
                let mut others = M::Others::default();
                let leg = Leg { ray: &ray, start, t_max: t_surface };
                let collision = self.media.flight(leg, first, flown, &mut others, sampler, tally);
                if M::PARTS {
                    branches.extend(others.into_iter().map(|ending| Branch {
                        ray,
                        beta,
                        ending: Some(ending),
                        last,
                        bounces,
                    }));
                }
                collision
            };
            beta = flown.beta;
            if M::PARTS && bounces == 0 {
                share = beta.cmpgt(Vec3::ZERO).bitmask().count_ones() as f32 / 3.0;
            }
            let mut scattered_by =
                if M::LAWS { collision.as_ref().map(|collision| collision.medium) } else { None };
            let mut event = match (&collision, hit) {
                (Some(collision), _) => {
                    let (phase, albedo) = self.media.properties(
                        collision,
                        ray.at(collision.t),
                        ray.direction,
                        sampler,
                    );
                    Event::Collision { t: collision.t, phase, albedo }
                }
                (None, Some(hit)) => Event::Surface(hit),
                (None, None) => Event::Escape,
            };
            if W::WHOLE {
                if let Some(body) = inside.last() {
                    let t_end = collision.as_ref().map_or(t_surface, |collision| collision.t);
                    if let Some(t) = interior::fly(body, t_end, &mut beta, sampler) {
                        let phase = PhaseAt::henyey_greenstein(body.g);
                        event = Event::Collision { t, phase, albedo: Vec3::ONE };
                        scattered_by = None;
                    }
                }
                let t_end = match &event {
                    Event::Collision { t, .. } => *t,
                    _ => t_surface,
                };
                let spacing = if bounces == 0 { 1.0 } else { SPACING };
                let flight = (Leg { ray: &ray, start, t_max: t_surface }, t_end);
                let fire = (before, spacing);
                radiance += self.glow(flight, fire, &inside, sampler, &mut tally);
            }
            let (p, vertex, turn) = match event {
                Event::Escape => {
                    radiance +=
                        beta * self.escape::<MIS>(&ray, last.as_ref(), flown.null_probability);
                    break;
                }
                Event::Collision { t, phase, albedo } => {
                    if bounces >= self.max_bounces {
                        counters.cut_by_max_bounces += 1;
                        bounces += 1;
                        break;
                    }
                    bounces += 1;
                    beta *= albedo;
                    let vertex = InMedium { phase, incoming: ray.direction };
                    (ray.at(t), W::in_medium(vertex), Turn::Medium(phase))
                }
                Event::Surface(hit) => {
                    alpha = share;
                    let Some(surfaces) = self.world.surfaces() else { break };
                    let interaction = surfaces.interaction(&hit, ray.direction);
                    if interaction.emission != Vec3::ZERO {
                        let met = (hit.t, interaction.emitter, interaction.geometric_normal);
                        let weight =
                            self.weight_of_lamp(&ray, met, last.as_ref(), flown.null_probability);
                        radiance += beta * interaction.emission * weight;
                    }
                    if bounces >= self.max_bounces {
                        counters.cut_by_max_bounces += 1;
                        bounces += 1;
                        break;
                    }
                    bounces += 1;
                    let wo = -ray.direction;
                    let side = if interaction.front_face { 1.0 } else { -1.0 };
                    let bsdf = Bsdf::new(
                        &interaction.parameters,
                        interaction.shading_normal * side,
                        interaction.geometric_normal * side,
                        interaction.front_face,
                    );
                    let p = interaction.p;
                    let Some(vertex) = W::at_surface(bsdf, wo, interaction) else { break };
                    (p, vertex, Turn::Surface(bsdf, interaction))
                }
            };
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
            let (scatters, in_medium) = match &turn {
                Turn::Medium(_) => (true, true),
                Turn::Surface(bsdf, _) => (!bsdf.is_delta(), false),
            };
            let most_drawn = if in_medium { MOST_DRAWN_IN_MEDIA } else { MOST_DRAWN_AT_SURFACES };
            let guide = if W::WHOLE && scatters && drawn <= most_drawn {
                self.lights.guide(p, in_medium, luminance(self.environment.constant))
            } else {
                None
            };
            if scatters && !self.lights.is_empty() {
                if !W::WHOLE
                    && bounces == 1
                    && let Some(expected) = self.expected
                {
                    expected_first = expected.radiance(p);
                }
                let flight = Flight { ray: &ray, part, in_medium, expected_first };
                let shading = Shading {
                    p,
                    vertex: &vertex,
                    beta,
                    strongest,
                    inside: &inside,
                    start: scattered_by,
                    flight,
                    guide: guide.as_ref(),
                };
                radiance += self.next_event::<MIS, EQUIANGULAR>(
                    &shading,
                    [u_light, u_shadow],
                    sampler,
                    &mut tally,
                    counters,
                );
            }
            // Light that smooth glass reflects for ever loses nothing: long paths end by chance at surfaces, never in media, which let go of theirs.
            let trapped = W::WHOLE && !in_medium && bounces > LONG_PATH;
            // How much light a direction drawn by a fire stands for says nothing of how much the path may still find.
            let strongest = if W::WHOLE { strongest / drawn } else { strongest };
            if strongest < ROULETTE_THROUGHPUT || trapped {
                let survive = strongest / ROULETTE_THROUGHPUT;
                let survive = if trapped { survive.min(LONG_PATH_SURVIVAL) } else { survive };
                if uniform(sampler) >= survive {
                    break;
                }
                beta /= survive;
            }
            let by_fire = guide.as_ref().filter(|guide| uniform(sampler) < guide.share);
            let (wi, own) = if let Some(guide) = by_fire {
                let u = if bounces == 1 {
                    sampler.stratified(2)
                } else {
                    [u_phase0, u_phase1, uniform(sampler), uniform(sampler)]
                };
                let u = [u[0], uniform(sampler), u[1], u[2]];
                let Some(wi) = self.lights.fires().sample(guide, u) else { break };
                let (value, _, own) = vertex.eval(wi);
                if !(own > 0.0) {
                    break;
                }
                beta *= value / own;
                if let Turn::Surface(_, interaction) = &turn
                    && wi.dot(interaction.geometric_normal)
                        * ray.direction.dot(interaction.geometric_normal)
                        > 0.0
                {
                    pass_through(&mut inside, interaction);
                }
                (wi, own)
            } else {
                match &turn {
                    Turn::Medium(phase) => phase.sample(ray.direction, [u_phase0, u_phase1]),
                    Turn::Surface(bsdf, interaction) => {
                        let u = [u_phase0, u_phase1, uniform(sampler)];
                        let Some(sample) = bsdf.sample(-ray.direction, u) else { break };
                        beta *= sample.weight;
                        if sample.transmitted {
                            pass_through(&mut inside, interaction);
                        }
                        (sample.wi, sample.pdf)
                    }
                }
            };
            let mut pdf = own;
            if let Some(guide) = &guide {
                // A direction without density, as smooth glass has, is none of the fires'.
                let weight = if own > 0.0 {
                    pdf = self.lights.fires().pdf(guide, wi, own);
                    own / pdf
                } else {
                    1.0 / (1.0 - guide.share)
                };
                beta *= weight;
                drawn *= weight;
            }
            let origin = vertex.origin(p, wi);
            if W::WHOLE
                && let Some(surface) = vertex.surface()
            {
                layer = self.world.next_layer(surface, wi, sampler);
            }
            if MIS {
                last = Some(Last { p, vertex, pdf });
            }
            ray = Ray { origin, direction: wi };
            start = scattered_by;
        }
        counters.bounces += u64::from(bounces - begun);
        counters.add_tally(&tally);
        if bounces > 0 {
            alpha = share;
        }
        (radiance, alpha)
    }

    /// Radiance from infinity along an escaping ray, weighted against shadow rays where they cover it.
    #[inline(always)]
    fn escape<const MIS: bool>(
        &self,
        ray: &Ray,
        last: Option<&Last<W::Vertex<'_>>>,
        null_probability: M::Nulls,
    ) -> Vec3 {
        if !MIS {
            return self.environment.radiance(ray.direction);
        }
        let mut radiance = self.environment.constant;
        if !self.lights.covers_image() {
            radiance = self.environment.radiance(ray.direction);
        }
        self.lights.met_at_infinity(ray.direction, |light, sampled| {
            let weight = match (last, sampled) {
                (Some(last), Some((index, pdf))) => {
                    let pdf_light = pdf * self.probability(index, last);
                    weights_of_path(null_probability, last.pdf, pdf_light)
                }
                // Seen directly, or never sent a shadow ray.
                _ => Vec3::ONE,
            };
            radiance += light * weight;
        });
        radiance
    }

    /// Probability with which a shadow ray from a vertex is sent to light `index`.
    #[inline(always)]
    fn probability(&self, index: usize, last: &Last<W::Vertex<'_>>) -> f32 {
        self.lights.probability(index, last.p, |wi| last.vertex.eval(wi).1)
    }

    /// Weight of an emissive triangle that a path has run into: distance, number and normal.
    #[inline]
    fn weight_of_lamp(
        &self,
        ray: &Ray,
        (t, emitter, normal): (f64, Option<u32>, Vec3),
        last: Option<&Last<W::Vertex<'_>>>,
        null_probability: M::Nulls,
    ) -> Vec3 {
        let (Some(last), Some(emitter)) = (last, emitter) else { return Vec3::ONE };
        let Some((index, pdf)) =
            self.lights.met_lamp(emitter, last.p, t, normal.dot(ray.direction))
        else {
            return Vec3::ONE;
        };
        let pdf_light = pdf * self.probability(index, last);
        weights_of_path(null_probability, last.pdf, pdf_light)
    }

    /// Light of fires along a flight that ends at `t_end` (and would have ended at `t_surface` at last).
    ///
    /// Points of a fire lie at equal steps, `spacing`, of a rate that bounds its strength. Where flights end with the medium's own density and without weights, the points up
    /// to the end are counted as they are: a flight survives to each with the transmittance. Else one of all points is drawn, and the transmittance to it
    /// estimated.
    #[inline(never)]
    fn glow(
        &self,
        (leg, t_end): (Leg<'_>, f64),
        (beta, spacing): (Vec3, f32),
        inside: &Inside,
        sampler: &mut PathSampler,
        tally: &mut Tally,
    ) -> Vec3 {
        let mut radiance = Vec3::ZERO;
        // One of all points by weighted reservoir sampling, for flights with weights.
        let (mut total, mut chosen) = (0.0f32, None);
        let analog = self.analog_flights && inside.is_empty();
        for fire in self.world.fires() {
            let to = if analog { t_end } else { leg.t_max };
            let u = uniform(sampler);
            fire.sparse_points(
                leg.ray.origin,
                leg.ray.direction,
                to,
                (u, spacing),
                tally,
                |point| {
                    let light = point.contribution;
                    if analog {
                        radiance += light;
                        return;
                    }
                    let strength = luminance(light);
                    if strength > 0.0 {
                        total += strength;
                        if uniform(sampler) * total < strength {
                            chosen = Some((point.t, light / strength));
                        }
                    }
                },
            );
        }
        if let Some((t, light)) = chosen {
            let leg = Leg { t_max: t, ..leg };
            let shadow = self.media.transmittance(leg, SHADOW_ROULETTE, beta, sampler, tally);
            let body = inside.last().map_or(Vec3::ONE, |body| interior::transmittance(body, t));
            radiance += light * total * shadow.transmittance * body;
        }
        beta * radiance
    }

    /// Radiance scattered at a vertex from one light, by a shadow ray.
    #[inline(always)]
    fn next_event<const MIS: bool, const EQUIANGULAR: bool>(
        &self,
        at: &Shading<'_, W::Vertex<'_>>,
        u: [f32; 2],
        sampler: &mut PathSampler,
        tally: &mut Tally,
        counters: &mut Counters,
    ) -> Vec3 {
        let Some(choice) = self.lights.choose(at.p, |wi| at.vertex.eval(wi).1, u[0]) else {
            return Vec3::ZERO;
        };
        let direction = if MIS || self.lights.len() > 1 || self.lights.many_positions() {
            [uniform(sampler), uniform(sampler)]
        } else {
            [0.0; 2]
        };
        let Some(light) = self.lights.sample(choice.index, at.p, direction, sampler) else {
            return Vec3::ZERO;
        };
        let (value, size, own) = at.vertex.eval(light.wi);
        // The choice could not know where in an image the sample would lie; now it is known.
        let aimed = if light.everywhere { size / ISOTROPIC } else { 1.0 };
        let importance = choice.importance * at.strongest * aimed;
        // What a surface sends on is as dark as its albedo: noise is judged by that, not by absolute light.
        let importance =
            if at.flight.in_medium { importance } else { importance.max(at.strongest) };
        let mut survive = (importance / SHADOW_IMPORTANCE).min(1.0);
        if !W::WHOLE
            && let Some(expected) = self.expected
        {
            survive = expected.survive(at.p, at.flight.expected_first, importance, survive);
        }
        if survive < 1.0 && u[1] >= survive {
            return Vec3::ZERO;
        }
        counters.shadow_rays += 1;
        let ray = Ray { origin: at.vertex.origin(at.p, light.wi), direction: light.wi };
        if let Some(surface) = at.vertex.surface()
            && self.world.next_layer(surface, light.wi, sampler).is_some()
        {
            return Vec3::ZERO;
        }
        if self.world.occluded(&ray, light.distance, light.end, sampler) {
            return Vec3::ZERO;
        }
        let threshold = (SHADOW_ROULETTE / (importance / survive)).min(0.5);
        let leg = Leg { ray: &ray, start: at.start, t_max: light.distance };
        let shadow = self.media.transmittance(leg, threshold, at.beta, sampler, tally);
        let mut weight = 1.0 / (choice.probability * survive);
        let mut arrives = shadow.transmittance * light.weight;
        if MIS && light.pdf > 0.0 {
            // Density of the same path under path sampling.
            let pdf = match at.guide {
                Some(guide) if W::WHOLE => self.lights.fires().pdf(guide, light.wi, own),
                _ => own,
            };
            let pdf_light = light.pdf * choice.probability;
            if M::PARTS {
                // Each channel decides for itself.
                let pdf_path = shadow.null_probability * pdf;
                arrives *= Vec3::splat(pdf_light) / (Vec3::splat(pdf_light) + pdf_path);
            } else {
                // Null decisions are weighted by the throughput of their channels.
                let nulls = at.beta.dot(shadow.null_probability) / at.beta.element_sum();
                weight *= pdf_light / (pdf_light + pdf * nulls);
            }
        }
        if EQUIANGULAR
            && at.flight.in_medium
            && let Some(position) = light.position
            && let Some(part) = at.flight.part
        {
            let t = (at.p - at.flight.ray.origin).length();
            weight *= 1.0 - self.equiangular_weight(at.flight.ray, part, position, t) as f32;
        }
        // As for paths: a ray that goes on for ever without a surface is in no body.
        if W::WHOLE
            && light.distance < f64::INFINITY
            && let Some(body) = at.vertex.body(at.inside, light.wi)
        {
            arrives *= interior::transmittance(body, light.distance);
        }
        at.beta * value * arrives * weight
    }

    /// Weight of an equiangular point at `t` against a flight that ends there: the balance heuristic between the density of the points and that
    /// of flights in a medium of typical extinction. A function of ray, light and `t` alone, the same for both techniques: whatever it is, the
    /// sum of both is unbiased.
    fn equiangular_weight(&self, ray: &Ray, part: (f64, f64), light: DVec3, t: f64) -> f64 {
        let Some(points) = Equiangular::new(ray.origin, ray.direction, light, part) else {
            return 0.0;
        };
        let share = points.received() / self.received_from_all(ray, part);
        let pdf = share * points.pdf(t);
        let flights = self.typical_sigma_t * libm::exp(-self.typical_sigma_t * (t - part.0));
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
        let Some(sample) = self.lights.sample_position(index, p) else {
            return Vec3::ZERO;
        };
        let mut scattered = Vec3::ZERO;
        self.media.scattering(p, ray.direction, sampler, |sigma_s, phase| {
            scattered += sigma_s * phase.eval(ray.direction, sample.wi);
        });
        tally.lookups += 1;
        let unshadowed = beta * scattered * sample.weight * (weight / pdf) as f32;
        if !(unshadowed.max_element() > 0.0) {
            return Vec3::ZERO;
        }
        counters.shadow_rays += 1;
        let to_light = Ray { origin: p, direction: sample.wi };
        if self.world.occluded(&to_light, sample.distance, None, sampler) {
            return Vec3::ZERO;
        }
        // The plan keeps laws that are not exponential away from these points: where rays start does not matter.
        let leg = |ray, t_max| Leg { ray, start: None, t_max };
        let there = leg(ray, t);
        let there = self.media.transmittance(there, SHADOW_ROULETTE, beta, sampler, tally);
        if there.transmittance == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let on = leg(&to_light, sample.distance);
        let on = self.media.transmittance(on, SHADOW_ROULETTE, beta, sampler, tally);
        unshadowed * there.transmittance * on.transmittance
    }
}

/// What a path goes on from.
#[expect(clippy::large_enum_variant, reason = "one on the stack of a path")]
enum Turn<'a> {
    Medium(PhaseAt<'a>),
    Surface(Bsdf, pileus_scene::Interaction),
}

/// A path crosses a surface.
fn pass_through(inside: &mut Inside, interaction: &Interaction) {
    if !interaction.parameters.thin_walled {
        inside.cross(interaction);
    }
}

/// Balance heuristic of a path with density `pdf_path` against a shadow ray with `pdf_light`. Directions that were the only possible ones (`pdf` zero) no shadow
/// ray stands for.
#[inline(always)]
fn weight_of_path(pdf_path: f32, pdf: f32, pdf_light: f32) -> f32 {
    if pdf > 0.0 && pdf_light > 0.0 { pdf_path / (pdf_path + pdf_light) } else { 1.0 }
}

/// The same per channel of the throughput, from the probability of null decisions on the way.
#[inline(always)]
fn weights_of_path<N: Spectrum>(null_probability: N, pdf: f32, pdf_light: f32) -> Vec3 {
    let weights = null_probability.map(|nulls| weight_of_path(pdf * nulls, pdf, pdf_light));
    if N::COUNT == 1 {
        return Vec3::splat(weights.channel(0));
    }
    Vec3::new(weights.channel(0), weights.channel(1), weights.channel(2))
}

/// How a vertex was reached.
struct Flight<'a> {
    ray: &'a Ray,
    /// Of the ray, what equiangular points cover.
    part: Option<(f64, f64)>,
    /// Whether the vertex lies in a medium, where such a point might have been.
    in_medium: bool,
    /// Radiance that the path was expected to bring after its first scattering.
    expected_first: f32,
}

/// A vertex at which light is gathered.
struct Shading<'a, V> {
    p: DVec3,
    vertex: &'a V,
    /// Throughput, with the albedo of this vertex.
    beta: Vec3,
    strongest: f32,
    /// The bodies that the path came in.
    inside: &'a Inside,
    /// The medium that scattered, where that matters.
    start: Start,
    flight: Flight<'a>,
    /// How paths that go on from here are drawn to fires.
    guide: Option<&'a Guide>,
}
