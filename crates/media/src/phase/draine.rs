//! Draine 2003: Henyey-Greenstein times `1 + alpha cos^2`, from Rayleigh (`g = 0, alpha = 1`) to
//! Henyey-Greenstein (`alpha = 0`).

use super::cosine::Cosine;
use super::henyey_greenstein::{self, MAX_G};
use crate::Error;
use std::f64::consts::TAU;

/// Largest `alpha`: beyond it `1 + alpha cos^2` is `cos^2` for single precision.
pub(crate) const MAX_ALPHA: f32 = 1e6;

/// The phase function
/// `(1 - g^2) (1 + alpha c^2) / (4 pi (1 + g^2 - 2 g c)^(3/2) (1 + alpha (1 + 2 g^2) / 3))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Draine {
    g: f32,
    alpha: f32,
    /// One over the mean of `1 + alpha cos^2` under Henyey-Greenstein.
    scale: f32,
}

impl Draine {
    /// `g` in [-0.999, 0.999]: not the mean cosine, which is [`Draine::mean_cosine`]; `alpha` in
    /// [0, 1e6].
    ///
    /// # Errors
    /// If a parameter is outside.
    pub fn new(g: f32, alpha: f32) -> Result<Draine, Error> {
        if !(g.abs() <= MAX_G) {
            return Err(Error::invalid(
                format!("g is {g}"),
                format!("give a number between -{MAX_G} and {MAX_G}"),
            ));
        }
        if !(0.0..=MAX_ALPHA).contains(&alpha) {
            return Err(Error::invalid(
                format!("alpha is {alpha}"),
                format!("give a number between 0 and {MAX_ALPHA}"),
            ));
        }
        let scale = 1.0 / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0);
        Ok(Draine { g, alpha, scale })
    }

    /// The parameter `g`.
    pub fn g(&self) -> f32 {
        self.g
    }

    /// The weight of `cos^2`.
    pub fn alpha(&self) -> f32 {
        self.alpha
    }

    /// Mean cosine: `g (1 + alpha (3 + 2 g^2) / 5) / (1 + alpha (1 + 2 g^2) / 3)`.
    pub fn mean_cosine(&self) -> f32 {
        let g2 = self.g * self.g;
        self.g * (1.0 + self.alpha * (3.0 + 2.0 * g2) / 5.0) * self.scale
    }

    /// Value, 1/sr.
    pub(super) fn eval(&self, cosine: Cosine) -> f32 {
        let c = cosine.value();
        henyey_greenstein::eval(self.g, cosine) * (1.0 + self.alpha * c * c) * self.scale
    }

    /// The angle for a random number: the cumulative distribution inverted to double precision.
    ///
    /// A quartic equation; Jendersie and d'Eon 2023 give its root in closed form, which divides by
    /// `g` and `alpha` and takes a cubic root, a function of the system. Newton's iteration within
    /// a bracket needs neither and takes some five steps.
    pub(super) fn sample(&self, u: f32) -> Cosine {
        let target = 1.0 - f64::from(u);
        let (mut low, mut high) = (0.0f64, 2.0f64);
        let mut x = f64::from(henyey_greenstein::sample_from_peak(self.g.abs(), u));
        for _ in 0..64 {
            let error = self.cumulative(x) - target;
            let density = TAU * f64::from(self.eval_from_peak(Cosine::from_one_minus(x)));
            if error > 0.0 {
                high = x;
            } else {
                low = x;
            }
            let next = x - error / density;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            let done = (next - x).abs() <= 1e-9 * next;
            x = next;
            if done {
                break;
            }
        }
        let forward = Cosine::from_one_minus(x);
        if self.g < 0.0 { forward.mirrored() } else { forward }
    }

    /// Value, 1/sr, for |g|.
    fn eval_from_peak(&self, cosine: Cosine) -> f32 {
        Draine { g: self.g.abs(), ..*self }.eval(cosine)
    }

    /// Probability of `1 - cos` below `x` for |g|.
    ///
    /// With `d^2 = (1-g)^2 + 2 g x` and `d0 = 1 - g` the integrals of `x^k / d^3` for k = 0, 1, 2
    /// are closed forms without differences, so that no digits are lost for any `g`, zero included.
    fn cumulative(&self, x: f64) -> f64 {
        let (g, alpha) = (f64::from(self.g.abs()), f64::from(self.alpha));
        let d0 = 1.0 - g;
        let d = (d0 * d0 + 2.0 * g * x).sqrt();
        let sum = d + d0;
        let zeroth = 2.0 * x / (sum * d * d0);
        let first = 2.0 * x * x / (sum * sum * d);
        let second = 2.0 * x * x * x * (d + 3.0 * d0) / (3.0 * sum * sum * sum * d);
        let norm = 0.5 * (1.0 - g * g) / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0);
        norm * ((1.0 + alpha) * zeroth - 2.0 * alpha * first + alpha * second)
    }
}
