//! Transmittance of a ray: one file per estimator, and one row per estimator in the table below.

mod bidirectional;
mod debiased_ray_marching;
mod delta;
mod jittered_samples;
mod next_flight;
mod non_exponential;
mod pseries;
mod ratio;
mod ray_marching;
mod regular;
mod residual_ratio;
mod taylor;
mod unbiased_ray_marching;
mod volterra;

use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::ExactField;
use crate::method::methods;
use crate::tally::Tally;
use bidirectional::{BIDIRECTIONAL_INTERVAL_DEPTH, bidirectional};
use delta::delta_transmittance;
use next_flight::next_flight;
use pseries::{PSERIES_INTERVAL_DEPTH, pseries_cmf, pseries_cumulative};
use rand_core::Rng;
use ray_marching::MARCHING_SAMPLES;
use regular::regular_tracking;
use taylor::TAYLOR_INTERVAL_DEPTH;
use volterra::VOLTERRA_INTERVAL_DEPTH;

pub use debiased_ray_marching::{DEBIASED_SAMPLES, debiased_ray_marching};
pub use non_exponential::{
    DebiasingSeries, debiased_non_exponential, debiasing_difference, exact_non_exponential,
};
pub use ratio::{RatioEstimate, ratio_tracking, ratio_tracking_with_roulette};
pub use ray_marching::ray_marching;
pub use regular::optical_depth;
pub(crate) use regular::{ray_depth, ray_t_at_depth};
pub use residual_ratio::{Control, residual_ratio_tracking};
pub use taylor::{TaylorOrder, taylor};
pub use unbiased_ray_marching::unbiased_ray_marching;
pub use volterra::volterra;

methods! {
    /// A way to estimate the transmittance of a ray. Grey or per channel: one walk, one set of
    /// points for all channels.
    pub enum Estimator called "Transmittance", "How transmittance is estimated";

    /// One estimate of the transmittance of `field` per channel, with the parameters that the
    /// estimator's file gives as its own. Exact, unbiased or biased as [`Estimator::facts`] says.
    ///
    /// Estimates below `threshold` may be ended by Russian roulette, which keeps their mean (0:
    /// never).
    pub fn estimate[F: ExactField, C: Channels, R: Rng + ?Sized](
        field: F,
        channels: C,
        threshold: f32,
        rng: &mut R,
        tally: &mut Tally,
    ) -> C::Value;

    /// Exact: the field is integrated cell by cell. No noise; the cost of every voxel on the way.
    Regular = "regular", Facts::EXACT
        => regular_tracking(field, channels, tally);

    /// Delta tracking: whether a free flight gets through.
    Delta = "delta",
        Facts::unbiased(Work::MajorantDepth)
            .needs_bounds()
            .breaks("a yes or no: relative variance 1/T - 1")
            .breaks_without_bounds("acceptance saturates where the bound does not hold")
        => delta_transmittance(TentativeCollisions::new(field), channels, rng, tally);

    /// Ratio tracking: the product of null probabilities.
    Ratio = "ratio",
        Facts::unbiased(Work::MajorantDepth)
            .breaks("relative variance exp(integral of sigma_t^2 / majorant) - 1")
            .breaks_without_bounds("factors are negative where the bound does not hold: variance exp(integral of sigma_t^2 / rate)")
        => {
            let walk = TentativeCollisions::new(field);
            ratio_tracking_with_roulette(walk, channels, threshold, rng, tally).transmittance
        };

    /// Residual ratio tracking: ratio tracking of what exceeds the lower bound.
    ResidualRatio = "residual_ratio",
        Facts::unbiased(Work::MajorantDepth)
            .needs_bounds()
            .breaks("relative variance exp(integral of (sigma_t - minorant)^2 / (majorant - minorant)) - 1")
            .breaks_without_bounds("no bound, no rate for the residual")
        => residual_ratio_tracking(field, channels, Control::Minorant, threshold, rng, tally);

    /// Next-flight: at every vertex, the probability of reaching the end directly.
    NextFlight = "next_flight",
        Facts::unbiased(Work::MajorantDepth)
            .breaks("the answer hangs on vertices near the end: rare, with weight about one")
            .breaks_without_bounds("signed weights where the bound does not hold")
        => next_flight(field, channels, rng, tally);

    /// Volterra recursion without null collisions, on short intervals.
    Volterra = "volterra",
        Facts::unbiased(Work::MajorantDepth)
            .breaks("alternating terms of size tau^k / k!: a factor of variance per unit depth")
        => volterra(field, channels, VOLTERRA_INTERVAL_DEPTH, threshold, rng, tally);

    /// Taylor series about zero depth, on short intervals.
    Taylor = "taylor",
        Facts::unbiased(Work::MajorantDepth)
            .breaks("terms of size tau^k / k! cancel: a factor of variance per unit depth")
        => taylor(field, channels, TaylorOrder::Terms, TAYLOR_INTERVAL_DEPTH, threshold, rng, tally);

    /// Power series about the upper bound, its order by the size of its terms.
    PseriesCumulative = "pseries_cumulative",
        Facts::unbiased(Work::MajorantDepth)
            .breaks("null ratios vary as in ratio tracking, and a first term that is small by chance may end it; rounding adds up over a thousand intervals")
        => pseries_cumulative(field, channels, PSERIES_INTERVAL_DEPTH, threshold, rng, tally);

    /// Power series about the upper bound, its order by the depth of the bound.
    PseriesCmf = "pseries_cmf",
        Facts::unbiased(Work::MajorantDepth).breaks("null ratios vary as in ratio tracking")
        => pseries_cmf(field, channels, PSERIES_INTERVAL_DEPTH, threshold, rng, tally);

    /// Null-collision series from both ends, combined by weights.
    Bidirectional = "bidirectional",
        Facts::unbiased(Work::MajorantDepth)
            .breaks("the noise of intervals multiplies: exponential in their number")
        => bidirectional(field, channels, BIDIRECTIONAL_INTERVAL_DEPTH, threshold, rng, tally);

    /// Unbiased ray marching: equidistant samples, corrected by rare higher orders.
    UnbiasedRayMarching = "unbiased_ray_marching",
        Facts::unbiased(Work::MajorantDepth)
            .breaks("samples miss narrow features or beat with the field; rare corrections carry the rest")
        => unbiased_ray_marching(field, channels, f32::INFINITY, threshold, rng, tally);

    /// Ray marching with a debiasing series.
    DebiasedRayMarching = "debiased_ray_marching",
        Facts::unbiased(Work::Samples)
            .under(Transmittances::All)
            .breaks("differences do not shrink before the samples resolve the feature: slow tail")
        => {
            let whole = f32::INFINITY;
            debiased_ray_marching(field, channels, DEBIASED_SAMPLES, whole, threshold, rng, tally)
        };

    /// Plain ray marching with 64 samples.
    RayMarching = "ray_marching",
        Facts::biased("shadows are too bright")
            .breaks("Jensen's inequality: too bright by T Var[depth] / 2")
        => ray_marching(field, channels, MARCHING_SAMPLES, rng, tally);
}
