//! Any number of media, overlapping or not, grey or per channel.
//!
//! Overlapping media are independent Poisson processes: their tentative collisions are taken in order along the ray, transmittances
//! multiply. Where extinction differs per channel all channels share the largest one's majorant, and real or null is decided by
//! the mean of the throughput-weighted channels: spectral tracking [Kutz et al. 2017]. Under that rule the mean of the
//! throughput over channels is the same before and after every event, so that no channel's weight exceeds the number of channels;
//! it is single-sample multiple importance sampling over channels by the balance heuristic [Miller et al. 2019].

use super::{Collision, Flown, Leg, Media, MediaIndex, Met, Methods, Ray, Shadow, Together};
use glam::{DVec3, Vec3};
use pileus_media::distance::{
    DistanceSampler, Flight, WeightedFlight, delta_tracking, delta_tracking_by_mean,
    real_probability, regular_flight, spectral_tracking,
};
use pileus_media::random::{exponential, happens};
use pileus_media::transmittance::{Estimator, RatioEstimate, ratio_tracking_with_roulette};
use pileus_media::{
    AnyRay, Channels, FieldKernel, Grey, Medium, PhaseAt, RayField, Relative, Span, Spectrum, Tally,
    Tentative, TentativeCollisions,
};
use rand_core::Rng;
use smallvec::SmallVec;
use std::sync::Arc;

/// All media of a scene, as a list.
pub(crate) struct Overlapping<'a> {
    pub(crate) media: &'a [Arc<Medium>],
    pub(crate) index: &'a MediaIndex,
    pub(crate) methods: Methods,
}

/// A medium met by a ray, with its next tentative collision.
struct Walker<'a> {
    medium: usize,
    t_enter: f64,
    relative: Vec3,
    walk: TentativeCollisions<AnyRay<'a>>,
    /// Whether shadow rays walk this medium by the same collisions, so that its null decisions belong into the weights.
    weighted: bool,
    next: Option<Tentative>,
    /// Where on the ray; infinite if there is none.
    t: f64,
}

impl Walker<'_> {
    /// Takes a collision of the walk for the next one.
    #[inline(always)]
    fn meet(&mut self, next: Option<Tentative>) {
        self.next = next;
        self.t = next.map_or(f64::INFINITY, |next| {
            self.t_enter + self.walk.field().distance(f64::from(next.t))
        });
    }
}

/// Where a ray meets a medium: what is known before it is walked.
pub(super) struct Entry<'a> {
    medium: &'a Medium,
    span: Span,
}

impl<'a> Entry<'a> {
    #[inline]
    pub(super) fn new(medium: &'a Medium, ray: &Ray, t_max: f64) -> Option<Entry<'a>> {
        let span = medium.span(ray.origin, ray.direction, t_max)?;
        Some(Entry { medium, span })
    }

    /// Where the ray leaves.
    fn t_exit(&self) -> f64 {
        self.span.t_exit()
    }

    /// Calls `kernel` with the field, compiled for its kind.
    #[inline(always)]
    fn with_field<K: FieldKernel>(&self, kernel: K) -> K::Output {
        self.medium.with_ray(&self.span, 1.0, kernel)
    }

    pub(super) fn t(&self) -> f64 {
        self.span.t_enter
    }

    /// Where on the ray the parameter `t` of the field is.
    #[inline]
    pub(super) fn at(&self, t: f32) -> f64 {
        self.medium.world_distance(&self.span, t)
    }

    #[inline]
    pub(super) fn field(&self) -> AnyRay<'a> {
        self.medium.any_ray(&self.span, 1.0)
    }
}

/// Media ahead, the nearest last.
pub(super) type Ahead<'a> = SmallVec<[(usize, Entry<'a>); 4]>;

/// Transmittance of a grey homogeneous medium up to `t_max`: closed form; `None` for other media.
fn closed_form(medium: &Medium, ray: &Ray, t_max: f64) -> Option<f32> {
    let shape = medium.homogeneous_box()?;
    if !medium.is_grey() {
        return None;
    }
    let span = shape.span(ray.origin, ray.direction, t_max);
    let length = span.map_or(0.0, |span| span.length);
    let shown = medium.phase().flakes().map_or(1.0, |flakes| flakes.largest_area(ray.direction));
    let tau = f64::from(shape.sigma_t() * shown) * f64::from(length);
    // 0 x infinity: no extinction in all space.
    Some(if tau.is_nan() { 1.0 } else { libm::exp(-tau) as f32 })
}

/// Whether a ray never leaves a medium that differs per channel: without end, transmittance is zero or one.
fn endless(medium: &Medium, ray: &Ray, t_max: f64) -> bool {
    let Some(shape) = medium.homogeneous_box() else {
        return false;
    };
    let endless = |span: Span| span.length == f32::INFINITY;
    !medium.is_grey() && shape.span(ray.origin, ray.direction, t_max).is_some_and(endless)
}

/// Optical depth of the strongest channel, and its extinction over the weakest one's, above which a
/// leg through a homogeneous medium is not walked.
const MAX_WALKED_DEPTH: f64 = 256.0;

/// Whether a medium is homogeneous and its channels differ so much that a leg may be too long to
/// walk.
pub(super) fn is_uneven(medium: &Medium) -> bool {
    let uneven = |s: f32| s > 0.0 && f64::from(s) * MAX_WALKED_DEPTH < 1.0;
    let relative = medium.chromatic_ratio();
    medium.homogeneous_box().is_some() && relative.to_array().into_iter().any(uneven)
}

/// The strongest channel's optical depth of a leg through a homogeneous medium whose channels
/// differ so much that a walk by the strongest one's collisions, which are null for the others,
/// would be very long: there flights and transmittances are closed forms, and weights leave the way
/// out on both sides. `None` elsewhere.
pub(super) fn too_long_to_walk(medium: &Medium, ray: &Ray, t_max: f64) -> Option<f64> {
    if !is_uneven(medium) {
        return None;
    }
    let shape = medium.homogeneous_box()?;
    let length = shape.span(ray.origin, ray.direction, t_max)?.length;
    let shown = medium.phase().flakes().map_or(1.0, |flakes| flakes.largest_area(ray.direction));
    let depth = f64::from(shape.sigma_t() * shown) * f64::from(length);
    (depth > MAX_WALKED_DEPTH).then_some(depth)
}

/// A flight through one field.
struct FlyAlone<'r, R> {
    /// Majorant depth of the first collision.
    depth: f32,
    beta: Vec3,
    /// Extinction of the channels, if it differs.
    relative: Option<Vec3>,
    by_throughput: bool,
    rng: &'r mut R,
    tally: &'r mut Tally,
}

impl<R: Rng> FieldKernel for FlyAlone<'_, R> {
    type Output = WeightedFlight<Vec3>;

    #[inline(always)]
    fn run<F: RayField>(self, field: F) -> WeightedFlight<Vec3> {
        let FlyAlone { depth, beta, relative, by_throughput, rng, tally } = self;
        let walk = TentativeCollisions::with_first(field, depth);
        match relative {
            None => {
                let mut null_probability = 1.0;
                let flight = delta_tracking(walk, rng, tally, |p| null_probability *= p);
                WeightedFlight { flight, weight: Vec3::ONE, null_probability }
            }
            Some(relative) if by_throughput => {
                spectral_tracking(walk, Relative(relative), beta, rng, tally)
            }
            Some(relative) => delta_tracking_by_mean(walk, Relative(relative), rng, tally),
        }
    }
}

/// Ratio tracking through one field.
struct ShadowAlone<'r, C, R> {
    channels: C,
    threshold: f32,
    rng: &'r mut R,
    tally: &'r mut Tally,
}

impl<C: Channels, R: Rng> FieldKernel for ShadowAlone<'_, C, R> {
    type Output = RatioEstimate<C::Value>;

    #[inline(always)]
    fn run<F: RayField>(self, field: F) -> RatioEstimate<C::Value> {
        let ShadowAlone { channels, threshold, rng, tally } = self;
        let walk = TentativeCollisions::new(field);
        ratio_tracking_with_roulette(walk, channels, threshold, rng, tally)
    }
}

impl<'a> Overlapping<'a> {
    /// The media of `met` that a ray meets, the nearest last.
    #[inline]
    pub(super) fn ahead(&self, met: &Met, ray: &Ray, t_max: f64) -> Ahead<'a> {
        let mut ahead: Ahead<'a> = SmallVec::new();
        for &index in met {
            let index = index as usize;
            if let Some(entry) = Entry::new(&self.media[index], ray, t_max) {
                ahead.push((index, entry));
            }
        }
        // Media that begin at the same point are told apart by their number, whatever order the index found them in.
        ahead.sort_unstable_by(|(i, a), (j, b)| b.t().total_cmp(&a.t()).then(j.cmp(i)));
        ahead
    }

    /// Transmittance of one medium, and the null probability that weights count with it.
    #[inline]
    pub(super) fn shadow<C: Channels, R: Rng>(
        &self,
        entry: &Entry<'_>,
        channels: C,
        threshold: f32,
        rng: &mut R,
        tally: &mut Tally,
    ) -> (C::Value, C::Value) {
        let known = self.methods.weigh_the_way(C::Value::COUNT == 1);
        if self.methods.transmittance == Estimator::Ratio {
            let estimate = entry.with_field(ShadowAlone { channels, threshold, rng, tally });
            let nulls = if known { estimate.null_probability } else { C::Value::ONE };
            return (estimate.transmittance, nulls);
        }
        let (estimator, field) = (self.methods.transmittance, entry.field());
        let transmittance = estimator.estimate(field, channels, threshold, rng, tally);
        (transmittance, if known { transmittance } else { C::Value::ONE })
    }

    /// What a shadow ray finds of one medium, without its law; `None` if it does not meet it.
    #[inline]
    pub(super) fn through<R: Rng>(
        &self,
        medium: &Medium,
        (ray, t_max): (&Ray, f64),
        threshold: f32,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Shadow> {
        if let Some(factor) = closed_form(medium, ray, t_max) {
            let factor = Vec3::splat(factor);
            return Some(Shadow { transmittance: factor, null_probability: factor });
        }
        let relative = medium.chromatic_ratio();
        if let Some(depth) = too_long_to_walk(medium, ray, t_max) {
            let passed =
                |s: f32| if s > 0.0 { libm::exp(-f64::from(s) * depth) as f32 } else { 1.0 };
            let transmittance = Spectrum::map(relative, passed);
            return Some(Shadow { transmittance, ..Shadow::CLEAR });
        }
        if endless(medium, ray, t_max) {
            let clear = |s: f32| if s > 0.0 { 0.0 } else { 1.0 };
            let transmittance = Spectrum::map(relative, clear);
            return Some(Shadow { transmittance, ..Shadow::CLEAR });
        }
        let entry = Entry::new(medium, ray, t_max)?;
        let (transmittance, null_probability) = if relative == Vec3::ONE {
            let (t, n) = self.shadow(&entry, Grey, threshold, rng, tally);
            (Vec3::splat(t), Vec3::splat(n))
        } else {
            self.shadow(&entry, Relative(relative), threshold, rng, tally)
        };
        Some(Shadow { transmittance, null_probability })
    }

    /// As [`Media::scattering`], with the extinction of each medium times a factor of its own.
    pub(super) fn scattering_times<R: Rng>(
        &self,
        factor: impl Fn(&Medium) -> f32,
        (p_world, incoming): (DVec3, Vec3),
        rng: &mut R,
        mut visit: impl FnMut(Vec3, PhaseAt<'_>),
    ) {
        for index in self.index.around(p_world) {
            let medium = &self.media[index as usize];
            let sigma_t = medium.sigma_t_at(p_world) as f32;
            if sigma_t > 0.0 {
                let sigma_t = sigma_t * factor(medium) * medium.projected_area(p_world, incoming);
                let sigma_t = medium.chromatic_ratio() * sigma_t;
                visit(medium.albedo_at(p_world) * sigma_t, medium.phase_at(p_world, incoming, rng));
            }
        }
    }

    /// A flight through a medium that no other overlaps.
    #[inline]
    fn fly_alone<R: Rng>(
        &self,
        (ray, t_max): (&Ray, f64),
        (index, entry): (usize, Entry<'_>),
        first: Option<f32>,
        flown: &mut Flown<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let medium = &self.media[index];
        let by_throughput = self.methods.distance == DistanceSampler::Spectral;
        let relative = medium.chromatic_ratio();
        let depth = first.unwrap_or_else(|| exponential(rng));
        let (beta, relative) = (flown.beta, (relative != Vec3::ONE).then_some(relative));
        let weighted =
            self.methods.weigh_the_way(relative.is_none()) && !endless(medium, ray, t_max);
        let flight =
            entry.with_field(FlyAlone { depth, beta, relative, by_throughput, rng, tally });
        flown.beta *= flight.weight;
        if weighted {
            flown.null_probability *= flight.null_probability;
        }
        match flight.flight {
            Flight::Collision(t) => Some(Collision { t: entry.at(t), medium: index }),
            Flight::Escape => None,
        }
    }

    /// Every sampler but those that take the collisions of all media in order: each medium flies alone, the nearest collision wins, and the
    /// weights of all flights count, since those that flew further stand for the transmittance up to there.
    fn fly_each<R: Rng>(
        &self,
        (ray, t_max): (&Ray, f64),
        mut ahead: Ahead<'_>,
        mut first: Option<f32>,
        flown: &mut Flown<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let mut nearest: Option<Collision> = None;
        let sampler = self.methods.distance;
        while let Some((index, entry)) = ahead.pop() {
            // What begins behind a collision does not concern this flight.
            let t_enter = entry.t();
            if nearest.is_some_and(|nearest| nearest.t < t_enter) {
                break;
            }
            let (medium, field) = (&self.media[index], entry.field());
            let relative = medium.chromatic_ratio();
            let first = first.take();
            let (flight, null_probability) = if relative == Vec3::ONE {
                let grey = sampler.fly(field, Grey, 1.0, first, rng, tally);
                flown.beta *= grey.weight;
                (grey.flight, grey.null_probability)
            } else {
                let color = sampler.fly(field, Relative(relative), flown.beta, first, rng, tally);
                flown.beta *= color.weight;
                (color.flight, color.null_probability)
            };
            // What shadow rays know in closed form is counted on escape.
            let counted = self.methods.weigh_the_way(relative == Vec3::ONE)
                && closed_form(medium, ray, 0.0).is_none()
                && !endless(medium, ray, t_max);
            if counted {
                flown.null_probability *= null_probability;
            }
            if let Flight::Collision(t) = flight {
                let t = entry.at(t);
                if nearest.is_none_or(|nearest| t < nearest.t) {
                    nearest = Some(Collision { t, medium: index });
                }
            }
        }
        nearest
    }

    /// Flies past media that are not walked: the nearest of their collisions, each by a closed form
    /// of its own, ends the flight if nothing does before. The weights of all count, since those
    /// that flew further stand for the transmittance up to there.
    #[inline(never)]
    fn fly_past_long<R: Rng>(
        &self,
        (ray, t_max): (&Ray, f64),
        met: &Met,
        first: Option<f32>,
        flown: &mut Flown<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let mut nearest: Option<Collision> = None;
        let mut others = Met::new();
        for &index in met {
            let medium = &self.media[index as usize];
            let entry = match too_long_to_walk(medium, ray, t_max) {
                Some(_) => Entry::new(medium, ray, t_max),
                None => None,
            };
            let Some(entry) = entry else {
                others.push(index);
                continue;
            };
            let channels = Relative(medium.chromatic_ratio());
            let drawn = exponential(rng);
            let flight = regular_flight(&entry.field(), channels, flown.beta, drawn, rng, tally);
            flown.beta *= flight.weight;
            if let Flight::Collision(t) = flight.flight {
                let t = entry.t() + f64::from(t);
                if nearest.is_none_or(|nearest| t < nearest.t) {
                    nearest = Some(Collision { t, medium: index as usize });
                }
            }
        }
        let t_max = nearest.map_or(t_max, |nearest| nearest.t);
        let collision = self.fly_past(&others, (ray, t_max), first, flown, rng, tally);
        collision.or(nearest)
    }

    /// Light sampling takes these transmittances in closed form; path sampling had to survive them.
    fn count_closed_forms(&self, met: &Met, ray: &Ray, t_max: f64, flown: &mut Flown<f32>) {
        for &index in met {
            let medium = &self.media[index as usize];
            if let Some(transmittance) = closed_form(medium, ray, t_max) {
                flown.null_probability *= transmittance;
            }
        }
    }

    /// Flies past the media of `met`, all by the plan's sampler.
    #[inline]
    fn fly_past<R: Rng>(
        &self,
        met: &Met,
        (ray, t_max): (&Ray, f64),
        first: Option<f32>,
        flown: &mut Flown<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let mut ahead = self.ahead(met, ray, t_max);
        if !matches!(self.methods.distance, DistanceSampler::Spectral | DistanceSampler::Delta) {
            let collision = self.fly_each((ray, t_max), ahead, first, flown, rng, tally);
            if collision.is_none() {
                self.count_closed_forms(met, ray, t_max, flown);
            }
            return collision;
        }
        let mut first = first;
        // One after the other, as long as none overlaps the next.
        while let Some((index, entry)) = ahead.pop() {
            if ahead.last().is_some_and(|(_, next)| next.t() < entry.t_exit()) {
                ahead.push((index, entry));
                break;
            }
            let collision =
                self.fly_alone((ray, t_max), (index, entry), first.take(), flown, rng, tally);
            if collision.is_some() {
                return collision;
            }
        }
        let by_throughput = self.methods.distance == DistanceSampler::Spectral;
        let mut walkers: SmallVec<[Walker; 4]> = SmallVec::new();
        let collision = loop {
            let nearest = (0..walkers.len()).min_by(|&a, &b| walkers[a].t.total_cmp(&walkers[b].t));
            let t = nearest.map_or(f64::INFINITY, |nearest| walkers[nearest].t);
            // A medium is walked once the flight has come to where it begins.
            if ahead.last().is_some_and(|(_, entry)| entry.t() <= t)
                && let Some((index, entry)) = ahead.pop()
            {
                let depth = first.take().unwrap_or_else(|| exponential(rng));
                let mut walk = TentativeCollisions::with_first(entry.field(), depth);
                let next = walk.next(rng);
                let medium = &self.media[index];
                let relative = medium.chromatic_ratio();
                let weighted = self.methods.weigh_the_way(relative == Vec3::ONE)
                    && !endless(medium, ray, t_max);
                let mut walker = Walker {
                    medium: index,
                    t_enter: entry.t(),
                    relative,
                    walk,
                    weighted,
                    next: None,
                    t: f64::INFINITY,
                };
                walker.meet(next);
                walkers.push(walker);
                continue;
            }
            let walker = nearest.map(|nearest| &mut walkers[nearest]);
            let Some((walker, next)) = walker.and_then(|w| w.next.map(|next| (w, next))) else {
                break None;
            };
            let sigma_t = walker.walk.sigma_t(next, tally);
            let real = walker.relative * (sigma_t / next.majorant);
            let weights = if by_throughput { flown.beta } else { Vec3::ONE };
            let probability = real_probability(real, weights);
            if happens(probability, rng) {
                tally.collisions += 1;
                flown.beta *= real / probability;
                break Some(Collision { t: walker.t, medium: walker.medium });
            }
            tally.null_collisions += 1;
            flown.beta *= (Vec3::ONE - real) / (1.0 - probability);
            if walker.weighted {
                flown.null_probability *= 1.0 - probability;
            }
            // No extinction in any channel that is left, now and for all that follows: an endless walk would not end.
            let transparent =
                probability == 0.0 && self.media[walker.medium].homogeneous_box().is_some();
            let next = if transparent { None } else { walker.walk.next(rng) };
            walker.meet(next);
        };
        for walker in &walkers {
            tally.majorant_steps += walker.walk.field().steps();
        }
        if collision.is_none() {
            self.count_closed_forms(met, ray, t_max, flown);
        }
        collision
    }
}

impl Media for Overlapping<'_> {
    type Nulls = f32;
    type Others = Together;

    fn flight<R: Rng>(
        &self,
        Leg { ray, t_max, .. }: Leg<'_>,
        first: Option<[f32; 2]>,
        flown: &mut Flown<f32>,
        _: &mut Together,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let first = first.map(|[depth, _]| depth);
        let met = self.index.along(ray, t_max);
        let long = |&i: &u32| too_long_to_walk(&self.media[i as usize], ray, t_max).is_some();
        if self.index.uneven && met.iter().any(long) {
            return self.fly_past_long((ray, t_max), &met, first, flown, rng, tally);
        }
        self.fly_past(&met, (ray, t_max), first, flown, rng, tally)
    }

    fn transmittance<R: Rng>(
        &self,
        Leg { ray, t_max, .. }: Leg<'_>,
        threshold: f32,
        _: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        let mut shadow = Shadow::CLEAR;
        for index in self.index.along(ray, t_max) {
            let medium = &self.media[index as usize];
            let Some(part) = self.through(medium, (ray, t_max), threshold, rng, tally) else {
                continue;
            };
            shadow.transmittance *= part.transmittance;
            shadow.null_probability *= part.null_probability;
            if shadow.transmittance == Vec3::ZERO {
                break;
            }
        }
        shadow
    }

    fn scattering<R: Rng>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
        visit: impl FnMut(Vec3, PhaseAt<'_>),
    ) {
        self.scattering_times(|_| 1.0, (p_world, incoming), rng, visit);
    }

    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)> {
        let mut hull: Option<(f64, f64)> = None;
        for index in self.index.along(ray, t_max) {
            let medium = &self.media[index as usize];
            if let Some(span) = medium.span(ray.origin, ray.direction, t_max) {
                let (t0, t1) = span.extent();
                hull = Some(hull.map_or((t0, t1), |(a, b)| (a.min(t0), b.max(t1))));
            }
        }
        hull
    }

    fn properties<R: Rng>(
        &self,
        collision: &Collision,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> (PhaseAt<'_>, Vec3) {
        let medium = &self.media[collision.medium];
        (medium.phase_at(p_world, incoming, rng), medium.albedo_at(p_world))
    }
}
