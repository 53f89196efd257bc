//! Erlang transmittances: particles that keep apart.

use super::StartCorrelation;
use super::invert::depth_of;
use crate::Error;
use libm::exp;
use std::fmt;

/// Most stages of an Erlang transmittance.
pub(crate) const MAX_STAGES: u32 = 64;

/// Depths between collisions are the sum of `n` exponential stages of mean `1 / n`: a gamma
/// distribution of shape `n` [d'Eon 2018, section 3].
///
/// With `x = n tau`: `X_c = e^-x sum_{j < n} x^j / j!`, `p_c = n e^-x x^(n - 1) / (n - 1)!`,
/// `X_u = e^-x sum_{j < n} (1 - j / n) x^j / j!`. The variance of a flight between collisions is
/// `1 / n`: negative correlation, as of particles that are packed; the limit is the
/// [`Linear`](super::Linear) transmittance function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Erlang {
    n: u32,
}

impl Erlang {
    /// The transmittance function of `n` stages.
    ///
    /// # Errors
    /// Unless `2 <= n <= 64`.
    pub fn new(n: u32) -> Result<Erlang, Error> {
        if (2..=MAX_STAGES).contains(&n) {
            return Ok(Erlang { n });
        }
        Err(Error::invalid(
            format!("n of an Erlang transmittance is {n}"),
            format!(
                "give a whole number from 2 to {MAX_STAGES}; one stage is the exponential transmittance"
            ),
        ))
    }

    /// `e^-x sum_{j < n} weight(j) x^j / j!`.
    fn sum(&self, tau: f64, weight: impl Fn(f64) -> f64) -> f64 {
        let x = f64::from(self.n) * tau;
        let (mut term, mut sum) = (1.0, 0.0);
        for j in 0..self.n {
            let j = f64::from(j);
            sum += weight(j) * term;
            term *= x / (j + 1.0);
        }
        sum * exp(-x)
    }

    pub(super) fn survival(&self, start: StartCorrelation, tau: f64) -> f64 {
        let n = f64::from(self.n);
        // Where the sum would overflow nothing is left.
        if n * tau > 700.0 {
            return 0.0;
        }
        match start {
            StartCorrelation::Uncorrelated => self.sum(tau, |j| 1.0 - j / n),
            StartCorrelation::Correlated => self.sum(tau, |_| 1.0),
        }
    }

    pub(super) fn density(&self, start: StartCorrelation, tau: f64) -> f64 {
        let n = f64::from(self.n);
        if n * tau > 700.0 {
            return 0.0;
        }
        match start {
            StartCorrelation::Uncorrelated => self.survival(StartCorrelation::Correlated, tau),
            StartCorrelation::Correlated => self.sum(tau, |j| if j + 1.0 == n { n } else { 0.0 }),
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

impl fmt::Display for Erlang {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "erlang n {}", self.n)
    }
}
