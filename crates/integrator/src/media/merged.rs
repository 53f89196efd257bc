//! A list of media, overlapping or not: the nearest real collision of all that a ray meets.
//!
//! Overlapping media are independent Poisson processes: transmittances multiply, and the nearest of
//! all real collisions ends a flight. Where a collision is real for all channels or for none, each
//! medium is walked by itself as the kernels of one grid do, no further than the nearest real
//! collision of those before it. Where channels share collisions and differ, what one medium's
//! collision is taken for depends on those before, and the tentative collisions of all media are
//! taken in order along the ray.
//!
//! Media with a transmittance function that is not exponential are entries of the list like any
//! other. Those functions have a memory: a flight is one piece from where it starts to the next
//! real collision or surface, null collisions do not reset it, and nothing is a product over parts
//! of a ray. A ray that starts at a scatterer of a medium is correlated with that medium alone;
//! light, cameras and surfaces are not correlated with any. Functions that are mixtures of
//! exponentials run on the extinction times a drawn rate; others, and media too long to walk, fly
//! by closed forms of their own, and the nearest collision counts.

use super::channels::{ChannelMode, FlightUnderWay};
use super::collisions::{Ahead, ManyMedia, OneMedium};
use super::entry::{Entry, passage};
use super::index::{AtMostOne, MetMedia, Walk};
use super::walks::{
    closed_form, endless, has_to_be_walked, known_transmittance, runs_on_rates, too_long_to_walk,
};
use super::{Collision, FlightEnd, Media, MediaIndex, Methods, Ray, RaySegment, Shadow};
use glam::{DVec3, Vec3};
use pileus_math::random::exponential;
use pileus_media::distance::{
    DistanceSampler, Flight, WeightedFlight, regular_flight, regular_flight_non_exponential,
};
use pileus_media::transmittance::{
    DebiasingSeries, Estimator, RatioEstimate, debiased_non_exponential, exact_non_exponential,
    ratio_tracking_with_roulette,
};
use pileus_media::transmittance_function::Passage;
use pileus_media::{
    Channels, ChromaticRatio, ExactField, FieldKernel, Grey, Medium, PhaseAt, Spectrum, Tally,
    TentativeCollisions,
};
use rand_core::Rng;
use smallvec::SmallVec;
use std::sync::Arc;

/// All media of a scene, as a list.
pub(crate) struct Merged<'a, C> {
    media: &'a [Arc<Medium>],
    index: &'a MediaIndex,
    methods: Methods,
    channels: C,
    /// How debiased ray marching chooses its levels under transmittance functions that are not
    /// exponential.
    series: DebiasingSeries,
    /// Whether flights take tentative collisions in order, and not medium by medium.
    tracks: bool,
    /// Whether null decisions belong into weights, in media whose channels differ and in grey ones.
    weighs: [bool; 2],
}

/// Entries that a ray meets, the nearest last.
type Entries<'a> = SmallVec<[Entry<'a>; 4]>;

/// A flight through one field by tentative collisions.
struct FlyThrough<'r, C: ChannelMode, R> {
    channels: C,
    flight: &'r mut C::Flight,
    first: Option<[f32; 2]>,
    /// Number of the medium, and where the field begins.
    place: (usize, f64),
    ratio: Vec3,
    weighted: bool,
    rng: &'r mut R,
    tally: &'r mut Tally,
}

impl<C: ChannelMode, R: Rng + Clone> FieldKernel for FlyThrough<'_, C, R> {
    type Output = bool;

    #[inline(always)]
    fn run<F: ExactField>(self, field: F) -> bool {
        let (medium, t_enter) = self.place;
        let (walk, decision) = match self.first {
            Some([depth, u]) => (TentativeCollisions::with_first(field, depth), Some(u)),
            None => (TentativeCollisions::new(field), None),
        };
        let (ratio, weighted) = (self.ratio, self.weighted);
        let collisions = OneMedium { walk, medium, t_enter, ratio, weighted };
        // In registers through the loop, which values behind references are not.
        let (mut rng, mut tally) = (self.rng.clone(), Tally::default());
        let ended = self.channels.fly(self.flight, collisions, decision, &mut rng, &mut tally);
        *self.rng = rng;
        self.tally.merge(&tally);
        ended
    }
}

/// Ratio tracking through one field.
struct ShadowThrough<'r, C, R> {
    channels: C,
    threshold: f32,
    rng: &'r mut R,
    tally: &'r mut Tally,
}

impl<C: Channels, R: Rng + Clone> FieldKernel for ShadowThrough<'_, C, R> {
    type Output = RatioEstimate<C::Value>;

    #[inline(always)]
    fn run<F: ExactField>(self, field: F) -> RatioEstimate<C::Value> {
        let ShadowThrough { channels, threshold, .. } = self;
        let walk = TentativeCollisions::new(field);
        // As in flights.
        let (mut rng, mut tally) = (self.rng.clone(), Tally::default());
        let estimate =
            ratio_tracking_with_roulette(walk, channels, threshold, &mut rng, &mut tally);
        *self.rng = rng;
        self.tally.merge(&tally);
        estimate
    }
}

impl<'a, C: ChannelMode> Merged<'a, C> {
    pub(crate) fn new(
        (media, index): (&'a [Arc<Medium>], &'a MediaIndex),
        methods: Methods,
        channels: C,
        series: DebiasingSeries,
    ) -> Merged<'a, C> {
        let tracks = matches!(methods.distance, DistanceSampler::Spectral | DistanceSampler::Delta);
        let weighs = [false, true].map(|grey| methods.weigh_the_way(grey));
        Merged { media, index, methods, channels, series, tracks, weighs }
    }

    /// Whether shadow rays walk a medium by the same collisions as flights, so that null decisions
    /// belong into weights.
    #[inline(always)]
    fn weighs(&self, medium: &Medium, ray: &Ray, t_max: f64) -> bool {
        let grey = C::GREY || medium.chromatic_ratio() == Vec3::ONE;
        self.weighs[usize::from(grey)]
            && (grey || !endless(medium, ray, t_max))
            && medium.transmittance_function().is_none()
    }

    /// Flies through a grid that no other medium overlaps, as the kernels of one grid do; whether
    /// no channel is under way behind it.
    #[inline(always)]
    fn fly_through_grid<R: Rng + Clone>(
        &self,
        number: usize,
        segment: &RaySegment<'_>,
        flight: &mut C::Flight,
        first: Option<[f32; 2]>,
        (rng, tally): (&mut R, &mut Tally),
    ) -> bool {
        let medium = &*self.media[number];
        let (channels, ratio) = (self.channels, medium.chromatic_ratio());
        let share = if C::GREY { 1.0 } else { channels.share(flight, ratio) };
        // Clear for all channels under way.
        if !C::GREY && share <= 0.0 {
            return false;
        }
        let RaySegment { ray, start, t_max } = *segment;
        let Some(span) = medium.span(ray.origin, ray.direction, t_max) else { return false };
        let mut weighted = self.weighs[usize::from(C::GREY || ratio == Vec3::ONE)];
        let mut rate = 1.0;
        if let Some(function) = medium.transmittance_function() {
            weighted = false;
            rate = passage(function, start, number).rate(rng).unwrap_or(1.0);
        }
        let ratio = if C::GREY { Vec3::ONE } else { ratio / share };
        let place = (number, span.t_enter);
        let kernel = FlyThrough { channels, flight, first, place, ratio, weighted, rng, tally };
        medium.with_ray(&span, share * rate, kernel)
    }

    /// Flies through one medium that no other overlaps; whether no channel is under way behind it.
    #[inline(always)]
    fn fly_through<R: Rng + Clone>(
        &self,
        entry: &Entry<'_>,
        weighted: bool,
        flight: &mut C::Flight,
        first: Option<[f32; 2]>,
        (rng, tally): (&mut R, &mut Tally),
    ) -> bool {
        let (channels, ratio) = (self.channels, entry.ratio());
        let share = channels.share(flight, ratio);
        // Clear for all channels under way.
        if !C::GREY && share <= 0.0 {
            return false;
        }
        let ratio = if C::GREY { ratio } else { ratio / share };
        let place = (entry.medium(), entry.t());
        entry.with_field(
            share,
            FlyThrough { channels, flight, first, place, ratio, weighted, rng, tally },
        )
    }

    /// Flies past several media, or some that need more than a walk.
    #[inline(never)]
    fn fly_past<R: Rng + Clone>(
        &self,
        segment: RaySegment<'_>,
        met: &[u32],
        mut first: Option<[f32; 2]>,
        flight: &mut C::Flight,
        (rng, tally): (&mut R, &mut Tally),
    ) -> (bool, Option<Collision>) {
        let ray = segment.ray;
        let mut entries = Entries::<'a>::new();
        for &number in met {
            let number = number as usize;
            if let Some(entry) = Entry::new(number, &self.media[number], ray, segment.t_max) {
                entries.push(entry);
            }
        }
        // Of media that begin at the same point the one where the ray starts is the nearest, then
        // the densest, whatever order the index found them in: it stops most flights, and the
        // others are walked no further.
        let rank = |entry: &Entry<'_>| {
            let number = entry.medium();
            (segment.start != Some(number), self.index.ranks[number])
        };
        let farther_first = |a: &Entry<'_>, b: &Entry<'_>| {
            b.t().total_cmp(&a.t()).then_with(|| rank(b).cmp(&rank(a)))
        };
        if let [a, b] = entries.as_mut_slice() {
            if farther_first(a, b).is_gt() {
                std::mem::swap(a, b);
            }
        } else {
            entries.sort_unstable_by(farther_first);
        }
        if !self.tracks {
            let nearest = self.fly_each(segment, entries, first, flight, (rng, tally));
            return (false, nearest);
        }
        let mut nearest: Option<Collision> = None;
        if self.index.special {
            (entries, nearest) = self.fly_own(segment, entries, flight, (rng, tally));
        }
        let t_max = nearest.map_or(segment.t_max, |nearest| nearest.t);
        if C::GREY {
            // Null decisions are asked for only where nothing has collided, and then each medium
            // was walked to its end.
            let mut ended = false;
            while let Some(mut entry) = entries.pop() {
                if let Some(t) = flight.t_end() {
                    // All others begin behind as well.
                    let Some(before) = entry.before(t) else { break };
                    entry = before;
                }
                let weighted = self.weighs(&self.media[entry.medium()], ray, t_max);
                let found = self.fly_through(&entry, weighted, flight, first.take(), (rng, tally));
                // One flight ends in one collision.
                tally.collisions -= u64::from(ended && found);
                ended |= found;
            }
            return (ended, nearest);
        }
        // One after the other, as long as none overlaps the next.
        while let Some(entry) = entries.pop() {
            if entries.last().is_some_and(|next| next.t() < entry.t_exit()) {
                entries.push(entry);
                break;
            }
            let weighted = self.weighs(&self.media[entry.medium()], ray, t_max);
            if self.fly_through(&entry, weighted, flight, first.take(), (rng, tally)) {
                return (true, nearest);
            }
        }
        if entries.is_empty() {
            return (false, nearest);
        }
        let mut ahead = SmallVec::new();
        for entry in entries {
            let ratio = entry.ratio();
            let share = self.channels.share(flight, ratio);
            if share > 0.0 {
                let weighted = self.weighs(&self.media[entry.medium()], ray, t_max);
                ahead.push(Ahead { entry, share, ratio: ratio / share, weighted });
            }
        }
        let (depth, decision) = first.map_or((None, None), |[depth, u]| (Some(depth), Some(u)));
        let mut walkers = SmallVec::new();
        let collisions = ManyMedia::new(&mut ahead, &mut walkers, depth);
        (self.channels.fly(flight, collisions, decision, rng, tally), nearest)
    }

    /// Flies past the media that are not walked: the nearest of their collisions, each by a closed
    /// form of its own, ends the flight if nothing does before. The weights of all count, since
    /// those that flew further stand for the transmittance up to there. Returns the other media,
    /// with rates where their transmittance functions have some, and that collision.
    fn fly_own<R: Rng + Clone>(
        &self,
        RaySegment { ray, start, t_max }: RaySegment<'_>,
        entries: Entries<'a>,
        flight: &mut C::Flight,
        (rng, tally): (&mut R, &mut Tally),
    ) -> (Entries<'a>, Option<Collision>) {
        let mut nearest: Option<Collision> = None;
        let mut walked = Entries::new();
        for mut entry in entries {
            let number = entry.medium();
            let medium = &*self.media[number];
            let own = match medium.transmittance_function() {
                Some(function) if runs_on_rates(medium, function) => {
                    entry.draw_rate(passage(function, start, number), rng);
                    None
                }
                Some(function) => Some(Some(passage(function, start, number))),
                None => too_long_to_walk(medium, ray, t_max).map(|_| None),
            };
            let Some(passage) = own else {
                walked.push(entry);
                continue;
            };
            let drawn = exponential(rng);
            let beta = flight.throughput();
            let result = fly_by_depth(&entry, passage, beta, drawn, rng, tally);
            flight.weigh(result.weight);
            if let Flight::Collision(t) = result.flight {
                let t = entry.at(t);
                if nearest.is_none_or(|nearest| t < nearest.t) {
                    nearest = Some(Collision { t, medium: number });
                }
            }
        }
        if let Some(Collision { t, .. }) = nearest {
            // What lies behind does not concern this flight.
            let clipped = walked.into_iter().filter_map(|entry| entry.before(t));
            walked = clipped.collect();
        }
        (walked, nearest)
    }

    /// Every sampler but those that take the collisions of all media in order: each medium flies
    /// alone, the nearest collision wins, and the weights of all flights count, since those that
    /// flew further stand for the transmittance up to there.
    fn fly_each<R: Rng + Clone>(
        &self,
        RaySegment { ray, start, t_max }: RaySegment<'_>,
        mut entries: Entries<'_>,
        first: Option<[f32; 2]>,
        flight: &mut C::Flight,
        (rng, tally): (&mut R, &mut Tally),
    ) -> Option<Collision> {
        let mut nearest: Option<Collision> = None;
        let mut first = first.map(|[depth, _]| depth);
        let sampler = self.methods.distance;
        while let Some(mut entry) = entries.pop() {
            // What begins behind a collision does not concern this flight.
            let (number, t_enter) = (entry.medium(), entry.t());
            if nearest.is_some_and(|nearest| nearest.t < t_enter) {
                break;
            }
            let medium = &*self.media[number];
            let sampler = match sampler {
                DistanceSampler::Regular | DistanceSampler::Analytic
                    if has_to_be_walked(medium) =>
                {
                    DistanceSampler::Spectral
                }
                sampler => sampler,
            };
            let first = first.take();
            let passage =
                medium.transmittance_function().map(|function| passage(function, start, number));
            let by_depth = match passage {
                Some(passage) => {
                    let exact = sampler == DistanceSampler::Regular;
                    let rates = !exact && runs_on_rates(medium, passage.function);
                    if rates {
                        entry.draw_rate(passage, rng);
                    }
                    !rates
                }
                None => too_long_to_walk(medium, ray, t_max).is_some(),
            };
            let beta = flight.throughput();
            let result = if by_depth {
                let drawn = first.unwrap_or_else(|| exponential(rng));
                fly_by_depth(&entry, passage, beta, drawn, rng, tally)
            } else {
                let ratio = entry.ratio();
                let field = entry.field(1.0);
                if C::GREY || ratio == Vec3::ONE {
                    let WeightedFlight { flight, weight, null_probability } =
                        sampler.fly(field, Grey, 1.0, first, rng, tally);
                    WeightedFlight { flight, weight: Vec3::splat(weight), null_probability }
                } else {
                    sampler.fly(field, ChromaticRatio(ratio), beta, first, rng, tally)
                }
            };
            flight.weigh(result.weight);
            // What shadow rays know in closed form is counted on escape.
            if !by_depth
                && self.weighs(medium, ray, t_max)
                && closed_form(medium, ray, 0.0).is_none()
            {
                flight.count_nulls(result.null_probability);
            }
            if let Flight::Collision(t) = result.flight {
                let t = entry.at(t);
                if nearest.is_none_or(|nearest| t < nearest.t) {
                    nearest = Some(Collision { t, medium: number });
                }
            }
        }
        nearest
    }

    /// Light sampling takes these transmittances in closed form; path sampling had to survive them.
    #[inline(never)]
    fn count_closed_forms(&self, met: &[u32], ray: &Ray, t_max: f64, flight: &mut C::Flight) {
        for &index in met {
            if let Some(transmittance) = closed_form(&self.media[index as usize], ray, t_max) {
                flight.count_nulls(transmittance);
            }
        }
    }

    /// Transmittance of one medium, and the null probability that weights count with it.
    #[inline]
    fn estimate<K: Channels, R: Rng + Clone>(
        &self,
        entry: &Entry<'_>,
        (share, channels): (f32, K),
        known: bool,
        threshold: f32,
        (rng, tally): (&mut R, &mut Tally),
    ) -> (K::Value, K::Value) {
        if self.by_ratio() || entry.has_to_be_walked() {
            let kernel = ShadowThrough { channels, threshold, rng, tally };
            let estimate = entry.with_field(share, kernel);
            let nulls = if known { estimate.null_probability } else { K::Value::ONE };
            return (estimate.transmittance, nulls);
        }
        let (estimator, field) = (self.methods.transmittance, entry.field(share));
        let transmittance = estimator.estimate(field, channels, threshold, rng, tally);
        (transmittance, if known { transmittance } else { K::Value::ONE })
    }

    /// What a shadow ray of a path with throughput `beta` finds of medium number `number`.
    #[inline]
    fn shadow<R: Rng + Clone>(
        &self,
        number: usize,
        segment: &RaySegment<'_>,
        threshold: f32,
        beta: Vec3,
        (rng, tally): (&mut R, &mut Tally),
    ) -> Shadow {
        let medium = &*self.media[number];
        let ratio = medium.chromatic_ratio();
        let grey = C::GREY || ratio == Vec3::ONE;
        if self.by_ratio() && self.index.walks[number] != Walk::Other {
            let RaySegment { ray, start, t_max } = *segment;
            let Some(span) = medium.span(ray.origin, ray.direction, t_max) else {
                return Shadow::CLEAR;
            };
            let mut known = self.weighs[usize::from(grey)];
            let mut rate = 1.0;
            if let Some(function) = medium.transmittance_function() {
                known = false;
                rate = passage(function, start, number).rate(rng).unwrap_or(1.0);
            }
            if grey {
                let kernel = ShadowThrough { channels: Grey, threshold, rng, tally };
                let estimate = medium.with_ray(&span, rate, kernel);
                let nulls = if known { estimate.null_probability } else { 1.0 };
                return Shadow {
                    transmittance: Vec3::splat(estimate.transmittance),
                    null_probability: Vec3::splat(nulls),
                };
            }
            let Some((share, ratios)) = self.channels.shadow_ratios(beta, ratio) else {
                return Shadow::CLEAR;
            };
            let kernel = ShadowThrough { channels: ChromaticRatio(ratios), threshold, rng, tally };
            let estimate = medium.with_ray(&span, share * rate, kernel);
            let nulls = if known { estimate.null_probability } else { Vec3::ONE };
            return Shadow { transmittance: estimate.transmittance, null_probability: nulls };
        }
        self.shadow_of_other(number, *segment, threshold, beta, (rng, tally))
    }

    /// Whether shadow rays run by ratio tracking.
    #[inline(always)]
    fn by_ratio(&self) -> bool {
        self.methods.transmittance == Estimator::Ratio
    }

    /// What a shadow ray finds of a medium that is no grid, or by another estimator than ratio
    /// tracking.
    #[inline(never)]
    fn shadow_of_other<R: Rng + Clone>(
        &self,
        number: usize,
        RaySegment { ray, start, t_max }: RaySegment<'_>,
        threshold: f32,
        beta: Vec3,
        (rng, tally): (&mut R, &mut Tally),
    ) -> Shadow {
        let medium = &*self.media[number];
        let ratio = medium.chromatic_ratio();
        let grey = C::GREY || ratio == Vec3::ONE;
        if let Some(known) = known_transmittance(medium, ray, t_max) {
            return known;
        }
        let Some(mut entry) = Entry::new(number, medium, ray, t_max) else {
            return Shadow::CLEAR;
        };
        if let Some(function) = medium.transmittance_function() {
            let passage = passage(function, start, number);
            if !self.draw_rate(&mut entry, passage, rng) {
                let transmittance = self.exact_or_debiased(&entry, passage, rng, tally);
                return Shadow { transmittance, ..Shadow::CLEAR };
            }
        }
        let known = self.weighs[usize::from(grey)] && medium.transmittance_function().is_none();
        if grey {
            let of_all = (1.0, Grey);
            let (t, n) = self.estimate(&entry, of_all, known, threshold, (rng, tally));
            return Shadow { transmittance: Vec3::splat(t), null_probability: Vec3::splat(n) };
        }
        let ratios = if self.by_ratio() {
            self.channels.shadow_ratios(beta, ratio)
        } else {
            Some((1.0, ratio))
        };
        let Some((share, ratios)) = ratios else { return Shadow::CLEAR };
        let channels = (share, ChromaticRatio(ratios));
        let (transmittance, null_probability) =
            self.estimate(&entry, channels, known, threshold, (rng, tally));
        Shadow { transmittance, null_probability }
    }

    /// Draws a rate for a shadow ray, if the plan's estimator and the transmittance function of the
    /// medium run on one.
    #[inline]
    fn draw_rate<R: Rng + Clone>(
        &self,
        entry: &mut Entry<'_>,
        passage: Passage<'_>,
        rng: &mut R,
    ) -> bool {
        let medium = &*self.media[entry.medium()];
        let rates = !matches!(
            self.methods.transmittance,
            Estimator::Regular | Estimator::DebiasedRayMarching
        ) || has_to_be_walked(medium);
        let rates = rates && runs_on_rates(medium, passage.function);
        if rates {
            entry.draw_rate(passage, rng);
        }
        rates
    }

    /// Transmittance under a function that is not exponential, exact or by a debiasing series.
    #[inline(never)]
    fn exact_or_debiased<R: Rng + Clone>(
        &self,
        entry: &Entry<'_>,
        passage: Passage<'_>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Vec3 {
        let (field, channels) = (entry.field(1.0), ChromaticRatio(entry.ratio()));
        if self.methods.transmittance == Estimator::DebiasedRayMarching {
            return debiased_non_exponential(field, passage, channels, self.series, rng, tally);
        }
        exact_non_exponential(&field, passage, channels, tally)
    }
}

/// The phase function at a collision, if it is neither isotropic nor Henyey-Greenstein, the same
/// everywhere.
#[inline(never)]
fn other_phase<'m, R: Rng>(
    medium: &'m Medium,
    p_world: DVec3,
    incoming: Vec3,
    rng: &mut R,
) -> PhaseAt<'m> {
    medium.phase_at(p_world, incoming, rng)
}

/// A flight by inversion of the optical depth.
#[inline(never)]
fn fly_by_depth<R: Rng + Clone>(
    entry: &Entry<'_>,
    passage: Option<Passage<'_>>,
    beta: Vec3,
    drawn: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> WeightedFlight<Vec3> {
    let (field, channels) = (entry.field(1.0), ChromaticRatio(entry.ratio()));
    match passage {
        None => regular_flight(&field, channels, beta, drawn, rng, tally),
        Some(passage) => {
            regular_flight_non_exponential(&field, passage, channels, beta, drawn, rng, tally)
        }
    }
}

impl<'a, C: ChannelMode> Media for Merged<'a, C> {
    type Channels = C;

    fn flight<R: Rng + Clone>(
        &self,
        segment: RaySegment<'_>,
        beta: Vec3,
        first: Option<[f32; 2]>,
        decoupled: &mut C::Decoupled,
        rng: &mut R,
        tally: &mut Tally,
    ) -> FlightEnd<C::Nulls> {
        let mut flight = C::Flight::begin(beta);
        // Most rays meet one medium.
        match self.index.at_most_one(segment.ray, segment.t_max) {
            AtMostOne::None => return flight.end(None, decoupled),
            AtMostOne::One(number) if self.tracks && self.index.walks[number] != Walk::Other => {
                self.fly_through_grid(number, &segment, &mut flight, first, (rng, tally));
                return flight.end(None, decoupled);
            }
            _ => {}
        }
        let mut found = MetMedia::new();
        let met = self.index.along(segment.ray, segment.t_max, &mut found);
        let (ended, own) = self.fly_past(segment, met, first, &mut flight, (rng, tally));
        if self.index.homogeneous && !ended && own.is_none() {
            self.count_closed_forms(met, segment.ray, segment.t_max, &mut flight);
        }
        flight.end(own, decoupled)
    }

    fn transmittance<R: Rng + Clone>(
        &self,
        segment: RaySegment<'_>,
        threshold: f32,
        beta: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        match self.index.at_most_one(segment.ray, segment.t_max) {
            AtMostOne::None => return Shadow::CLEAR,
            AtMostOne::One(number) => {
                return self.shadow(number, &segment, threshold, beta, (rng, tally));
            }
            AtMostOne::More => {}
        }
        let mut shadow = Shadow::CLEAR;
        let mut found = MetMedia::new();
        for &index in self.index.along(segment.ray, segment.t_max, &mut found) {
            let number = index as usize;
            let found = self.shadow(number, &segment, threshold, beta, (rng, tally));
            shadow.transmittance *= found.transmittance;
            shadow.null_probability *= found.null_probability;
            if shadow.transmittance == Vec3::ZERO {
                break;
            }
        }
        shadow
    }

    fn scattering<R: Rng + Clone>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
        mut visit: impl FnMut(Vec3, PhaseAt<'_>),
    ) {
        for index in self.index.around(p_world) {
            let medium = &self.media[index as usize];
            let sigma_t = medium.sigma_t_at(p_world) as f32;
            if sigma_t > 0.0 {
                // From a place that is correlated with no scatterer: the density of a collision at
                // no depth.
                let per_path = medium
                    .transmittance_function()
                    .map_or(1.0, |function| 1.0 / function.mean_free_path() as f32);
                let sigma_t = sigma_t * per_path * medium.projected_area(p_world, incoming);
                let sigma_t = medium.chromatic_ratio() * sigma_t;
                visit(medium.albedo_at(p_world) * sigma_t, medium.phase_at(p_world, incoming, rng));
            }
        }
    }

    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)> {
        let mut hull: Option<(f64, f64)> = None;
        let mut found = MetMedia::new();
        for &index in self.index.along(ray, t_max, &mut found) {
            let medium = &self.media[index as usize];
            if let Some(span) = medium.span(ray.origin, ray.direction, t_max) {
                let (t0, t1) = span.extent();
                hull = Some(hull.map_or((t0, t1), |(a, b)| (a.min(t0), b.max(t1))));
            }
        }
        hull
    }

    #[inline(always)]
    fn properties<R: Rng + Clone>(
        &self,
        collision: &Collision,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> (PhaseAt<'_>, Vec3) {
        let medium = &*self.media[collision.medium];
        let phase = match medium.phase().hg_or_isotropic() {
            Some(phase) => phase,
            None => other_phase(medium, p_world, incoming, rng),
        };
        (phase, medium.albedo_at(p_world))
    }

    fn starts_matter(&self) -> bool {
        self.index.non_exponential
    }
}
