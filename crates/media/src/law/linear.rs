//! The linear law: particles on a lattice.

use super::Start;
use libm::expm1;
use std::fmt;

/// `T(tau) = max(0, 1 - tau)` [Bitterli et al. 2018]: from particle to particle always one unit of
/// depth.
///
/// `p_u` is one up to there, `X_c` is one up to there, and `p_c` is all at it: an atom.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Linear;

impl Linear {
    pub(super) fn survival(self, start: Start, tau: f64) -> f64 {
        match start {
            Start::Uncorrelated => (1.0 - tau).max(0.0),
            Start::Correlated => f64::from(u8::from(tau < 1.0)),
        }
    }

    pub(super) fn density(self, start: Start, tau: f64) -> f64 {
        match start {
            Start::Uncorrelated => f64::from(u8::from(tau < 1.0)),
            Start::Correlated => 0.0,
        }
    }

    pub(super) fn depth(self, start: Start, drawn: f64) -> f64 {
        match start {
            Start::Uncorrelated => -expm1(-drawn),
            Start::Correlated => 1.0,
        }
    }

    pub(super) fn mean_free_path(self) -> f64 {
        1.0
    }

    pub(super) fn has_atom(self, start: Start) -> bool {
        start == Start::Correlated
    }
}

impl fmt::Display for Linear {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("linear")
    }
}
