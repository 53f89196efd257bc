//! One path, from the camera to its end: flights, and what happens where they end.
//!
//! Where channels decouple ([`ChannelMode::DECOUPLES`]), a path is a tree of three branches at
//! most: each channel is on one of them at any time, and a branch carries all that the path keeps.

use super::interior;
use super::limits::Cut;
use super::recorder::Recorder;
use super::world::{World, luminance};
use super::{Kernel, MediumStack};
use crate::media::channels::ChannelMode;
use crate::media::{FlightEnd, Media, Ray, RaySegment, StartCorrelation};
use crate::sampler::PathSampler;
use glam::{DVec3, Vec3};
use pileus_media::random::{exponential_of_stratified, happens, uniform};
use pileus_media::{PhaseAt, Spectrum, Tally};
use pileus_scene::{Hit, Interaction, Interior};
use smallvec::SmallVec;

/// Throughput below which a path undergoes Russian roulette.
const ROULETTE_THROUGHPUT: f32 = 0.25;

/// Bounces after which paths undergo Russian roulette at surfaces whatever their throughput.
const LONG_PATH_BOUNCES: u32 = 64;

/// With this survival probability.
const LONG_PATH_SURVIVAL: f32 = 0.95;

/// Paths whose throughput has grown beyond this by directions drawn towards emissive volumes are
/// drawn no more, so that the weights of long paths stay bounded: at surfaces, and in media, where
/// there are many.
const MAX_DRAWN_AT_SURFACES: f32 = 5.0;
const MAX_DRAWN_IN_MEDIA: f32 = 1.5;

/// What a path brought.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PathSample {
    pub(crate) radiance: Vec3,
    /// One minus the share of the background that is seen, whatever weights a flight carries.
    pub(crate) alpha: f32,
}

/// What scatters light at a vertex of a path.
pub(super) trait PathVertex {
    const IN_MEDIUM: bool;

    /// For light that arrives from `wi`: the value (a phase function, or a BSDF times the cosine),
    /// one number that stands for it, and the density with which paths are continued towards `wi`,
    /// 1/sr.
    fn eval(&self, wi: Vec3) -> (Vec3, f32, f32);

    /// A direction in which the path goes on; `None`: it ends.
    fn sample(&self, u: [f32; 2], sampler: &mut PathSampler) -> Option<DirectionSample>;

    /// Whether it scatters into more than single directions.
    fn scatters(&self) -> bool;

    /// Where a ray towards `wi` starts from a vertex at `p`.
    fn origin(&self, p: DVec3, wi: Vec3) -> DVec3;

    /// The surface that it is on.
    fn surface(&self) -> Option<&Interaction>;

    /// The interior medium that a ray towards `wi` starts in, of a path that came in `interiors`:
    /// across a surface it is another.
    fn interior<'a>(&'a self, interiors: &'a MediumStack, wi: Vec3) -> Option<&'a Interior>;

    /// All interior media that a ray towards `wi` starts in, of a path that came in `interiors`.
    fn interiors(&self, interiors: &MediumStack, wi: Vec3) -> MediumStack;
}

/// A direction in which a path goes on.
pub(super) struct DirectionSample {
    pub(super) wi: Vec3,
    /// Density, 1/sr; zero if no other direction could have been.
    pub(super) pdf: f32,
    /// Factor on the throughput.
    pub(super) weight: Vec3,
    /// Whether the path crosses the surface.
    pub(super) transmitted: bool,
    /// Whether it goes on as if no surface were there.
    pub(super) straight: bool,
}

/// A scattering in a medium.
#[derive(Debug, Clone, Copy)]
pub(super) struct MediumInteraction<'a> {
    pub(super) phase: PhaseAt<'a>,
    /// Propagation direction before the scattering.
    pub(super) incoming: Vec3,
}

impl PathVertex for MediumInteraction<'_> {
    const IN_MEDIUM: bool = true;

    #[inline(always)]
    fn eval(&self, wi: Vec3) -> (Vec3, f32, f32) {
        let value = self.phase.eval(self.incoming, wi);
        (Vec3::splat(value), value, value)
    }

    #[inline(always)]
    fn sample(&self, u: [f32; 2], _: &mut PathSampler) -> Option<DirectionSample> {
        let (wi, pdf) = self.phase.sample(self.incoming, u);
        Some(DirectionSample { wi, pdf, weight: Vec3::ONE, transmitted: false, straight: false })
    }

    #[inline(always)]
    fn scatters(&self) -> bool {
        true
    }

    #[inline(always)]
    fn origin(&self, p: DVec3, _: Vec3) -> DVec3 {
        p
    }

    #[inline(always)]
    fn surface(&self) -> Option<&Interaction> {
        None
    }

    #[inline(always)]
    fn interior<'a>(&'a self, interiors: &'a MediumStack, _: Vec3) -> Option<&'a Interior> {
        interiors.last()
    }

    #[inline(always)]
    fn interiors(&self, interiors: &MediumStack, _: Vec3) -> MediumStack {
        interiors.clone()
    }
}

/// Where the last flight began, for the weights of light it may run into.
#[derive(Debug, Clone, Copy)]
pub(super) struct PreviousVertex<'k> {
    pub(super) p: DVec3,
    /// Density of the direction taken, 1/sr; zero if no other could have been.
    pub(super) pdf: f32,
    /// The medium interaction; none: the surface that the path carries.
    pub(super) medium: Option<MediumInteraction<'k>>,
}

/// All that a path keeps from one vertex to the next.
#[derive(Clone)]
pub(super) struct Path<'k, C> {
    pub(super) ray: Ray,
    pub(super) beta: Vec3,
    pub(super) bounces: u32,
    /// The bounce at which limits are to be looked at next.
    pub(super) next_look: u32,
    pub(super) start: StartCorrelation,
    pub(super) previous: Option<PreviousVertex<'k>>,
    /// Radiance that the path was expected to bring after its first scattering.
    pub(super) expected_first: f32,
    /// On account of surfaces.
    pub(super) carried: C,
}

impl<C> Path<'_, C> {
    /// How often it was scattered: bounces, without the surfaces that it went straight through.
    #[inline(always)]
    pub(super) fn scatterings<W: World<Carried = C>>(&self) -> u32 {
        self.bounces - W::of(&self.carried).map_or(0, |surfaces| surfaces.straight)
    }
}

/// A path from the end of a flight on, for channels that have left the others.
struct Branch<'k, C, N> {
    path: Path<'k, C>,
    /// How the flight ended; none: it has not been flown.
    end: Option<FlightEnd<N>>,
    /// The surface at the end of the flight's segment.
    hit: Option<Hit>,
}

/// Branches that wait.
type Branches<'k, C, N> = SmallVec<[Branch<'k, C, N>; 2]>;

type Nulls<M> = <<M as Media>::Channels as ChannelMode>::Nulls;

/// How a flight ended.
enum Event<'a> {
    Collision { t: f64, phase: PhaseAt<'a>, albedo: Vec3, medium: StartCorrelation },
    Surface(Hit),
    Escape,
}

/// Where light of a path is gathered, and who counts.
pub(super) struct Tracing<'t, R> {
    pub(super) radiance: Vec3,
    pub(super) tally: Tally,
    pub(super) sampler: &'t mut PathSampler,
    pub(super) recorder: &'t mut R,
}

impl<M: Media, W: World> Kernel<'_, M, W> {
    /// Traces one path. `first`: stratified numbers for the first collision of the first flight.
    #[inline(always)]
    pub(crate) fn trace<R: Recorder>(
        &self,
        ray: Ray,
        [depth, decision]: [f32; 2],
        sampler: &mut PathSampler,
        recorder: &mut R,
    ) -> PathSample {
        let depth = exponential_of_stratified(depth, sampler);
        let first = Some([depth, decision]);
        let mut branches = Branches::<'_, W::Carried, Nulls<M>>::new();
        let mut path = Path {
            ray,
            beta: Vec3::ONE,
            bounces: 0,
            next_look: self.limits.first_look(),
            start: None,
            previous: None,
            expected_first: 1.0,
            carried: self.world.begin(&ray),
        };
        let tally = Tally::default();
        if !M::Channels::DECOUPLES {
            let tracing = Tracing { radiance: Vec3::ZERO, tally, sampler, recorder };
            let (radiance, transmitted) =
                self.follow(&mut path, (None, None), first, &mut branches, tracing);
            recorder.counters().paths += 1;
            return PathSample { radiance, alpha: 1.0 - transmitted };
        }
        let (mut radiance, mut transmitted) = (Vec3::ZERO, 0.0);
        let (mut end, mut hit) = (None, None);
        loop {
            let first = if end.is_none() { first } else { None };
            let tracing = Tracing { radiance, tally, sampler, recorder };
            let seen;
            (radiance, seen) = self.follow(&mut path, (end, hit), first, &mut branches, tracing);
            transmitted += seen;
            let Some(next) = branches.pop() else { break };
            Branch { path, end, hit } = next;
        }
        recorder.counters().paths += 1;
        PathSample { radiance, alpha: 1.0 - transmitted }
    }

    /// Follows one branch of a path to its end, from the end of a flight on where it has decoupled
    /// from another; what decouples from it joins `branches`. Returns the light gathered, and what
    /// its first flight, if it met nothing, lets through: the mean over channels of an unbiased
    /// estimate of the transmittance towards the background.
    #[inline(always)]
    fn follow<'k, R: Recorder>(
        &'k self,
        path: &mut Path<'k, W::Carried>,
        (mut resumed, mut hit): (Option<FlightEnd<Nulls<M>>>, Option<Hit>),
        mut first: Option<[f32; 2]>,
        branches: &mut Branches<'k, W::Carried, Nulls<M>>,
        mut tracing: Tracing<'_, R>,
    ) -> (Vec3, f32) {
        let begun = path.bounces;
        let mut transmitted = 0.0;
        loop {
            if W::SURFACES && resumed.is_none() {
                hit = self.next_surface(&path.ray, &mut path.carried, tracing.sampler);
            }
            let t_surface = if W::SURFACES {
                hit.as_ref().map_or(f64::INFINITY, |hit| hit.t)
            } else {
                f64::INFINITY
            };
            let mut interval = None;
            if self.equiangular {
                interval = self.equiangular_interval(path, t_surface);
                if resumed.is_none() {
                    self.add_equiangular_light(path, interval, &mut tracing);
                }
            }
            let end = match resumed.take() {
                Some(end) if M::Channels::DECOUPLES => end,
                _ => {
                    let segment =
                        RaySegment { ray: &path.ray, start: path.start, t_max: t_surface };
                    let mut decoupled = Default::default();
                    let Tracing { tally, sampler, recorder, .. } = &mut tracing;
                    let first = first.take();
                    let end = self.media.flight(
                        segment,
                        path.beta,
                        first,
                        &mut decoupled,
                        *sampler,
                        tally,
                    );
                    let length =
                        |end: &FlightEnd<Nulls<M>>| end.collision.map_or(t_surface, |c| c.t);
                    let mut longest = length(&end);
                    if M::Channels::DECOUPLES {
                        for end in decoupled {
                            longest = longest.max(length(&end));
                            branches.push(Branch { path: path.clone(), end: Some(end), hit });
                        }
                    }
                    recorder.flight(&path.ray, longest);
                    end
                }
            };
            path.beta = end.beta;
            let mut event = match (end.collision, hit) {
                (Some(collision), _) => {
                    let (phase, albedo) = self.media.properties(
                        &collision,
                        path.ray.at(collision.t),
                        path.ray.direction,
                        tracing.sampler,
                    );
                    let medium = Some(collision.medium);
                    Event::Collision { t: collision.t, phase, albedo, medium }
                }
                (None, Some(hit)) if W::SURFACES => Event::Surface(hit),
                _ => Event::Escape,
            };
            // What layers are told of the first event: an interior medium weighs paths beside it.
            let met = path.beta;
            let mut albedo_of_interior = None;
            if let Some(surfaces) = W::of(&path.carried) {
                let mut t_end = end.collision.map_or(t_surface, |collision| collision.t);
                if let Some(interior) = surfaces.interiors.last()
                    && let Some(t) = interior::fly(interior, t_end, &mut path.beta, tracing.sampler)
                {
                    let phase = PhaseAt::henyey_greenstein(interior.g);
                    event = Event::Collision { t, phase, albedo: Vec3::ONE, medium: None };
                    albedo_of_interior = Some(interior::albedo(interior));
                    t_end = t;
                }
                if !self.world.emissive_volumes().is_empty() {
                    let segment =
                        RaySegment { ray: &path.ray, start: path.start, t_max: t_surface };
                    self.add_emission(
                        (segment, t_end),
                        (end.before, path.bounces, path.bounces - surfaces.straight),
                        &surfaces.interiors,
                        &mut tracing,
                    );
                }
            }
            match event {
                Event::Escape => {
                    if path.bounces == 0 {
                        transmitted = path.beta.element_sum() * (1.0 / 3.0);
                    }
                    let light = path.beta * self.escape(path, end.null_probability);
                    tracing.radiance += light;
                    if let Some(layers) = tracing.recorder.layers() {
                        if path.bounces == 0 {
                            layers.transmittance(path.beta);
                        }
                        layers.escape(light, path.scatterings::<W>());
                    }
                    break;
                }
                Event::Collision { t, phase, albedo, medium } => {
                    if path.bounces == 0
                        && let Some(layers) = tracing.recorder.layers()
                    {
                        let (p, incoming) = (path.ray.at(t), path.ray.direction);
                        layers.first_in_medium(
                            p,
                            incoming,
                            met,
                            albedo_of_interior.unwrap_or(albedo),
                        );
                    }
                    if path.bounces >= path.next_look
                        && let Some(cut) = self.cut(path, &tracing.tally)
                    {
                        tracing.recorder.counters().count_cut(cut);
                        path.bounces += 1;
                        break;
                    }
                    path.bounces += 1;
                    path.beta *= albedo;
                    let vertex = MediumInteraction { phase, incoming: path.ray.direction };
                    let at = (path.ray.at(t), interval, medium);
                    if !self.scatter(path, &vertex, at, &mut tracing) {
                        break;
                    }
                    if self.mis
                        && let Some(previous) = &mut path.previous
                    {
                        previous.medium = Some(vertex);
                    }
                }
                Event::Surface(hit) => {
                    let nulls = end.null_probability;
                    if !self.surface_event(path, (&hit, met), nulls, &mut tracing) {
                        break;
                    }
                }
            }
        }
        let counters = tracing.recorder.counters();
        counters.bounces += u64::from(path.bounces - begun);
        counters.add_tally(&tracing.tally);
        (tracing.radiance, transmitted)
    }

    /// Gathers light at a vertex at `p` and goes on from there; false if the path ends. `interval`:
    /// what of the ray there equiangular points cover; `scattered_by`: the medium that scatters.
    #[inline(always)]
    pub(super) fn scatter<'k, V: PathVertex, R: Recorder>(
        &'k self,
        path: &mut Path<'k, W::Carried>,
        vertex: &V,
        (p, interval, scattered_by): (DVec3, Option<(f64, f64)>, StartCorrelation),
        tracing: &mut Tracing<'_, R>,
    ) -> bool {
        // Weights of flights through media whose bounds do not hold have either sign.
        let strongest = path.beta.abs().max_element();
        if !(strongest > 0.0) {
            return false;
        }
        let first = path.bounces == 1;
        // Stratified numbers for the first scattering only: later ones gain nothing measurable.
        let [u_light, u_shadow, u_phase0, u_phase1] = if first {
            tracing.sampler.stratified(1)
        } else {
            let sampler = &mut *tracing.sampler;
            [uniform(sampler), uniform(sampler), uniform(sampler), uniform(sampler)]
        };
        let scatters = vertex.scatters();
        let drawn = W::of(&path.carried).map_or(1.0, |surfaces| surfaces.drawn);
        let max_drawn = if V::IN_MEDIUM { MAX_DRAWN_IN_MEDIA } else { MAX_DRAWN_AT_SURFACES };
        let drawn_to = W::SURFACES && !self.lights.emissive_volumes().is_empty();
        let mixture = if drawn_to && scatters && drawn <= max_drawn {
            self.lights.emission_mixture(p, V::IN_MEDIUM, luminance(self.environment.constant))
        } else {
            None
        };
        if scatters && !self.lights.is_empty() {
            if V::IN_MEDIUM
                && first
                && let Some(cache) = self.radiance_cache
            {
                path.expected_first = cache.radiance(p);
            }
            let place = (p, interval, scattered_by);
            let light = (strongest, [u_light, u_shadow]);
            self.add_direct_light(path, vertex, place, light, mixture.as_ref(), tracing);
        }
        if V::IN_MEDIUM {
            tracing.recorder.medium_interaction(p, path.beta, tracing.radiance);
        }
        // Light that smooth glass reflects forever loses nothing: long paths end by chance at
        // surfaces, never in media, which let go of theirs.
        let trapped = !V::IN_MEDIUM && path.bounces > LONG_PATH_BOUNCES;
        // How much light a direction drawn by an emissive volume stands for says nothing of how
        // much the path may still find.
        let strongest = if W::SURFACES { strongest / drawn } else { strongest };
        if strongest < ROULETTE_THROUGHPUT || trapped {
            let survival = strongest / ROULETTE_THROUGHPUT;
            let survival = if trapped { survival.min(LONG_PATH_SURVIVAL) } else { survival };
            if !happens(survival, tracing.sampler) {
                return false;
            }
            path.beta /= survival;
        }
        let sampler = &mut *tracing.sampler;
        let by_emission = mixture.as_ref().filter(|mixture| uniform(sampler) < mixture.share);
        let sample = if let Some(mixture) = by_emission {
            let u = if first {
                sampler.stratified(2)
            } else {
                [u_phase0, u_phase1, uniform(sampler), uniform(sampler)]
            };
            let u = [u[0], uniform(sampler), u[1], u[2]];
            let Some(wi) = self.lights.emissive_volumes().sample(mixture, u) else { return false };
            let (value, _, own) = vertex.eval(wi);
            if !(own > 0.0) {
                return false;
            }
            let transmitted = vertex.surface().is_some_and(|surface| {
                let normal = surface.geometric_normal;
                wi.dot(normal) * path.ray.direction.dot(normal) > 0.0
            });
            let weight = value / own;
            Some(DirectionSample { wi, pdf: own, weight, transmitted, straight: false })
        } else {
            vertex.sample([u_phase0, u_phase1], sampler)
        };
        let Some(DirectionSample { wi, pdf: own, weight, transmitted, straight }) = sample else {
            return false;
        };
        path.beta *= weight;
        let mut pdf = own;
        let mut drawn_by = 1.0;
        if W::SURFACES
            && let Some(mixture) = &mixture
        {
            // A direction without density, as smooth glass has, is none of the emissive volumes'.
            drawn_by = if own > 0.0 {
                pdf = self.lights.emissive_volumes().pdf(mixture, wi, own);
                own / pdf
            } else {
                1.0 / (1.0 - mixture.share)
            };
            path.beta *= drawn_by;
        }
        let origin = vertex.origin(p, wi);
        if let Some(surfaces) = W::of_mut(&mut path.carried) {
            surfaces.drawn *= drawn_by;
            if straight {
                surfaces.straight += 1;
            } else {
                surfaces.camera = false;
            }
            if let Some(surface) = vertex.surface() {
                if transmitted {
                    surfaces.interiors.pass_through(surface);
                }
                surfaces.layer = self.world.next_layer(surface, wi, sampler);
            }
        }
        if self.mis {
            // The caller adds the interaction.
            path.previous = Some(PreviousVertex { p, pdf, medium: None });
        }
        path.ray = Ray { origin, direction: wi };
        path.start = scattered_by;
        true
    }

    /// Why a limit cuts a path at a bounce at which it had to ask; `None` if it goes on, and when
    /// it has to ask next.
    #[inline(always)]
    pub(super) fn cut(&self, path: &mut Path<'_, W::Carried>, tally: &Tally) -> Option<Cut> {
        let straight = W::of(&path.carried).map_or(0, |surfaces| surfaces.straight);
        let events = u64::from(path.bounces) + tally.lookups + tally.majorant_steps;
        match self.limits.look(path.bounces, straight, events) {
            Ok(next) => {
                path.next_look = next;
                None
            }
            Err(cut) => Some(cut),
        }
    }

    /// Radiance from infinity along an escaping ray, weighted against shadow rays where they cover
    /// it.
    #[inline(always)]
    fn escape(&self, path: &Path<'_, W::Carried>, null_probability: Nulls<M>) -> Vec3 {
        let direction = path.ray.direction;
        if !self.mis {
            return self.environment.radiance(direction);
        }
        let mut radiance = self.environment.constant;
        if !self.lights.covers_image() {
            radiance = self.environment.radiance(direction);
        }
        self.lights.met_at_infinity(direction, |light, sampled| {
            let weight = match (&path.previous, sampled) {
                (Some(previous), Some((index, pdf))) => {
                    let pdf_light = pdf * self.probability(index, previous, &path.carried);
                    weights_of_path(null_probability, previous.pdf, pdf_light)
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
    pub(super) fn probability(
        &self,
        index: usize,
        previous: &PreviousVertex<'_>,
        carried: &W::Carried,
    ) -> f32 {
        self.lights.probability(index, previous.p, |wi| match &previous.medium {
            Some(vertex) => vertex.eval(wi).1,
            None => {
                let surface = W::of(carried).and_then(|surfaces| surfaces.vertex.as_ref());
                surface.map_or(0.0, |vertex| vertex.eval(wi).1)
            }
        })
    }
}

/// Balance heuristic of a path with density `pdf_path` against a shadow ray with `pdf_light`.
/// Directions that were the only possible ones (`pdf` zero) no shadow ray stands for.
#[inline(always)]
fn weight_of_path(pdf_path: f32, pdf: f32, pdf_light: f32) -> f32 {
    if pdf > 0.0 && pdf_light > 0.0 { pdf_path / (pdf_path + pdf_light) } else { 1.0 }
}

/// [`weight_of_path`] per channel of the throughput, from the probability of null decisions on the
/// way.
#[inline(always)]
pub(super) fn weights_of_path<N: Spectrum>(null_probability: N, pdf: f32, pdf_light: f32) -> Vec3 {
    let weights = null_probability.map(|nulls| weight_of_path(pdf * nulls, pdf, pdf_light));
    if N::COUNT == 1 {
        return Vec3::splat(weights.channel(0));
    }
    Vec3::new(weights.channel(0), weights.channel(1), weights.channel(2))
}
