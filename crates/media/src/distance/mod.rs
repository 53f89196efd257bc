//! Free-flight samplers: where the next real collision is. One file per sampler, and one row per
//! sampler in the table below.

mod decomposition;
mod delta;
mod depth;
mod equiangular;
mod non_exponential;
mod progressive;
mod ray_marching;
mod regular;
mod spectral;
mod tracking;
mod weighted_delta;

use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::ExactField;
use crate::method::methods;
use crate::random::exponential;
use crate::tally::Tally;
use decomposition::decomposition_tracking;
use delta::delta_tracking_by_mean;
use rand_core::Rng;
use ray_marching::MARCHING_STEPS;
use spectral::spectral_tracking;
use weighted_delta::weighted_delta_tracking;

pub use delta::delta_tracking;
pub use equiangular::Equiangular;
pub use non_exponential::regular_flight_non_exponential;
pub use progressive::ProgressiveBounds;
pub use ray_marching::ray_marching_flight;
pub use regular::regular_flight;
pub use spectral::real_probability;

/// How a free flight ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flight {
    /// A real collision at this ray parameter.
    Collision(f32),
    /// The ray left the field.
    Escape,
}

/// A free flight with what the throughput is to be multiplied by.
///
/// The measure `sigma_t(t) exp(-tau(t)) dt`, with the rest `exp(-tau(end))` at the escape, is the
/// mean of the weighted flights in every channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeightedFlight<S> {
    /// How it ended.
    pub flight: Flight,
    /// Factor on the throughput per channel; the albedo is not in it.
    pub weight: S,
    /// Probability of all decisions for null collisions on the way; for samplers that know the
    /// optical depth, on escape, the transmittance.
    pub null_probability: f32,
}

methods! {
    /// A way to sample the distance to the next real collision. Grey or per channel.
    pub enum DistanceSampler called "Distance", "How distances are sampled";

    /// Flies through `field` with throughput `beta`. Unbiased or biased as
    /// [`DistanceSampler::facts`] says. `first`: an exponential variate to use first, for
    /// stratified flights.
    ///
    /// `Analytic` inverts the depth as `Regular` does, which for constant extinction is its closed
    /// form: whether a field is of that kind is the caller's to know. `Split` and `Equiangular` are
    /// made of several flights, of which this is one: by delta tracking for one channel, by
    /// spectral tracking for several.
    pub fn fly[F: ExactField, C: Channels, R: Rng + ?Sized](
        field: F,
        channels: C,
        beta: C::Value,
        first: Option<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> WeightedFlight<C::Value>;

    /// Closed form: homogeneous volumes only.
    Analytic = "analytic", Facts::EXACT
        => regular_flight(&field, channels, beta, drawn(first, rng), rng, tally);

    /// Delta tracking on local majorants; with several channels their plain mean decides, whatever
    /// their throughput.
    Delta = "delta",
        Facts::unbiased(Work::MajorantDepth)
            .needs_bounds()
            .breaks("channels that are thinner than the mean gain weight at every null collision")
            .breaks_without_bounds("acceptance saturates where the bound does not hold")
        => delta_tracking_by_mean(walk(field, first, rng), channels, rng, tally);

    /// Delta tracking with weights, which holds also where majorants do not bound.
    WeightedDelta = "weighted_delta",
        Facts::unbiased(Work::MajorantDepth)
            .breaks("weights change sign and grow at every null collision where the bound does not hold")
        => weighted_delta_tracking(walk(field, first, rng), channels, beta, rng, tally);

    /// Delta tracking in which collisions with the lower bound need no lookup.
    Decomposition = "decomposition",
        Facts::unbiased(Work::MajorantDepth)
            .needs_bounds()
            .breaks("weights of channels reach their number")
            .breaks_without_bounds("probabilities saturate where the bound does not hold")
        => decomposition_tracking(walk(field, first, rng), channels, beta, rng, tally);

    /// Exact inversion of the optical depth, cell by cell.
    Regular = "regular", Facts::EXACT
        => regular_flight(&field, channels, beta, drawn(first, rng), rng, tally);

    /// Delta tracking decided by the throughput-weighted mean over channels.
    Spectral = "spectral",
        Facts::unbiased(Work::MajorantDepth)
            .needs_bounds()
            .breaks("weights of channels reach their number")
            .breaks_without_bounds("probabilities saturate where the bound does not hold")
        => spectral_tracking(walk(field, first, rng), channels, beta, rng, tally);

    /// Plain ray marching with 64 steps.
    RayMarching = "ray_marching",
        Facts::biased("volumes are too transparent and too smooth")
            .breaks("extinction taken for constant within a step")
        => {
            let drawn = drawn(first, rng);
            ray_marching_flight(field, channels, beta, MARCHING_STEPS, drawn, rng, tally)
        };

    /// Extinction per channel: channels fly coupled by delta tracking and decouple where their
    /// events differ, so that none is weighted. Where that does not apply the flights of `auto`.
    Split = "split",
        Facts::unbiased(Work::MajorantDepth)
            .needs_bounds()
            .under(Transmittances::All)
            .breaks("channels that decouple make up to three paths of one")
        => spectral_tracking(walk(field, first, rng), channels, beta, rng, tally);

    /// The flights of `auto`, and for point and spot lights points seen from them at equal angles,
    /// the two weighted against each other.
    Equiangular = "equiangular",
        Facts::unbiased(Work::MajorantDepth)
            .needs_bounds()
            .under(Transmittances::Exponential)
            .breaks("points ignore the medium")
        => spectral_tracking(walk(field, first, rng), channels, beta, rng, tally);
}

impl DistanceSampler {
    /// Whether [`DistanceSampler::fly`] is all there is to it: the others, `Split` and
    /// `Equiangular`, are made of several flights.
    pub const fn is_one_flight(self) -> bool {
        !matches!(self, DistanceSampler::Split | DistanceSampler::Equiangular)
    }

    /// Whether it is unbiased also where bounds do not hold.
    pub const fn is_unbiased_without_bounds(self) -> bool {
        self.is_unbiased() && !self.facts().needs_bounds
    }

    /// Whether it walks the majorants' tentative collisions and decides at each by a probability:
    /// the path densities of ratio tracking apply to it.
    pub const fn decides_at_collisions(self) -> bool {
        self.facts().needs_bounds
    }
}

/// The exponential variate of a flight: the given one or a new one.
fn drawn<R: Rng + ?Sized>(first: Option<f32>, rng: &mut R) -> f32 {
    first.unwrap_or_else(|| exponential(rng))
}

/// The tentative collisions of a flight.
fn walk<F: ExactField, R: Rng + ?Sized>(
    field: F,
    first: Option<f32>,
    rng: &mut R,
) -> TentativeCollisions<F> {
    TentativeCollisions::with_first(field, drawn(first, rng))
}
