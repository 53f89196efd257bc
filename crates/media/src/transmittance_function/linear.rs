//! The linear transmittance: particles on a lattice.

use super::StartCorrelation;
use libm::expm1;
use std::fmt;

/// `T(tau) = max(0, 1 - tau)` [Bitterli et al. 2018]: from particle to particle always one unit of
/// depth.
///
/// `p_u` is one up to there, `X_c` is one up to there, and `p_c` is all at it: an atom.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Linear;

impl Linear {
    pub(super) fn survival(self, start: StartCorrelation, tau: f64) -> f64 {
        match start {
            StartCorrelation::Uncorrelated => (1.0 - tau).max(0.0),
            StartCorrelation::Correlated => f64::from(u8::from(tau < 1.0)),
        }
    }

    pub(super) fn density(self, start: StartCorrelation, tau: f64) -> f64 {
        match start {
            StartCorrelation::Uncorrelated => f64::from(u8::from(tau < 1.0)),
            StartCorrelation::Correlated => 0.0,
        }
    }

    pub(super) fn depth(self, start: StartCorrelation, drawn: f64) -> f64 {
        match start {
            StartCorrelation::Uncorrelated => -expm1(-drawn),
            StartCorrelation::Correlated => 1.0,
        }
    }

    pub(super) fn mean_free_path(self) -> f64 {
        1.0
    }

    pub(super) fn has_atom(self, start: StartCorrelation) -> bool {
        start == StartCorrelation::Correlated
    }
}

impl fmt::Display for Linear {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("linear")
    }
}
