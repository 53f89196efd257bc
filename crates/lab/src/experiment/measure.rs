//! Many estimates of one quantity, and what they say about the estimator.

use pileus_media::Tally;

/// Estimates, what they cost, and how many had no value.
#[derive(Debug, Clone, Default)]
pub struct Samples {
    /// Finite estimates.
    pub values: Vec<f64>,
    /// Estimates that were not finite.
    pub non_finite: u64,
    /// Events of all estimates.
    pub tally: Tally,
    /// Seconds for all estimates; zero if they were not timed.
    pub seconds: f64,
}

/// Mean and spread of estimates.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moments {
    /// Number.
    pub n: f64,
    /// Mean.
    pub mean: f64,
    /// Variance of one estimate.
    pub variance: f64,
    /// The estimate that is farthest from the mean.
    pub worst: f64,
    /// Share of negative estimates.
    pub negative: f64,
}

impl Samples {
    /// Adds an estimate.
    pub fn push(&mut self, value: f64) {
        if value.is_finite() { self.values.push(value) } else { self.non_finite += 1 }
    }

    /// Mean and spread.
    pub fn moments(&self) -> Moments {
        let n = self.values.len() as f64;
        if self.values.is_empty() {
            return Moments {
                mean: f64::NAN,
                variance: f64::NAN,
                worst: f64::NAN,
                ..Moments::default()
            };
        }
        let mean = self.values.iter().sum::<f64>() / n;
        let variance =
            self.values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        let far = |a: &&f64, b: &&f64| (*a - mean).abs().total_cmp(&(*b - mean).abs());
        let worst = self.values.iter().max_by(far).copied().unwrap_or(f64::NAN);
        let negative = self.values.iter().filter(|v| **v < 0.0).count() as f64 / n;
        Moments { n, mean, variance, worst, negative }
    }

    /// Mean squared distance from `exact` of the means of `group` consecutive estimates, `None` for
    /// fewer than four groups.
    pub fn squared_error(&self, group: usize, exact: f64) -> Option<f64> {
        let groups = self.values.chunks_exact(group.max(1));
        let count = groups.len();
        let error = |g: &[f64]| (g.iter().sum::<f64>() / g.len() as f64 - exact).powi(2);
        (count >= 4).then(|| groups.map(error).sum::<f64>() / count as f64)
    }
}

impl Moments {
    /// Distance of the mean from `exact` in standard errors; differences within `tolerance`, which
    /// rounding explains, count as none.
    pub fn z(&self, exact: f64, tolerance: f64) -> f64 {
        let difference = (self.mean - exact).abs() - tolerance;
        if difference <= 0.0 {
            return 0.0;
        }
        let z = difference / (self.variance / self.n).sqrt();
        if self.mean < exact { -z } else { z }
    }
}
