//! The power law: rates that vary from ray to ray by a gamma distribution.

use super::StartCorrelation;
use crate::Error;
use libm::{exp, expm1, log, log1p};
use pileus_math::elementary::{ln, sin_cos_turn};
use pileus_math::random::uniform;
use rand_core::Rng;
use std::fmt;

/// `T(tau) = (1 + tau / k)^-k` [Davis and Marshak 1997; d'Eon 2018]: particles in clusters, with a
/// heavy tail; exponential as `k` grows.
///
/// A mixture of exponential transmittances: the rate has a gamma distribution of shape and rate
/// `k`, mean one and variance `1 / k`. From a particle the shape is `k + 1`. The mean flight from a
/// surface is `k / (k - 1)`, which is finite for `k > 1` only; the one between collisions is one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Power {
    k: f64,
}

impl Power {
    /// The transmittance function of a given `k`.
    ///
    /// # Errors
    /// Unless `1 < k <= 1e9`.
    pub fn new(k: f64) -> Result<Power, Error> {
        if k > 1.0 && k <= 1e9 {
            return Ok(Power { k });
        }
        Err(Error::invalid(
            format!("k of a power law is {k}"),
            "give a number above 1 (and at most 1e9): at 1 and below flights from a surface have no finite mean, and paths do not end",
        ))
    }

    /// The exponent.
    pub fn k(&self) -> f64 {
        self.k
    }

    /// Exponent of the survival.
    fn exponent(&self, start: StartCorrelation) -> f64 {
        match start {
            StartCorrelation::Uncorrelated => self.k,
            StartCorrelation::Correlated => self.k + 1.0,
        }
    }

    pub(super) fn survival(&self, start: StartCorrelation, tau: f64) -> f64 {
        if tau == f64::INFINITY {
            return 0.0;
        }
        exp(-self.exponent(start) * log1p(tau / self.k))
    }

    pub(super) fn density(&self, start: StartCorrelation, tau: f64) -> f64 {
        let exponent = self.exponent(start);
        exponent / self.k * exp(-(exponent + 1.0) * log1p(tau / self.k))
    }

    pub(super) fn depth(&self, start: StartCorrelation, drawn: f64) -> f64 {
        self.k * expm1(drawn / self.exponent(start))
    }

    pub(super) fn mean_free_path(&self) -> f64 {
        1.0
    }

    pub(super) fn has_atom(&self, _: StartCorrelation) -> bool {
        false
    }

    pub(super) fn rate<R: Rng + ?Sized>(&self, start: StartCorrelation, rng: &mut R) -> f32 {
        (gamma(self.exponent(start), rng) / self.k) as f32
    }
}

/// A gamma variate of this shape, at least one, and rate one, by rejection [Marsaglia and Tsang
/// 2000].
fn gamma<R: Rng + ?Sized>(shape: f64, rng: &mut R) -> f64 {
    let d = shape - 1.0 / 3.0;
    let c = 1.0 / (9.0 * d).sqrt();
    loop {
        // A normal variate [Box and Muller 1958]; one minus a uniform number is never zero.
        let radius = (-2.0 * f64::from(ln(1.0 - uniform(rng)))).sqrt();
        let x = radius * f64::from(sin_cos_turn(uniform(rng)).1);
        let root = 1.0 + c * x;
        let v = root * root * root;
        if !(v > 0.0) {
            continue;
        }
        let u = 1.0 - f64::from(uniform(rng));
        if log(u) < 0.5 * x * x + d - d * v + d * log(v) {
            return d * v;
        }
    }
}

impl fmt::Display for Power {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "power k {}", self.k)
    }
}
