//! Media of which one at least follows a law that is not exponential.
//!
//! Such a law has a memory: a flight is one piece from where it starts to the next real collision or surface. Null collisions do not reset it, and nothing is a product over
//! parts of a ray. A ray that starts at a particle of a medium is correlated with that medium alone; light, cameras and surfaces are not correlated
//! with any. Laws that are mixtures of exponential ones run the ordinary trackers and estimators with an extinction times a drawn rate; others invert the depth exactly.

use super::overlapping::{Entry, too_long_to_walk};
use super::{Collision, Flown, Leg, Media, Overlapping, Ray, Shadow, Start, Together};
use glam::{DVec3, Vec3};
use pileus_media::distance::{
    DistanceSampler, Flight, WeightedFlight, regular_flight, regular_flight_under_law,
};
use pileus_media::law::{self, Law, Passage};
use pileus_media::random::exponential;
use pileus_media::transmittance::{
    Estimator, Telescope, debiased_under_law, exact_under_law, ratio_tracking_with_roulette,
};
use pileus_media::{ExactField, Medium, PhaseAt, Relative, Scaled, Tally, TentativeCollisions};
use rand_core::Rng;

/// All media of a scene, as a list, some of them under laws. Always in three channels: one kernel serves all such scenes.
pub(crate) struct UnderLaw<'a> {
    /// The media as they are without their laws.
    pub(crate) plain: Overlapping<'a>,
    /// How debiased ray marching chooses its levels.
    pub(crate) telescope: Telescope,
}

/// A medium's law seen from where a ray starts.
fn passage(law: &Law, start: Start, medium: usize) -> Passage<'_> {
    let correlated = start == Some(medium);
    Passage {
        law,
        start: if correlated { law::Start::Correlated } else { law::Start::Uncorrelated },
    }
}

/// Whether a medium's flights and shadow rays run on a drawn rate: homogeneous media have closed forms.
fn runs_on_rates(medium: &Medium, law: &Law) -> bool {
    medium.grid().is_some() && law.is_mixture_of_exponentials()
}

impl UnderLaw<'_> {
    /// A flight through one medium, as if no other were there.
    fn fly<R: Rng>(
        &self,
        (medium, entry, start, long): (usize, &Entry<'_>, Start, bool),
        beta: Vec3,
        first: Option<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> WeightedFlight<Vec3> {
        let (number, medium) = (medium, &self.plain.media[medium]);
        let channels = Relative(medium.chromatic_ratio());
        let sampler = self.plain.methods.distance;
        let Some(law) = medium.transmittance_function() else {
            if long {
                let drawn = first.unwrap_or_else(|| exponential(rng));
                return regular_flight(&entry.field(), channels, beta, drawn, rng, tally);
            }
            return sampler.fly(entry.field(), channels, beta, first, rng, tally);
        };
        let passage = passage(law, start, number);
        if sampler != DistanceSampler::Regular
            && runs_on_rates(medium, law)
            && let Some(rate) = passage.rate(rng)
        {
            let field = Scaled::new(entry.field(), rate);
            return sampler.fly(field, channels, beta, first, rng, tally);
        }
        let drawn = first.unwrap_or_else(|| exponential(rng));
        regular_flight_under_law(&entry.field(), passage, channels, beta, drawn, rng, tally)
    }

    /// Transmittance of one medium under a law.
    fn shadow<F: ExactField, R: Rng>(
        &self,
        (medium, field, passage): (&Medium, F, Passage<'_>),
        threshold: f32,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Vec3 {
        let channels = Relative(medium.chromatic_ratio());
        let estimator = self.plain.methods.transmittance;
        if estimator == Estimator::DebiasedRayMarching {
            return debiased_under_law(field, passage, channels, self.telescope, rng, tally);
        }
        if estimator != Estimator::Regular
            && runs_on_rates(medium, passage.law)
            && let Some(rate) = passage.rate(rng)
        {
            let field = Scaled::new(field, rate);
            if estimator == Estimator::Ratio {
                let walk = TentativeCollisions::new(field);
                return ratio_tracking_with_roulette(walk, channels, threshold, rng, tally)
                    .transmittance;
            }
            return estimator.estimate(field, channels, threshold, rng, tally);
        }
        exact_under_law(&field, passage, channels, tally)
    }
}

impl Media for UnderLaw<'_> {
    type Nulls = f32;
    type Others = Together;
    const LAWS: bool = true;

    /// Medium by medium in the order in which the ray meets them; the nearest collision counts. Where a flight through one medium goes on behind
    /// the collision of another, its weight stands for its survival up to there, in the mean.
    fn flight<R: Rng>(
        &self,
        Leg { ray, start, t_max }: Leg<'_>,
        first: Option<[f32; 2]>,
        flown: &mut Flown<f32>,
        _: &mut Together,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let mut first = first.map(|[depth, _]| depth);
        let met = self.plain.index.along(ray, t_max);
        let mut ahead = self.plain.ahead(&met, ray, t_max);
        let mut nearest: Option<Collision> = None;
        while let Some((medium, entry)) = ahead.pop() {
            let t_enter = entry.t();
            if nearest.is_some_and(|nearest| nearest.t < t_enter) {
                break;
            }
            let long = too_long_to_walk(&self.plain.media[medium], ray, t_max).is_some();
            let own = (medium, &entry, start, long);
            let flight = self.fly(own, flown.beta, first.take(), rng, tally);
            flown.beta *= flight.weight;
            if let Flight::Collision(t) = flight.flight {
                let t = entry.at(t);
                if nearest.is_none_or(|nearest| t < nearest.t) {
                    nearest = Some(Collision { t, medium });
                }
            }
        }
        nearest
    }

    fn transmittance<R: Rng>(
        &self,
        Leg { ray, start, t_max }: Leg<'_>,
        threshold: f32,
        _: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        let mut shadow = Shadow::CLEAR;
        for index in self.plain.index.along(ray, t_max) {
            let index = index as usize;
            let medium = &*self.plain.media[index];
            let part = match medium.transmittance_function() {
                Some(law) => Entry::new(medium, ray, t_max).map(|entry| {
                    let own = (medium, entry.field(), passage(law, start, index));
                    self.shadow(own, threshold, rng, tally)
                }),
                None => {
                    let part = self.plain.through(medium, (ray, t_max), threshold, rng, tally);
                    part.map(|part| part.transmittance)
                }
            };
            let Some(part) = part else { continue };
            shadow.transmittance *= part;
            if shadow.transmittance == Vec3::ZERO {
                break;
            }
        }
        shadow
    }

    /// Scattering per length from a place: the law's density at no depth times the extinction.
    fn scattering<R: Rng>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
        visit: impl FnMut(Vec3, PhaseAt<'_>),
    ) {
        let per_path =
            |medium: &Medium| medium.transmittance_function().map_or(1.0, |law| 1.0 / law.mean_free_path() as f32);
        self.plain.scattering_times(per_path, (p_world, incoming), rng, visit);
    }

    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)> {
        self.plain.extent(ray, t_max)
    }

    fn properties<R: Rng>(
        &self,
        collision: &Collision,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> (PhaseAt<'_>, Vec3) {
        self.plain.properties(collision, p_world, incoming, rng)
    }
}
