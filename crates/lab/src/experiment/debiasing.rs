//! The debiasing series of non-exponential transmittance: variance and cost by how its levels are
//! chosen.

use super::measure::Samples;
use crate::Error;
use crate::chart::{Axis, Cell, Chart, Plot, Provenance, Series, Table};
use crate::profile::{Profile, ProfileCase};
use pileus_media::transmittance::{
    DEBIASED_SAMPLES, DebiasingSeries, debiased_non_exponential, debiasing_difference,
};
use pileus_media::transmittance_function::{
    Component, Erlang, Linear, Mixture, Passage, Power, StartCorrelation, TransmittanceFunction,
};
use pileus_media::{Grey, RayField, Tally};
use rand_pcg::Pcg32;

/// Estimates per choice of levels.
const ESTIMATES: u32 = 20_000;
/// Differences per level.
const DIFFERENCES: u32 = 1024;
/// Levels whose differences are measured: the finest has 16 384 samples.
const LEVELS: u32 = 11;
/// Mean squares below which differences of single-precision depths are rounding.
const ROUNDING: f64 = 1e-25;

/// Mean squares of the differences of a debiasing series, level by level.
#[derive(Debug, Clone, PartialEq)]
pub struct Levels {
    squares: Vec<f64>,
}

impl Levels {
    /// Of a field's ray under a transmittance function, for levels from 0, as long as differences
    /// are more than rounding.
    pub fn measured<F: RayField>(
        field: impl Fn() -> F,
        passage: Passage<'_>,
        levels: u32,
        differences: u32,
    ) -> Levels {
        let mut squares = Vec::new();
        let mut tally = Tally::default();
        for level in 0..levels {
            let mut rng = Pcg32::new(20_261_125, u64::from(level));
            let square = |_| {
                let count = DEBIASED_SAMPLES;
                debiasing_difference(field(), passage, count, level, &mut rng, &mut tally).powi(2)
            };
            let mean = (0..differences).map(square).sum::<f64>() / f64::from(differences);
            if !(mean > ROUNDING) {
                break;
            }
            squares.push(mean);
        }
        Levels { squares }
    }

    /// Mean squares, level by level.
    pub fn squares(&self) -> &[f64] {
        &self.squares
    }

    /// By which power of two mean squares fall from level to level, in the mean over the later half
    /// of the levels; infinite where fewer than three differ from rounding.
    pub fn decay(&self) -> f64 {
        let n = self.squares.len();
        if n < 3 {
            return f64::INFINITY;
        }
        let from = n / 2 - usize::from(n < 5);
        (self.squares[from] / self.squares[n - 1]).log2() / (n - 1 - from) as f64
    }

    /// Whether the variance of a series of this continuation probability is finite, as far as
    /// the levels show: whether its terms, mean squares over probabilities, fall.
    pub fn variance_is_finite(&self, continuation_probability: f64) -> bool {
        self.decay() > -continuation_probability.log2()
    }

    /// The sum of the terms of the variance over the levels measured.
    pub fn terms(&self, continuation_probability: f64) -> f64 {
        let term = |(level, square): (usize, &f64)| {
            square
                / ((1.0 - continuation_probability)
                    * continuation_probability.powi(i32::try_from(level).unwrap_or(i32::MAX)))
        };
        self.squares.iter().enumerate().map(term).sum()
    }
}

/// A ray of unit length and optical depth one: `profile` of a factor, which is chosen so.
fn ray(name: &str, profile: impl Fn(f64) -> Profile, majorant: f64, minorant: f64) -> ProfileCase {
    let factor = 1.0 / profile(1.0).optical_depth(1.0);
    ProfileCase {
        name: name.into(),
        profile: profile(factor),
        length: 1.0,
        majorant: majorant * factor,
        minorant: minorant * factor,
        use_majorant: None,
    }
}

fn rays() -> Vec<ProfileCase> {
    let ramp = |f| Profile::Linear { a: 0.2 * f, b: 3.0 * f };
    let waves = |f| Profile::Sine { mean: f, amplitude: 0.8 * f, cycles: 2.3 };
    let steps = |f| Profile::Steps {
        edges: vec![0.0, 0.2, 0.5, 0.7, 1.0],
        values: [0.5, 3.0, 0.2, 1.5].map(|v| v * f).to_vec(),
    };
    let spike = |f| Profile::Tents {
        centres: vec![0.37],
        half_width: 0.002,
        peaks: vec![500.0 * f],
        floor: 0.2 * f,
    };
    vec![
        ray("ramp", ramp, 3.2, 0.2),
        ray("waves", waves, 1.8, 0.2),
        ray("steps", steps, 3.0, 0.2),
        ray("spike", spike, 500.2, 0.2),
    ]
}

fn functions() -> Result<Vec<(&'static str, TransmittanceFunction)>, Error> {
    let power = Power::new(2.0).map_err(Error::Media)?;
    let erlang = Erlang::new(3).map_err(Error::Media)?;
    let component = |function| Component { weight: 1.0, rate: 1.0, function };
    let half_linear =
        Mixture::new(vec![component(None), component(Some(TransmittanceFunction::Linear(Linear)))])
            .map_err(Error::Media)?;
    Ok(vec![
        ("power k 2", TransmittanceFunction::Power(power)),
        ("erlang n 3", TransmittanceFunction::Erlang(erlang)),
        // The depth of all rays is that of its kink.
        ("half linear", TransmittanceFunction::Mixture(half_linear)),
    ])
}

/// Exponents `c` of the continuation probability `2^-c`.
const EXPONENTS: [f64; 8] = [1.05, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 5.0];

/// The debiased estimator under transmittance functions, from a place, on rays of optical depth one
/// in closed form: what its levels' differences are, and what a choice of levels costs. The figures
/// are the same on every machine.
///
/// # Errors
/// If a transmittance function cannot be made.
pub fn chart_debiasing() -> Result<Chart, Error> {
    let mut table = Table::new(&[
        "transmittance function",
        "ray",
        "c",
        "decay of squares",
        "variance finite",
        "z",
        "relative variance",
        "terms of the variance",
        "worst / exact",
        "lookups",
        "relative variance x lookups",
    ]);
    let (mut squares, mut costs) = (Vec::new(), Vec::new());
    for (function_name, function) in functions()? {
        for case in rays() {
            let passage = Passage { function: &function, start: StartCorrelation::Uncorrelated };
            let exact = passage.survival(case.optical_depth());
            let levels = Levels::measured(|| case.ray(), passage, LEVELS, DIFFERENCES);
            let name = format!("{function_name}, {}", case.name);
            let point = |(level, square): (usize, &f64)| [level as f64, square.sqrt() / exact];
            let points = levels.squares().iter().enumerate().map(point).collect();
            squares.push(Series { name: name.clone(), points, line: true });
            let mut cost = Vec::new();
            for c in EXPONENTS {
                let continuation_probability = 2f64.powf(-c);
                let series = DebiasingSeries {
                    samples: DEBIASED_SAMPLES,
                    continuation_probability: continuation_probability as f32,
                };
                let mut rng = Pcg32::new(20_261_125, 99);
                let mut samples = Samples::default();
                for _ in 0..ESTIMATES {
                    let tally = &mut samples.tally;
                    let estimate = debiased_non_exponential(
                        case.ray(),
                        passage,
                        Grey,
                        series,
                        &mut rng,
                        tally,
                    );
                    samples.push(f64::from(estimate));
                }
                let moments = samples.moments();
                let variance = moments.variance / (exact * exact);
                let lookups = samples.tally.lookups as f64 / f64::from(ESTIMATES);
                table.push(vec![
                    function_name.into(),
                    case.name.as_str().into(),
                    Cell::Number(c),
                    Cell::Number(levels.decay()),
                    if levels.variance_is_finite(continuation_probability) { "yes" } else { "no" }
                        .into(),
                    Cell::Number(moments.z(exact, 1e-6 * exact)),
                    Cell::Number(variance),
                    Cell::Number(levels.terms(continuation_probability) / (exact * exact)),
                    Cell::Number(moments.worst / exact),
                    Cell::Number(lookups),
                    Cell::Number(variance * lookups),
                ]);
                cost.push([c, variance * lookups]);
            }
            costs.push(Series { name, points: cost, line: true });
        }
    }
    Ok(Chart {
        name: "debiasing".into(),
        title: "Debiasing series of non-exponential transmittance".into(),
        notes: vec![
            "The coarsest level and one difference of a debiasing series; level j is chosen with a probability in proportion to 2^(-c j) and costs 2^j. Work is finite for c > 1, the variance where the mean \
             squares of differences fall by more than 2^-c a level. Where it is infinite the measured variance is that of the estimates that happened: the terms of the variance, summed over eleven levels, show what is missing."
                .into(),
        ],
        provenance: Provenance::here(20_261_125)
            .with("estimates", ESTIMATES)
            .with("differences per level", DIFFERENCES)
            .with("samples of the coarsest level", DEBIASED_SAMPLES),
        table,
        plots: vec![
            Plot {
                name: "levels".into(),
                title: "Differences of neighbouring levels".into(),
                x: Axis::linear("level"),
                y: Axis::log("root mean square over the transmittance"),
                series: squares,
            },
            Plot {
                name: "cost".into(),
                title: "Cost of an error by how levels are chosen (20,000 estimates each)".into(),
                x: Axis::linear("c: level j has probability 2^(-c j)"),
                y: Axis::log("relative variance x lookups"),
                series: costs,
            },
        ],
        pictures: Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where ends do not match and at edges jittered samples converge at first order, so that mean
    /// squares of differences fall by four powers of two a level; a spike's do so later, and
    /// faster. A choice of levels is judged by that.
    #[test]
    fn decay_tells_finite_variance_from_infinite() {
        let function = functions().unwrap().remove(0).1;
        let passage = Passage { function: &function, start: StartCorrelation::Uncorrelated };
        for case in rays() {
            let levels = Levels::measured(|| case.ray(), passage, LEVELS, 512);
            let decay = levels.decay();
            if case.name != "spike" {
                assert!((decay - 4.0).abs() < 0.6, "{} {decay} {levels:?}", case.name);
                assert!(!levels.variance_is_finite(2f64.powf(-5.0)), "{}", case.name);
            }
            assert!(levels.variance_is_finite(2f64.powf(-1.5)), "{} {levels:?}", case.name);
        }
        // Constant extinction has no differences: nothing is too rare.
        let flat = ray("flat", |value| Profile::Constant { value }, 1.0, 1.0);
        let levels = Levels::measured(|| flat.ray(), passage, LEVELS, 16);
        assert!(levels.variance_is_finite(1e-9), "{levels:?}");
    }
}
