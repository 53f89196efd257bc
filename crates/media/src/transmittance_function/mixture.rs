//! Mixtures of transmittance functions: rays of which each follows one of several.

use super::invert::depth_of;
use super::{StartCorrelation, TransmittanceFunction};
use crate::Error;
use libm::exp;
use pileus_math::random::Decision;
use rand_core::Rng;
use std::fmt;

/// One transmittance function of a mixture.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// Share of the rays that start at a place: positive.
    pub weight: f64,
    /// Factor on the optical depth: positive.
    pub rate: f64,
    /// The transmittance function; `None` is the exponential one. No mixture.
    pub function: Option<TransmittanceFunction>,
}

impl Component {
    /// Probability per unit of depth of a collision at the very start, from a place.
    fn slope(&self) -> f64 {
        self.rate / self.function.as_ref().map_or(1.0, TransmittanceFunction::mean_free_path)
    }

    fn survival(&self, start: StartCorrelation, tau: f64) -> f64 {
        // Infinite depth under any rate.
        let depth = self.rate * tau;
        self.function
            .as_ref()
            .map_or_else(|| exp(-depth), |function| function.survival(start, depth))
    }

    fn density(&self, start: StartCorrelation, tau: f64) -> f64 {
        let depth = self.rate * tau;
        let density = match &self.function {
            None => exp(-depth),
            Some(function) => function.density(start, depth),
        };
        self.rate * density
    }
}

/// `T(tau) = sum of weight T_i(rate tau)`: any convex combination of transmittance functions is a
/// transmittance function.
///
/// Blends with the exponential transmittance, sums of exponentials, mixtures of gamma-distributed
/// rates or stages. A ray from a particle belongs to component `i` in proportion to `weight_i
/// rate_i / l_i`: what collides often starts often.
#[derive(Debug, Clone, PartialEq)]
pub struct Mixture {
    components: Vec<Component>,
    /// Shares of rays from a particle.
    correlated: Vec<f64>,
    mean_free_path: f64,
}

/// Most transmittance functions of a mixture.
const MAX_COMPONENTS: usize = 64;

impl Mixture {
    /// A mixture; weights are divided by their sum.
    ///
    /// # Errors
    /// If there is no component or more than 64, if a weight or rate is not a positive number, or
    /// if a component is a mixture itself.
    pub fn new(mut components: Vec<Component>) -> Result<Mixture, Error> {
        if components.is_empty() || components.len() > MAX_COMPONENTS {
            return Err(Error::invalid(
                format!("a mixture of {} transmittance functions", components.len()),
                format!("give from 1 to {MAX_COMPONENTS}"),
            ));
        }
        for Component { weight, rate, function } in &components {
            if !(*weight > 0.0 && *weight <= 1e9 && *rate > 1e-9 && *rate <= 1e9) {
                return Err(Error::invalid(
                    format!("a component of a mixture has the weight {weight} and the rate {rate}"),
                    "give positive numbers, at most 1e9",
                ));
            }
            if matches!(function, Some(TransmittanceFunction::Mixture(_))) {
                return Err(Error::invalid(
                    "a component of a mixture is a mixture",
                    "write its components into the outer one, weights multiplied",
                ));
            }
        }
        let total: f64 = components.iter().map(|c| c.weight).sum();
        for component in &mut components {
            component.weight /= total;
        }
        let slope: f64 = components.iter().map(|c| c.weight * c.slope()).sum();
        let correlated = components.iter().map(|c| c.weight * c.slope() / slope).collect();
        Ok(Mixture { components, correlated, mean_free_path: 1.0 / slope })
    }

    /// The components of the mixture; weights add up to one.
    pub fn components(&self) -> &[Component] {
        &self.components
    }

    fn shares(&self, start: StartCorrelation) -> impl Iterator<Item = (f64, &Component)> {
        let share = move |(component, correlated): (&Component, &f64)| match start {
            StartCorrelation::Uncorrelated => component.weight,
            StartCorrelation::Correlated => *correlated,
        };
        self.components.iter().zip(&self.correlated).map(move |pair| (share(pair), pair.0))
    }

    pub(super) fn survival(&self, start: StartCorrelation, tau: f64) -> f64 {
        self.shares(start).map(|(share, c)| share * c.survival(start, tau)).sum()
    }

    pub(super) fn density(&self, start: StartCorrelation, tau: f64) -> f64 {
        self.shares(start).map(|(share, c)| share * c.density(start, tau)).sum()
    }

    pub(super) fn depth(&self, start: StartCorrelation, drawn: f64) -> f64 {
        depth_of(drawn, |tau| self.survival(start, tau), |tau| self.density(start, tau))
    }

    pub(super) fn mean_free_path(&self) -> f64 {
        self.mean_free_path
    }

    pub(super) fn has_atom(&self, start: StartCorrelation) -> bool {
        self.components
            .iter()
            .any(|c| c.function.as_ref().is_some_and(|function| function.has_atom(start)))
    }

    pub(super) fn is_mixture_of_exponentials(&self) -> bool {
        let is = |function: &Option<TransmittanceFunction>| {
            function.as_ref().is_none_or(TransmittanceFunction::is_mixture_of_exponentials)
        };
        self.components.iter().all(|c| is(&c.function))
    }

    pub(super) fn rate<R: Rng + ?Sized>(
        &self,
        start: StartCorrelation,
        rng: &mut R,
    ) -> Option<f32> {
        let mut u = Decision::new(rng);
        let (mut chosen, mut up_to) = (None, 0.0);
        for (share, component) in self.shares(start) {
            chosen = Some(component);
            up_to += share;
            if u.is_below_exactly(up_to, rng) {
                break;
            }
        }
        let component = chosen?;
        let own = match &component.function {
            None => 1.0,
            Some(function) => function.rate(start, rng)?,
        };
        Some(component.rate as f32 * own)
    }
}

impl fmt::Display for Mixture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("mixture of ")?;
        for (i, Component { weight, rate, function }) in self.components.iter().enumerate() {
            let and = if i > 0 { ", " } else { "" };
            write!(f, "{and}{weight:.4} ")?;
            match function {
                None => f.write_str("exponential")?,
                Some(function) => write!(f, "({function})")?,
            }
            if *rate != 1.0 {
                write!(f, " at rate {rate}")?;
            }
        }
        Ok(())
    }
}
