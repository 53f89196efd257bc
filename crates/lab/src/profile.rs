//! Extinction along a segment in closed form: test cases on which every estimator's mean is known.

use pileus_media::{ExactField, MajorantSegment, RayField, Tally};
use serde::Deserialize;
use statrs::function::erf::erf;
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

/// The law of the extinction, 1/length, over t from 0.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Profile {
    /// One extinction everywhere.
    Constant {
        /// Extinction.
        value: f64,
    },
    /// `a + b t`.
    Linear {
        /// At 0.
        a: f64,
        /// Slope.
        b: f64,
    },
    /// `values[i]` on `[edges[i], edges[i + 1])`.
    Steps {
        /// Ascending, one more than values.
        edges: Vec<f64>,
        /// Extinctions.
        values: Vec<f64>,
    },
    /// `floor + max(0, 1 - |t - centre| / half_width) peak`, summed over tents.
    Tents {
        /// Where the tents stand.
        centres: Vec<f64>,
        /// Half of a tent's width.
        half_width: f64,
        /// Height of each.
        peaks: Vec<f64>,
        /// Extinction everywhere.
        floor: f64,
    },
    /// `peak exp(-(t - centre)^2 / (2 sigma^2))`.
    Gaussian {
        /// Distance of the middle.
        centre: f64,
        /// Standard deviation, as a distance.
        sigma: f64,
        /// Extinction at the middle.
        peak: f64,
    },
    /// `mean + amplitude sin(2 pi cycles t)`.
    Sine {
        /// Mean.
        mean: f64,
        /// Amplitude.
        amplitude: f64,
        /// Cycles per length.
        cycles: f64,
    },
    /// `value exp(-t / scale_height)`.
    Exponential {
        /// At 0.
        value: f64,
        /// Length over which it falls to 1 / e.
        scale_height: f64,
    },
}

impl Profile {
    /// Extinction at `t`, 1/length.
    pub fn sigma_t(&self, t: f64) -> f64 {
        match self {
            Profile::Constant { value } => *value,
            Profile::Linear { a, b } => a + b * t,
            Profile::Steps { edges, values } => {
                let step = edges.partition_point(|edge| *edge <= t).saturating_sub(1);
                values.get(step).or(values.last()).copied().unwrap_or(0.0)
            }
            Profile::Tents { centres, half_width, peaks, floor } => {
                let tent = |(centre, peak): (&f64, &f64)| {
                    (1.0 - (t - centre).abs() / half_width).max(0.0) * peak
                };
                floor + centres.iter().zip(peaks).map(tent).sum::<f64>()
            }
            Profile::Gaussian { centre, sigma, peak } => {
                peak * (-0.5 * ((t - centre) / sigma).powi(2)).exp()
            }
            Profile::Sine { mean, amplitude, cycles } => {
                mean + amplitude * (TAU * cycles * t).sin()
            }
            Profile::Exponential { value, scale_height } => value * (-t / scale_height).exp(),
        }
    }

    /// Optical depth of [0, t].
    pub fn optical_depth(&self, t: f64) -> f64 {
        match self {
            Profile::Constant { value } => value * t,
            Profile::Linear { a, b } => a * t + 0.5 * b * t * t,
            Profile::Steps { edges, values } => edges
                .windows(2)
                .zip(values)
                .map(|(edge, value)| (t.min(edge[1]) - edge[0]).max(0.0) * value)
                .sum(),
            Profile::Tents { centres, half_width, peaks, floor } => {
                // Area of a unit tent to the left of x half widths from its centre.
                let area = |x: f64| {
                    let x = x.clamp(-1.0, 1.0);
                    if x < 0.0 { 0.5 * (1.0 + x).powi(2) } else { 1.0 - 0.5 * (1.0 - x).powi(2) }
                };
                let tent = |(centre, peak): (&f64, &f64)| {
                    (area((t - centre) / half_width) - area(-centre / half_width))
                        * half_width
                        * peak
                };
                floor * t + centres.iter().zip(peaks).map(tent).sum::<f64>()
            }
            Profile::Gaussian { centre, sigma, peak } => {
                let part = |t: f64| erf((t - centre) / sigma * FRAC_1_SQRT_2);
                peak * sigma * (0.5 * PI).sqrt() * (part(t) - part(0.0))
            }
            Profile::Sine { mean, amplitude, cycles } => {
                mean * t + amplitude / (TAU * cycles) * (1.0 - (TAU * cycles * t).cos())
            }
            Profile::Exponential { value, scale_height } => {
                value * scale_height * (1.0 - (-t / scale_height).exp())
            }
        }
    }
}

/// A profile on a segment, with its exact bounds and the bound to use.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct ProfileCase {
    /// Name of the case.
    pub name: String,
    /// Extinction over the segment.
    pub profile: Profile,
    /// Length of the segment.
    pub length: f64,
    /// Largest extinction.
    pub majorant: f64,
    /// Smallest extinction.
    pub minorant: f64,
    /// The bound that estimators are given, if it is not the exact one: too loose, or none at all.
    pub use_majorant: Option<f64>,
}

impl ProfileCase {
    /// The bound that estimators are given.
    pub fn bound(&self) -> f64 {
        self.use_majorant.unwrap_or(self.majorant)
    }

    /// Whether it is a bound.
    pub fn is_bounded(&self) -> bool {
        self.bound() >= self.majorant
    }

    /// Optical depth of the segment.
    pub fn optical_depth(&self) -> f64 {
        self.profile.optical_depth(self.length)
    }

    /// The segment as a ray, with one global bound.
    pub fn ray(&self) -> ProfileRay<'_> {
        ProfileRay { case: self, done: self.bound() <= 0.0 }
    }
}

/// A profile as trackers see it: one segment under one bound.
#[derive(Debug, Clone)]
pub struct ProfileRay<'a> {
    case: &'a ProfileCase,
    done: bool,
}

impl RayField for ProfileRay<'_> {
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        if self.done {
            return None;
        }
        self.done = true;
        let t1 = self.case.length as f32;
        Some(MajorantSegment { t0: 0.0, t1, majorant: self.case.bound() as f32 })
    }

    fn minorant(&self) -> f32 {
        self.case.minorant.min(self.case.bound()) as f32
    }

    fn sigma_t(&self, t: f32) -> f32 {
        self.case.profile.sigma_t(f64::from(t)) as f32
    }

    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        self.sigma_t(t)
    }

    fn steps(&self) -> u64 {
        u64::from(self.done)
    }
}

impl ExactField for ProfileRay<'_> {
    fn optical_depth(&self, _: &mut Tally) -> f64 {
        self.case.optical_depth()
    }

    fn t_at_depth(&self, depth: f64, _: &mut Tally) -> Result<f32, f64> {
        let whole = self.case.optical_depth();
        if !(depth <= whole) {
            return Err(whole);
        }
        // The depth is monotone: bisection to the last bit of single precision.
        let (mut low, mut high) = (0.0, self.case.length);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.case.profile.optical_depth(middle) < depth {
                low = middle;
            } else {
                high = middle;
            }
        }
        Ok(high as f32)
    }
}
