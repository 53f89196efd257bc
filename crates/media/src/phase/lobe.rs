//! Lobes that depend on the scattering angle alone, and weighted sums of them.

use super::cosine::Cosine;
use super::draine::Draine;
use super::henyey_greenstein::{self, MAX_G};
use super::tabulated::Tabulated;
use super::{ISOTROPIC, rayleigh};
use crate::Error;
use std::fmt;

/// Most lobes of a mixture.
pub(crate) const MAX_LOBES: usize = 64;

/// One phase function of the scattering angle, the same everywhere.
#[derive(Debug, Clone, PartialEq)]
pub enum Lobe {
    /// Equal in all directions.
    Isotropic,
    /// Henyey-Greenstein with mean cosine `g` in [-0.999, 0.999].
    HenyeyGreenstein {
        /// Mean cosine.
        g: f32,
    },
    /// Rayleigh scattering.
    Rayleigh,
    /// Draine's function.
    Draine(Draine),
    /// A table.
    Tabulated(Tabulated),
}

impl Lobe {
    /// Henyey-Greenstein of mean cosine `g`, clamped to [-0.999, 0.999].
    pub fn henyey_greenstein(g: f32) -> Lobe {
        Lobe::HenyeyGreenstein { g: g.clamp(-MAX_G, MAX_G) }
    }

    /// Mean cosine of the scattering angle.
    pub fn mean_cosine(&self) -> f32 {
        match self {
            Lobe::Isotropic | Lobe::Rayleigh => 0.0,
            Lobe::HenyeyGreenstein { g } => *g,
            Lobe::Draine(draine) => draine.mean_cosine(),
            Lobe::Tabulated(table) => table.mean_cosine(),
        }
    }

    /// Value, 1/sr; also the density of [`Lobe::sample`].
    pub(crate) fn eval(&self, cosine: Cosine) -> f32 {
        match self {
            Lobe::Isotropic => ISOTROPIC,
            Lobe::HenyeyGreenstein { g } => henyey_greenstein::eval(*g, cosine),
            Lobe::Rayleigh => rayleigh::eval(cosine),
            Lobe::Draine(draine) => draine.eval(cosine),
            Lobe::Tabulated(table) => table.eval(cosine),
        }
    }

    /// The angle for a random number in [0, 1).
    pub(crate) fn sample(&self, u: f32) -> Cosine {
        match self {
            Lobe::Isotropic => Cosine::from_one_minus(2.0 * f64::from(u)),
            Lobe::HenyeyGreenstein { g } => henyey_greenstein::sample(*g, u),
            Lobe::Rayleigh => rayleigh::sample(u),
            Lobe::Draine(draine) => draine.sample(u),
            Lobe::Tabulated(table) => table.sample(u),
        }
    }
}

impl fmt::Display for Lobe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Lobe::Isotropic => f.write_str("isotropic"),
            Lobe::HenyeyGreenstein { g } => write!(f, "henyey_greenstein g {g}"),
            Lobe::Rayleigh => f.write_str("rayleigh"),
            Lobe::Draine(draine) => write!(f, "draine g {} alpha {}", draine.g(), draine.alpha()),
            Lobe::Tabulated(table) => {
                write!(f, "tabulated, {} rows, mean cosine {}", table.rows(), table.mean_cosine())
            }
        }
    }
}

/// A sum of lobes with weights that add up to one.
#[derive(Debug, Clone, PartialEq)]
pub struct Mixture {
    lobes: Vec<Weighted>,
}

#[derive(Debug, Clone, PartialEq)]
struct Weighted {
    lobe: Lobe,
    weight: f32,
    /// Weights of the lobes before this one.
    before: f32,
}

impl Mixture {
    /// A single lobe.
    pub fn of(lobe: Lobe) -> Mixture {
        Mixture { lobes: vec![Weighted { lobe, weight: 1.0, before: 0.0 }] }
    }

    /// A sum of mixtures; weights are relative. Lobes of weight 0 are left out.
    ///
    /// # Errors
    /// If a weight is negative or not finite, if none is above 0, or if there are more than
    /// 64 lobes.
    pub fn new(parts: impl IntoIterator<Item = (f64, Mixture)>) -> Result<Mixture, Error> {
        let mut lobes: Vec<(f64, Lobe)> = Vec::new();
        for (weight, part) in parts {
            if !(0.0..=1e30).contains(&weight) {
                return Err(Error::invalid(
                    format!("the weight {weight} is negative or out of range"),
                    "give numbers of at least 0",
                ));
            }
            let part = part.lobes.into_iter().map(|l| (weight * f64::from(l.weight), l.lobe));
            lobes.extend(part.filter(|(weight, _)| *weight > 0.0));
            if lobes.len() > MAX_LOBES {
                return Err(Error::unsupported(
                    format!("the mixture has more than {MAX_LOBES} lobes"),
                    "tabulate it",
                ));
            }
        }
        let total: f64 = lobes.iter().map(|(weight, _)| weight).sum();
        if !(total > 0.0) {
            return Err(Error::invalid("no lobe has a weight", "give one a weight above 0"));
        }
        let mut before = 0.0;
        let weighted = lobes.into_iter().map(|(weight, lobe)| {
            let this =
                Weighted { lobe, weight: (weight / total) as f32, before: (before / total) as f32 };
            before += weight;
            this
        });
        Ok(Mixture { lobes: weighted.collect() })
    }

    /// The lobe, if it is a single one.
    pub fn single(&self) -> Option<&Lobe> {
        match self.lobes.as_slice() {
            [one] => Some(&one.lobe),
            _ => None,
        }
    }

    /// Mean cosine of the scattering angle.
    pub fn mean_cosine(&self) -> f32 {
        self.lobes.iter().map(|l| l.weight * l.lobe.mean_cosine()).sum()
    }

    /// Value, 1/sr; also the density of [`Mixture::sample`].
    pub(crate) fn eval(&self, cosine: Cosine) -> f32 {
        self.lobes.iter().map(|l| l.weight * l.lobe.eval(cosine)).sum()
    }

    /// The angle for a random number in [0, 1): it chooses the lobe, and what is left of it the
    /// angle. A lobe of weight w is left with `2^24 w` angles.
    pub(crate) fn sample(&self, u: f32) -> Cosine {
        let last = self.lobes.partition_point(|l| l.before <= u).saturating_sub(1);
        let Some(chosen) = self.lobes.get(last) else { return Cosine::from_one_minus(1.0) };
        let left = (u - chosen.before) / chosen.weight;
        // The largest number below one: rounding must not leave the range.
        chosen.lobe.sample(left.clamp(0.0, 1.0 - f32::EPSILON / 2.0))
    }
}

impl fmt::Display for Mixture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(lobe) = self.single() {
            return lobe.fmt(f);
        }
        f.write_str("mixture of ")?;
        for (i, l) in self.lobes.iter().enumerate() {
            write!(f, "{}{:.4} {}", if i > 0 { ", " } else { "" }, l.weight, l.lobe)?;
        }
        Ok(())
    }
}
