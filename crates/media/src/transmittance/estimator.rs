//! All estimators by name.

use super::bidirectional::{BIDIRECTIONAL_STRETCH, bidirectional};
use super::debiased_ray_marching::{DEBIASED_TEETH, debiased_ray_marching};
use super::delta::delta_transmittance;
use super::next_flight::next_flight;
use super::pseries::{PSERIES_STRETCH, pseries_cmf, pseries_cumulative};
use super::ratio::ratio_tracking_with_roulette;
use super::ray_marching::{MARCHING_TEETH, ray_marching};
use super::residual_ratio::{Control, residual_ratio_tracking};
use super::taylor::{TAYLOR_STRETCH, TaylorOrder, taylor};
use super::unbiased_ray_marching::unbiased_ray_marching;
use super::volterra::{VOLTERRA_STRETCH, volterra};
use crate::channels::Channels;
use pileus_math::Spectrum;
use crate::collisions::TentativeCollisions;
use crate::field::ExactField;
use crate::tally::Tally;
use rand_core::Rng;

/// Optical depth whose transmittance is zero in single precision.
const OPAQUE: f64 = 88.0;

/// A way to estimate the transmittance of a ray. Grey or per channel: one walk, one set of points for all channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Estimator {
    /// Exact, cell by cell.
    Regular,
    /// Whether a free flight gets through.
    Delta,
    /// Product of null probabilities.
    Ratio,
    /// Ratio tracking of what exceeds the minorant.
    ResidualRatio,
    /// Probability of reaching the end from every vertex.
    NextFlight,
    /// Volterra recursion without null collisions.
    Volterra,
    /// Taylor series about zero depth.
    Taylor,
    /// Power series about the majorant, order by the size of its terms.
    PseriesCumulative,
    /// Power series about the majorant, order by the majorant depth.
    PseriesCmf,
    /// Null-collision series from both ends.
    Bidirectional,
    /// Combs with a pivot and symmetric means.
    UnbiasedRayMarching,
    /// Ray marching with a telescoping series.
    DebiasedRayMarching,
    /// Plain ray marching: biased.
    RayMarching,
}

impl Estimator {
    /// All of them.
    pub const ALL: [Estimator; 13] = [
        Estimator::Regular,
        Estimator::Delta,
        Estimator::Ratio,
        Estimator::ResidualRatio,
        Estimator::NextFlight,
        Estimator::Volterra,
        Estimator::Taylor,
        Estimator::PseriesCumulative,
        Estimator::PseriesCmf,
        Estimator::Bidirectional,
        Estimator::UnbiasedRayMarching,
        Estimator::DebiasedRayMarching,
        Estimator::RayMarching,
    ];

    /// The name that jobs use.
    pub const fn name(self) -> &'static str {
        match self {
            Estimator::Regular => "regular",
            Estimator::Delta => "delta",
            Estimator::Ratio => "ratio",
            Estimator::ResidualRatio => "residual_ratio",
            Estimator::NextFlight => "next_flight",
            Estimator::Volterra => "volterra",
            Estimator::Taylor => "taylor",
            Estimator::PseriesCumulative => "pseries_cumulative",
            Estimator::PseriesCmf => "pseries_cmf",
            Estimator::Bidirectional => "bidirectional",
            Estimator::UnbiasedRayMarching => "unbiased_ray_marching",
            Estimator::DebiasedRayMarching => "debiased_ray_marching",
            Estimator::RayMarching => "ray_marching",
        }
    }

    /// The estimator of a name.
    pub fn from_name(name: &str) -> Option<Estimator> {
        Estimator::ALL.into_iter().find(|estimator| estimator.name() == name)
    }

    /// Whether the mean of estimates is the transmittance (for a field whose bounds hold).
    pub fn is_unbiased(self) -> bool {
        self != Estimator::RayMarching
    }

    /// One estimate of the transmittance of `field`, with the parameters that the estimator's file gives as its own.
    ///
    /// Estimates below `threshold` may be played roulette (0: never).
    pub fn estimate<F: ExactField, C: Channels, R: Rng + ?Sized>(
        self,
        field: F,
        channels: C,
        threshold: f32,
        rng: &mut R,
        tally: &mut Tally,
    ) -> C::Value {
        let whole = f32::INFINITY;
        match self {
            Estimator::Regular => {
                // Behind what leaves no channel any light there is nothing to sum.
                let weakest = (0..C::Value::COUNT)
                    .map(|channel| channels.of(1.0).channel(channel))
                    .filter(|relative| *relative > 0.0)
                    .fold(1.0, f32::min);
                let opaque = OPAQUE / f64::from(weakest);
                let depth = field.t_at_depth(opaque, tally).map_or_else(|all| all, |_| opaque);
                channels.of(depth as f32).map(|d| if d > 0.0 { -d } else { 0.0 }).exp()
            }
            Estimator::Delta => {
                delta_transmittance(TentativeCollisions::new(field), channels, rng, tally)
            }
            Estimator::Ratio => {
                let walk = TentativeCollisions::new(field);
                ratio_tracking_with_roulette(walk, channels, threshold, rng, tally).transmittance
            }
            Estimator::ResidualRatio => {
                residual_ratio_tracking(field, channels, Control::Minorant, threshold, rng, tally)
            }
            Estimator::NextFlight => next_flight(field, channels, rng, tally),
            Estimator::Volterra => {
                volterra(field, channels, VOLTERRA_STRETCH, threshold, rng, tally)
            }
            Estimator::Taylor => {
                taylor(field, channels, TaylorOrder::Terms, TAYLOR_STRETCH, threshold, rng, tally)
            }
            Estimator::PseriesCumulative => {
                pseries_cumulative(field, channels, PSERIES_STRETCH, threshold, rng, tally)
            }
            Estimator::PseriesCmf => {
                pseries_cmf(field, channels, PSERIES_STRETCH, threshold, rng, tally)
            }
            Estimator::Bidirectional => {
                bidirectional(field, channels, BIDIRECTIONAL_STRETCH, threshold, rng, tally)
            }
            Estimator::UnbiasedRayMarching => {
                unbiased_ray_marching(field, channels, whole, threshold, rng, tally)
            }
            Estimator::DebiasedRayMarching => {
                debiased_ray_marching(field, channels, DEBIASED_TEETH, whole, threshold, rng, tally)
            }
            Estimator::RayMarching => ray_marching(field, channels, MARCHING_TEETH, rng, tally),
        }
    }
}
