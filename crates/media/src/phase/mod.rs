//! Phase functions: the angular law of scattering, normalised over the sphere.
//!
//! [`Phase`] is what a medium owns, [`PhaseAt`] what holds at one point: small and cheap to copy,
//! for paths to carry. Isotropic scattering and Henyey-Greenstein are part of the path's own code;
//! everything else is behind one branch and a call.

mod cosine;
mod cosine_grid;
mod draine;
mod henyey_greenstein;
mod lobe;
mod mie_fit;
mod rayleigh;
mod tabulated;
#[cfg(test)]
mod tests;

pub(crate) use cosine::Cosine;
pub use cosine_grid::CosineGrid;
pub use draine::Draine;
pub use henyey_greenstein::MAX_G;
pub use lobe::{Lobe, Mixture};
pub use mie_fit::MieFit;
pub use tabulated::Tabulated;

use crate::microflakes::{Microflakes, Sggx};
use glam::{DVec3, Vec3};
use pileus_math::around;
use rand_core::Rng;
use std::f32::consts::{FRAC_1_PI, PI};
use std::fmt;
use std::sync::Arc;

/// 1 / (4 pi), the isotropic phase function, 1/sr.
pub const ISOTROPIC: f32 = 0.25 / PI;

/// The phase function of a medium. Cheap to clone: tables and grids are shared.
#[derive(Debug, Clone)]
pub enum Phase {
    /// Equal in all directions.
    Isotropic,
    /// Henyey and Greenstein (1941) with mean cosine `g` in [-0.999, 0.999]; g > 0 scatters
    /// forward.
    HenyeyGreenstein {
        /// Mean cosine.
        g: f32,
    },
    /// Henyey-Greenstein whose mean cosine is looked up where a path scatters.
    ByGrid(Arc<CosineGrid>),
    /// Any sum of lobes.
    Mixture(Arc<Mixture>),
    /// Microflakes, which give the medium an extinction that depends on direction, too.
    Microflakes(Arc<Microflakes>),
}

impl Phase {
    /// Henyey-Greenstein of mean cosine `g`, clamped to [-0.999, 0.999]; isotropic for g = 0.
    pub fn henyey_greenstein(g: f32) -> Phase {
        if g == 0.0 {
            Phase::Isotropic
        } else {
            Phase::HenyeyGreenstein { g: g.clamp(-MAX_G, MAX_G) }
        }
    }

    /// A sum of lobes; in the cheapest form there is.
    pub fn mixture(mixture: Mixture) -> Phase {
        match mixture.single() {
            Some(Lobe::Isotropic) => Phase::Isotropic,
            Some(Lobe::HenyeyGreenstein { g }) => Phase::henyey_greenstein(*g),
            _ => Phase::Mixture(Arc::new(mixture)),
        }
    }

    /// The phase function if it is the same everywhere and one of those that paths hold in their
    /// own code.
    #[inline(always)]
    pub fn hg_or_isotropic(&self) -> Option<PhaseAt<'static>> {
        match self {
            Phase::Isotropic => Some(PhaseAt::Isotropic),
            Phase::HenyeyGreenstein { g } => Some(PhaseAt::HenyeyGreenstein { g: *g }),
            _ => None,
        }
    }

    /// The phase function at a point of the medium's index space, which is asked for only if it
    /// matters, for light that arrives along `incoming`. Random numbers are drawn for diffuse
    /// microflakes alone.
    #[inline(always)]
    pub fn at<R: Rng + ?Sized>(
        &self,
        p_index: impl FnOnce() -> DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> PhaseAt<'_> {
        match self {
            Phase::Isotropic => PhaseAt::Isotropic,
            Phase::HenyeyGreenstein { g } => PhaseAt::HenyeyGreenstein { g: *g },
            Phase::ByGrid(grid) => PhaseAt::HenyeyGreenstein { g: grid.at_index(p_index()) },
            Phase::Mixture(mixture) => PhaseAt::Mixture(mixture),
            Phase::Microflakes(microflakes) => microflakes.at(p_index, incoming, rng),
        }
    }

    /// The microflakes, if it is a medium of such.
    #[inline(always)]
    pub fn microflakes(&self) -> Option<&Microflakes> {
        match self {
            Phase::Microflakes(microflakes) => Some(microflakes),
            _ => None,
        }
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Phase::Isotropic => f.write_str("isotropic"),
            Phase::HenyeyGreenstein { g } => write!(f, "henyey_greenstein g {g}"),
            Phase::ByGrid(grid) => {
                let (low, high) = grid.range();
                write!(f, "henyey_greenstein g by grid {low:.4} to {high:.4}")
            }
            Phase::Mixture(mixture) => mixture.fmt(f),
            Phase::Microflakes(microflakes) => microflakes.fmt(f),
        }
    }
}

/// The phase function at a point. Directions are unit vectors of propagation, before (`incoming`)
/// and after (`wi`) the scattering.
#[derive(Debug, Clone, Copy)]
pub enum PhaseAt<'a> {
    /// Henyey-Greenstein.
    HenyeyGreenstein {
        /// Mean cosine in [-0.999, 0.999].
        g: f32,
    },
    /// Equal in all directions.
    Isotropic,
    /// Any sum of lobes.
    Mixture(&'a Mixture),
    /// Microflakes that mirror.
    Microflakes(Sggx),
    /// One diffuse microflake, which faces the light that arrives.
    Microflake {
        /// Unit normal.
        normal: Vec3,
    },
}

impl PhaseAt<'_> {
    /// Henyey-Greenstein of mean cosine `g`, clamped to [-0.999, 0.999].
    #[inline(always)]
    pub fn henyey_greenstein(g: f32) -> PhaseAt<'static> {
        if g == 0.0 {
            PhaseAt::Isotropic
        } else {
            PhaseAt::HenyeyGreenstein { g: g.clamp(-MAX_G, MAX_G) }
        }
    }

    /// Mean cosine of the scattering angle; 0 for microflakes, where it depends on the direction.
    pub fn mean_cosine(&self) -> f32 {
        match self {
            PhaseAt::Isotropic | PhaseAt::Microflakes(_) | PhaseAt::Microflake { .. } => 0.0,
            PhaseAt::HenyeyGreenstein { g } => *g,
            PhaseAt::Mixture(mixture) => mixture.mean_cosine(),
        }
    }

    /// Value, 1/sr; also the density with which [`PhaseAt::sample`] draws (its samples have weight
    /// one).
    #[inline(always)]
    pub fn eval(&self, incoming: Vec3, wi: Vec3) -> f32 {
        match *self {
            PhaseAt::Isotropic => ISOTROPIC,
            PhaseAt::HenyeyGreenstein { g } => henyey_greenstein::eval_directions(g, incoming, wi),
            other => eval_other(other, incoming, wi),
        }
    }

    /// A direction for two random numbers in [0, 1), and its density, 1/sr.
    #[inline(always)]
    pub fn sample(&self, incoming: Vec3, u: [f32; 2]) -> (Vec3, f32) {
        let (cos_theta, sin_theta, pdf) = match *self {
            PhaseAt::Isotropic => (1.0 - 2.0 * u[0], 2.0 * (u[0] * (1.0 - u[0])).sqrt(), ISOTROPIC),
            PhaseAt::HenyeyGreenstein { g } => henyey_greenstein::sample_with_value(g, u[0]),
            other => return sample_other(other, incoming, u),
        };
        (around(incoming, (cos_theta, sin_theta), u[1]), pdf)
    }
}

/// Out of line, as its sibling: kernels of clouds by Henyey-Greenstein hold none of it. By value,
/// so that theirs need not be in memory.
#[inline(never)]
fn eval_other(phase: PhaseAt<'_>, incoming: Vec3, wi: Vec3) -> f32 {
    match phase {
        PhaseAt::Mixture(mixture) => mixture.eval(Cosine::between(incoming, wi)),
        PhaseAt::Microflakes(s) => s.specular(incoming, wi),
        PhaseAt::Microflake { normal } => normal.dot(wi).max(0.0) * FRAC_1_PI,
        other => other.eval(incoming, wi),
    }
}

#[inline(never)]
fn sample_other(phase: PhaseAt<'_>, incoming: Vec3, u: [f32; 2]) -> (Vec3, f32) {
    match phase {
        PhaseAt::Mixture(mixture) => {
            let cosine = mixture.sample(u[0]);
            let wi = around(incoming, (cosine.value(), cosine.sine()), u[1]);
            (wi, mixture.eval(cosine))
        }
        PhaseAt::Microflakes(s) => s.sample_specular(incoming, u),
        PhaseAt::Microflake { normal } => {
            let wi = around(normal, ((1.0 - u[0]).sqrt(), u[0].sqrt()), u[1]);
            (wi, normal.dot(wi).max(0.0) * FRAC_1_PI)
        }
        other => other.sample(incoming, u),
    }
}
