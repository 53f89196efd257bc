//! Transmittance laws that are not exponential [Bitterli et al. 2018; d'Eon 2018; Jarabo et al.
//! 2018].
//!
//! Under a law the transmittance of a ray is a function `T` of its optical depth `tau`. Between two
//! places that know nothing of the particles it is `T` itself; a ray that starts at a particle has
//! another law, since particles lie in clusters or keep apart:
//!
//! | | to a place | density of a collision |
//! |---|---|---|
//! | from a place | `X_u = T` | `p_u = -T'` |
//! | from a particle | `X_c = T' / T'(0)` | `p_c = -X_c' = T'' / -T'(0)` |
//!
//! `p_u(tau) = X_c(tau) / l` with the mean free path `l = -1 / T'(0)` between collisions: transport
//! is reciprocal. `T` decreases from one and is convex, else a density would be negative. All laws
//! are evaluated in double precision, with the same bits on every machine. The exponential law is
//! the absence of a [`Law`]: media without one pay nothing.

mod davis_weinstein;
mod erlang;
mod invert;
mod linear;
mod mixture;
mod power;
mod table;

pub use davis_weinstein::DavisWeinstein;
pub use erlang::{Erlang, MOST_STAGES};
pub use linear::Linear;
pub use mixture::{Component, Mixture};
pub use power::Power;
pub use table::{MOST_ROWS, Table};

use rand_core::Rng;
use std::fmt;

/// Where a ray starts, as a law sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Start {
    /// At a place that has nothing to do with the medium's particles: a camera, a surface, another
    /// medium's particle.
    Uncorrelated,
    /// At a particle of the medium.
    Correlated,
}

impl Start {
    /// Both.
    pub const ALL: [Start; 2] = [Start::Uncorrelated, Start::Correlated];
}

/// A law of transmittance over optical depth, other than the exponential one.
#[derive(Debug, Clone, PartialEq)]
pub enum Law {
    /// `(1 + tau / k)^-k`.
    Power(Power),
    /// Of Davis and Mineev-Weinstein.
    DavisWeinstein(DavisWeinstein),
    /// Particles that keep apart.
    Erlang(Erlang),
    /// `max(0, 1 - tau)`.
    Linear(Linear),
    /// From pairs of numbers.
    Table(Table),
    /// A convex combination of others.
    Mixture(Mixture),
}

/// Calls a method of whichever law it is.
macro_rules! of_law {
    ($self:ident, $law:ident => $value:expr) => {
        match $self {
            Law::Power($law) => $value,
            Law::DavisWeinstein($law) => $value,
            Law::Erlang($law) => $value,
            Law::Linear($law) => $value,
            Law::Table($law) => $value,
            Law::Mixture($law) => $value,
        }
    };
}

impl Law {
    /// Probability of passing the optical depth `tau` (at least 0, may be infinite) without a
    /// collision: `X_u`, `X_c`; in [0, 1].
    pub fn survival(&self, start: Start, tau: f64) -> f64 {
        of_law!(self, law => law.survival(start, tau))
    }

    /// Density of a collision at the optical depth `tau` > 0, per unit of it: `p_u`, `p_c`. What
    /// lies in an [`atom`](Law::has_atom) is left out.
    pub fn density(&self, start: Start, tau: f64) -> f64 {
        of_law!(self, law => law.density(start, tau))
    }

    /// The optical depth that a flight reaches: where the survival has fallen to `e^-drawn`, for an
    /// exponential variate `drawn`.
    pub fn depth(&self, start: Start, drawn: f64) -> f64 {
        of_law!(self, law => law.depth(start, drawn))
    }

    /// Mean optical depth between collisions, `-1 / T'(0)`.
    pub fn mean_free_path(&self) -> f64 {
        of_law!(self, law => law.mean_free_path())
    }

    /// Whether collisions happen at some optical depth with positive probability, beside
    /// [`density`](Law::density).
    pub fn has_atom(&self, start: Start) -> bool {
        of_law!(self, law => law.has_atom(start))
    }

    /// Whether the law is a mixture of exponential ones, so that [`rate`](Law::rate) draws one of
    /// them.
    pub fn is_mixture_of_exponentials(&self) -> bool {
        match self {
            Law::Power(_) => true,
            Law::Mixture(mixture) => mixture.is_mixture_of_exponentials(),
            Law::DavisWeinstein(_) | Law::Erlang(_) | Law::Linear(_) | Law::Table(_) => false,
        }
    }

    /// The rate `a` of one of the exponential laws of which this one is a mixture: with the
    /// extinction multiplied by it, a ray's transmittance and flights follow this law in the mean,
    /// whatever tracker runs. `None` if it is no such mixture.
    ///
    /// From a particle rates are drawn in proportion to themselves: denser clusters hold more
    /// particles.
    pub fn rate<R: Rng + ?Sized>(&self, start: Start, rng: &mut R) -> Option<f32> {
        match self {
            Law::Power(power) => Some(power.rate(start, rng)),
            Law::Mixture(mixture) if mixture.is_mixture_of_exponentials() => {
                mixture.rate(start, rng)
            }
            _ => None,
        }
    }
}

/// A law as a ray sees it from where it starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passage<'a> {
    /// The law.
    pub law: &'a Law,
    /// Where the ray starts.
    pub start: Start,
}

impl Passage<'_> {
    /// [`Law::survival`].
    pub fn survival(self, tau: f64) -> f64 {
        self.law.survival(self.start, tau)
    }

    /// [`Law::density`].
    pub fn density(self, tau: f64) -> f64 {
        self.law.density(self.start, tau)
    }

    /// [`Law::depth`].
    pub fn depth(self, drawn: f64) -> f64 {
        self.law.depth(self.start, drawn)
    }

    /// [`Law::has_atom`].
    pub fn has_atom(self) -> bool {
        self.law.has_atom(self.start)
    }

    /// [`Law::rate`].
    pub fn rate<R: Rng + ?Sized>(self, rng: &mut R) -> Option<f32> {
        self.law.rate(self.start, rng)
    }
}

impl fmt::Display for Law {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        of_law!(self, law => write!(f, "{law}"))
    }
}

#[cfg(test)]
mod tests;
