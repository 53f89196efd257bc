//! Non-exponential transmittance functions [Bitterli et al. 2018; d'Eon 2018; Jarabo et al.
//! 2018].
//!
//! Under a transmittance function the transmittance of a ray is a function `T` of its optical depth
//! `tau`. Between two places that know nothing of the particles it is `T` itself; a ray that starts
//! at a particle has another transmittance function, since particles lie in clusters or keep apart:
//!
//! | | to a place | density of a collision |
//! |---|---|---|
//! | from a place | `X_u = T` | `p_u = -T'` |
//! | from a particle | `X_c = T' / T'(0)` | `p_c = -X_c' = T'' / -T'(0)` |
//!
//! `p_u(tau) = X_c(tau) / l` with the mean free path `l = -1 / T'(0)` between collisions: transport
//! is reciprocal. `T` decreases from one and is convex, else a density would be negative. All
//! transmittance functions are evaluated in double precision, with the same bits on every machine.
//! The exponential transmittance is the absence of a [`TransmittanceFunction`]: media without one
//! pay nothing.

mod davis_weinstein;
mod erlang;
mod invert;
mod linear;
mod mixture;
mod power;
mod table;

pub use davis_weinstein::DavisWeinstein;
pub use erlang::Erlang;
pub use linear::Linear;
pub use mixture::{Component, Mixture};
pub use power::Power;
pub use table::Table;

use rand_core::Rng;
use std::fmt;

/// Where a ray starts, as a transmittance function sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum StartCorrelation {
    /// At a place that has nothing to do with the medium's particles: a camera, a surface, another
    /// medium's particle.
    Uncorrelated,
    /// At a particle of the medium.
    Correlated,
}

impl StartCorrelation {
    /// Both ways to start.
    pub const ALL: [StartCorrelation; 2] =
        [StartCorrelation::Uncorrelated, StartCorrelation::Correlated];
}

/// A transmittance function over optical depth, other than the exponential one.
#[derive(Debug, Clone, PartialEq)]
pub enum TransmittanceFunction {
    /// `(1 + tau / k)^-k`.
    Power(Power),
    /// Gamma-distributed optical depth of Davis and Mineev-Weinstein.
    DavisWeinstein(DavisWeinstein),
    /// Particles that keep apart.
    Erlang(Erlang),
    /// `max(0, 1 - tau)`.
    Linear(Linear),
    /// A spline through pairs of numbers.
    Table(Table),
    /// A convex combination of others.
    Mixture(Mixture),
}

/// Calls a method of whichever transmittance function it is.
macro_rules! of_function {
    ($self:ident, $function:ident => $value:expr) => {
        match $self {
            TransmittanceFunction::Power($function) => $value,
            TransmittanceFunction::DavisWeinstein($function) => $value,
            TransmittanceFunction::Erlang($function) => $value,
            TransmittanceFunction::Linear($function) => $value,
            TransmittanceFunction::Table($function) => $value,
            TransmittanceFunction::Mixture($function) => $value,
        }
    };
}

impl TransmittanceFunction {
    /// Probability of passing the optical depth `tau` (at least 0, may be infinite) without a
    /// collision: `X_u`, `X_c`; in [0, 1].
    pub fn survival(&self, start: StartCorrelation, tau: f64) -> f64 {
        of_function!(self, function => function.survival(start, tau))
    }

    /// Density of a collision at the optical depth `tau` > 0, per unit of it: `p_u`, `p_c`. What
    /// lies in an [`atom`](TransmittanceFunction::has_atom) is left out.
    pub fn density(&self, start: StartCorrelation, tau: f64) -> f64 {
        of_function!(self, function => function.density(start, tau))
    }

    /// The optical depth that a flight reaches: where the survival has fallen to `e^-drawn`, for an
    /// exponential variate `drawn`.
    pub fn depth(&self, start: StartCorrelation, drawn: f64) -> f64 {
        of_function!(self, function => function.depth(start, drawn))
    }

    /// Mean optical depth between collisions, `-1 / T'(0)`.
    pub fn mean_free_path(&self) -> f64 {
        of_function!(self, function => function.mean_free_path())
    }

    /// Whether collisions happen at some optical depth with positive probability, beside
    /// [`density`](TransmittanceFunction::density).
    pub fn has_atom(&self, start: StartCorrelation) -> bool {
        of_function!(self, function => function.has_atom(start))
    }

    /// Whether the transmittance function is a mixture of exponential ones, so that
    /// [`rate`](TransmittanceFunction::rate) draws one of them.
    pub fn is_mixture_of_exponentials(&self) -> bool {
        match self {
            TransmittanceFunction::Power(_) => true,
            TransmittanceFunction::Mixture(mixture) => mixture.is_mixture_of_exponentials(),
            TransmittanceFunction::DavisWeinstein(_)
            | TransmittanceFunction::Erlang(_)
            | TransmittanceFunction::Linear(_)
            | TransmittanceFunction::Table(_) => false,
        }
    }

    /// The rate `a` of one of the exponential transmittances of which this one is a mixture: with
    /// the extinction multiplied by it, a ray's transmittance and flights follow this transmittance
    /// function in the mean, whatever tracker runs. `None` if it is no such mixture.
    ///
    /// From a particle rates are drawn in proportion to themselves: denser clusters hold more
    /// particles.
    pub fn rate<R: Rng + ?Sized>(&self, start: StartCorrelation, rng: &mut R) -> Option<f32> {
        match self {
            TransmittanceFunction::Power(power) => Some(power.rate(start, rng)),
            TransmittanceFunction::Mixture(mixture) if mixture.is_mixture_of_exponentials() => {
                mixture.rate(start, rng)
            }
            _ => None,
        }
    }
}

/// A transmittance function as a ray sees it from where it starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passage<'a> {
    /// The transmittance function.
    pub function: &'a TransmittanceFunction,
    /// Where the ray starts.
    pub start: StartCorrelation,
}

impl Passage<'_> {
    /// Probability of passing the optical depth `tau` from this start without a collision, see
    /// [`TransmittanceFunction::survival`].
    pub fn survival(self, tau: f64) -> f64 {
        self.function.survival(self.start, tau)
    }

    /// Density of a collision at the optical depth `tau` from this start, per unit of it, see
    /// [`TransmittanceFunction::density`].
    pub fn density(self, tau: f64) -> f64 {
        self.function.density(self.start, tau)
    }

    /// The optical depth that a flight from this start reaches for an exponential variate `drawn`,
    /// see [`TransmittanceFunction::depth`].
    pub fn depth(self, drawn: f64) -> f64 {
        self.function.depth(self.start, drawn)
    }

    /// Whether collisions from this start happen at some optical depth with positive probability,
    /// see [`TransmittanceFunction::has_atom`].
    pub fn has_atom(self) -> bool {
        self.function.has_atom(self.start)
    }

    /// The rate of one of the exponentials that the function is a mixture of, drawn for this start,
    /// see [`TransmittanceFunction::rate`].
    pub fn rate<R: Rng + ?Sized>(self, rng: &mut R) -> Option<f32> {
        self.function.rate(self.start, rng)
    }
}

impl fmt::Display for TransmittanceFunction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        of_function!(self, function => write!(f, "{function}"))
    }
}

#[cfg(test)]
mod tests;
