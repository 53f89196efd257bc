//! The transmittance function of Davis and Mineev-Weinstein: gamma-distributed optical depth whose
//! variance grows by a power of distance.

use super::StartCorrelation;
use super::invert::depth_of;
use crate::Error;
use libm::{exp, log, log1p};
use std::fmt;

/// `T(tau) = (1 + tau / alpha)^-alpha` with `alpha = tau^(1 - beta) / c^(1 + beta)`,
/// `beta = 2 h - 1` [Davis and Mineev-Weinstein 2011; the parameters of Bitterli et al. 2018].
///
/// The optical depth of rays of mean `tau` has a gamma distribution of variance `(c tau)^(2 h)`:
/// fluctuations with the Hurst exponent `h`. `h = 1` is the power law of `k = 1 / c^2`. For `h` of
/// one half and below `T'(0)` is not -1: fluctuations without correlation, or with a negative one,
/// have no such transmittance function, and are refused. With `y = c^(1 + beta) tau^beta`:
/// `-ln T = tau ln(1 + y) / y`, `L = -(ln T)' = (1 - beta) ln(1 + y) / y + beta / (1 + y)`,
/// `X_c = T L`, `p_c = T (L^2 - L')`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DavisWeinstein {
    h: f64,
    c: f64,
    beta: f64,
    /// `c^(1 + beta)`.
    strength: f64,
}

impl DavisWeinstein {
    /// The transmittance function of a Hurst exponent `h` and a strength of fluctuations `c`.
    ///
    /// # Errors
    /// Unless `0.5 < h <= 1` and `0 < c <= 1000`; at `h = 1` `c` is below 1, as the power law's `k`
    /// is above 1.
    pub fn new(h: f64, c: f64) -> Result<DavisWeinstein, Error> {
        if !(h > 0.5 && h <= 1.0) {
            return Err(Error::invalid(
                format!("h of a Davis-Weinstein transmittance is {h}"),
                "give a number above 0.5 and at most 1: for others there is no finite mean free path between collisions",
            ));
        }
        if !(c > 0.0 && c <= 1e3) || h == 1.0 && c >= 1.0 {
            return Err(Error::invalid(
                format!("c of a Davis-Weinstein transmittance is {c}"),
                "give a number above 0 and at most 1000, below 1 where h is 1: else flights from a surface have no finite mean",
            ));
        }
        let beta = 2.0 * h - 1.0;
        Ok(DavisWeinstein { h, c, beta, strength: exp((1.0 + beta) * log(c)) })
    }

    /// `y` at a depth above zero.
    fn y(&self, tau: f64) -> f64 {
        self.strength * exp(self.beta * log(tau.max(f64::MIN_POSITIVE)))
    }

    /// `T` and `L`.
    fn value_and_rate(&self, tau: f64) -> (f64, f64) {
        let y = self.y(tau);
        let mean = log1p(y) / y;
        (exp(-tau * mean), (1.0 - self.beta) * mean + self.beta / (1.0 + y))
    }

    pub(super) fn survival(&self, start: StartCorrelation, tau: f64) -> f64 {
        if !(tau > 0.0) {
            return 1.0;
        }
        if tau == f64::INFINITY {
            return 0.0;
        }
        let (transmittance, rate) = self.value_and_rate(tau);
        match start {
            StartCorrelation::Uncorrelated => transmittance,
            StartCorrelation::Correlated => transmittance * rate,
        }
    }

    pub(super) fn density(&self, start: StartCorrelation, tau: f64) -> f64 {
        let (transmittance, rate) = self.value_and_rate(tau);
        match start {
            StartCorrelation::Uncorrelated => transmittance * rate,
            StartCorrelation::Correlated => {
                let (y, beta) = (self.y(tau), self.beta);
                let one = 1.0 + y;
                let slope = (1.0 - beta) * (1.0 / one - log1p(y) / y) - beta * y / (one * one);
                transmittance * (rate * rate - beta / tau * slope)
            }
        }
    }

    pub(super) fn depth(&self, start: StartCorrelation, drawn: f64) -> f64 {
        depth_of(drawn, |tau| self.survival(start, tau), |tau| self.density(start, tau))
    }

    pub(super) fn mean_free_path(&self) -> f64 {
        1.0
    }

    pub(super) fn has_atom(&self, _: StartCorrelation) -> bool {
        false
    }
}

impl fmt::Display for DavisWeinstein {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "davis_weinstein h {} c {}", self.h, self.c)
    }
}
