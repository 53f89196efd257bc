//! Where methods break: every transmittance estimator and every sampler of flights against every
//! stress.

use super::debiasing::Levels;
use super::measure::Samples;
use super::stress::{Stress, Subject, all_stresses};
use crate::Error;
use crate::chart::{Axis, Cell, Chart, Plot, Provenance, Series, Table};
use glam::{DVec3, Vec3};
use pileus_film::{Film, Filter};
use pileus_integrator::{RenderSettings, Renderer, Unmonitored};
use pileus_media::distance::{DistanceSampler, Flight};
use pileus_media::method::Facts;
use pileus_media::transmittance::{
    DebiasingSeries, Estimator, debiased_non_exponential, exact_non_exponential,
};
use pileus_media::transmittance_function::{
    Passage, Power, StartCorrelation, TransmittanceFunction,
};
use pileus_media::{
    Channels, ChromaticRatio, ExactField, Grey, Scaled, Spectrum, Tally, optical_depth,
};
use pileus_scene::Scene;
use rand_pcg::Pcg32;
use rayon::prelude::*;

/// Estimates per cell, unless they are dear.
const SAMPLES: u32 = 4096;
/// Lookups and steps per cell after which no further estimate is made: a count, so that the outcome
/// is the same on every machine.
const MAX_EVENTS: u64 = 20_000_000;
/// |z| beyond which a mean is wrong: by chance once in ten thousand tables of a thousand cells.
const Z_LIMIT: f64 = 5.5;
/// Relative standard deviation above which a method is noisy: a hundred estimates still leave 30 %.
const NOISY: f64 = 3.0;
/// Relative standard deviation above which a method fails: ten thousand estimates still leave 100
/// %.
const FAILS: f64 = 100.0;
/// Transmittance below which nothing is asked: single precision ends there.
const SMALLEST: f64 = 1e-37;

/// How a method bears a stress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Unbiased within its standard error, standard deviation of at most three times the value.
    Ok,
    /// Unbiased, but noisier.
    Noisy,
    /// Named biased, and caught.
    Biased,
    /// Wrong, not finite, or so noisy that it is of no use.
    Fails,
    /// Does not apply; jobs refuse it.
    Refused,
}

impl Verdict {
    /// Name of the verdict, as tables have it.
    pub const fn name(self) -> &'static str {
        match self {
            Verdict::Ok => "ok",
            Verdict::Noisy => "noisy",
            Verdict::Biased => "biased",
            Verdict::Fails => "fails",
            Verdict::Refused => "refused",
        }
    }
}

/// One method under one stress.
#[derive(Debug, Clone)]
pub struct StabilityCell {
    /// The method, as `transmittance` or `distance` and its name.
    pub method: String,
    /// The stress.
    pub stress: String,
    /// The verdict.
    pub verdict: Verdict,
    /// Distance of the mean from the exact value, standard errors; the worst over channels or bins.
    pub z: f64,
    /// Standard deviation of one estimate over the exact value; of the total weight for flights.
    pub relative_deviation: f64,
    /// Lookups per estimate.
    pub lookups: f64,
    /// Majorant steps per estimate.
    pub steps: f64,
    /// The estimate that was farthest off, over the exact value.
    pub worst: f64,
    /// Estimates that were not finite.
    pub non_finite: u64,
    /// Why, where the verdict is not ok.
    pub reason: &'static str,
}

/// The whole matrix.
#[derive(Debug, Clone)]
pub struct Stability {
    /// Names of the stresses with what they are.
    pub stresses: Vec<(String, String)>,
    /// All cells, method by method.
    pub cells: Vec<StabilityCell>,
}

/// Transmittance under a power law of `k = 2`, from a place.
#[derive(Clone, Copy, PartialEq)]
enum NonExponentialMethod {
    /// The transmittance function of the exact depth.
    Regular,
    /// Ratio tracking at a drawn rate.
    Ratio,
    /// A debiasing series of the continuation probability `2^-c`.
    Debiased(f64),
}

impl NonExponentialMethod {
    /// The last goes on so rarely that its variance is infinite.
    const ALL: [NonExponentialMethod; 4] = [
        NonExponentialMethod::Regular,
        NonExponentialMethod::Ratio,
        NonExponentialMethod::Debiased(1.5),
        NonExponentialMethod::Debiased(5.0),
    ];
}

#[derive(Clone, Copy, PartialEq)]
enum Method {
    NonExponential(NonExponentialMethod),
    Transmittance(Estimator),
    Distance(DistanceSampler),
}

impl Method {
    fn all() -> Vec<Method> {
        let estimators = Estimator::ALL.into_iter().map(Method::Transmittance);
        // Channels that part are a question of pictures, in which everything here is grey.
        let samplers = DistanceSampler::ALL.into_iter().filter(|s| *s != DistanceSampler::Split);
        let samplers = samplers.map(Method::Distance);
        let functions = NonExponentialMethod::ALL.into_iter().map(Method::NonExponential);
        estimators.chain(samplers).chain(functions).collect()
    }

    fn name(self) -> String {
        match self {
            Method::Transmittance(estimator) => format!("transmittance {}", estimator.name()),
            Method::Distance(sampler) => format!("distance {}", sampler.name()),
            Method::NonExponential(NonExponentialMethod::Regular) => "power law regular".to_owned(),
            Method::NonExponential(NonExponentialMethod::Ratio) => "power law ratio".to_owned(),
            Method::NonExponential(NonExponentialMethod::Debiased(c)) => {
                format!("power law debiased 2^-{c}")
            }
        }
    }

    fn is_unbiased(self) -> bool {
        match self {
            Method::Transmittance(estimator) => estimator.is_unbiased(),
            Method::Distance(sampler) => sampler.is_unbiased(),
            Method::NonExponential(_) => true,
        }
    }
}

/// Estimates of one quantity that should be `exact` in the mean.
fn judge(samples: &[(Samples, f64)]) -> (f64, f64, f64, u64, bool) {
    let (mut z, mut deviation, mut worst, mut non_finite, mut missed) =
        (0.0f64, 0.0f64, 0.0f64, 0, false);
    for (samples, exact) in samples {
        let moments = samples.moments();
        non_finite += samples.non_finite;
        let scale = exact.max(SMALLEST);
        let tolerance = 3e-5 * exact + SMALLEST;
        let here = moments.z(*exact, tolerance);
        if here.abs() > z.abs() || here.is_nan() {
            z = here;
        }
        deviation = deviation.max(moments.variance.sqrt() / scale);
        if (moments.worst / scale - 1.0).abs() > (worst - 1.0).abs() || worst == 0.0 {
            worst = moments.worst / scale;
        }
        missed |= (moments.mean - exact).abs() > 0.5 * scale && *exact > SMALLEST;
    }
    (z, deviation, worst, non_finite, missed)
}

/// Draws until there are enough samples or too many events.
fn draw(mut one: impl FnMut(&mut Pcg32, &mut Tally)) -> (Tally, u32) {
    let mut rng = Pcg32::new(20_261_123, 17);
    let mut tally = Tally::default();
    let mut n = 0;
    while n < SAMPLES && tally.lookups + tally.majorant_steps < MAX_EVENTS {
        one(&mut rng, &mut tally);
        n += 1;
    }
    (tally, n)
}

struct Outcome {
    judged: (f64, f64, f64, u64, bool),
    lookups: f64,
    steps: f64,
}

fn estimate<F: ExactField, C: Channels>(
    estimator: Estimator,
    field: impl Fn() -> F,
    channels: C,
    depth: f64,
) -> Outcome {
    let mut samples = vec![Samples::default(); C::Value::COUNT];
    let (tally, n) = draw(|rng, tally| {
        let value = estimator.estimate(field(), channels, 0.0, rng, tally);
        for (c, samples) in samples.iter_mut().enumerate() {
            samples.push(f64::from(value.channel(c)));
        }
    });
    let exact = |c: usize| {
        let relative = f64::from(channels.of(1.0).channel(c));
        if relative == 0.0 { 1.0 } else { (-relative * depth).exp() }
    };
    let samples: Vec<_> = samples.into_iter().enumerate().map(|(c, s)| (s, exact(c))).collect();
    Outcome {
        judged: judge(&samples),
        lookups: tally.lookups as f64 / f64::from(n),
        steps: tally.majorant_steps as f64 / f64::from(n),
    }
}

/// Flights by where they end: eight parts of equal probability in the first channel and the escape,
/// and their total weight, whose mean is one.
fn fly<F: ExactField, C: Channels>(
    sampler: DistanceSampler,
    field: impl Fn() -> F,
    channels: C,
    depth: f64,
) -> Outcome {
    const PARTS: usize = 8;
    let escape = (-depth).exp();
    let ends: Vec<(f64, f64)> = (1..PARTS)
        .map(|k| {
            let tau = -(1.0 - k as f64 / PARTS as f64 * (1.0 - escape)).ln();
            let t = field().t_at_depth(tau, &mut Tally::default());
            (tau, t.map_or(f64::INFINITY, f64::from))
        })
        .collect();
    let mut parts = vec![vec![Samples::default(); PARTS + 2]; C::Value::COUNT];
    let beta = C::Value::ONE;
    let (tally, n) = draw(|rng, tally| {
        let flown = sampler.fly(field(), channels, beta, None, rng, tally);
        let part = match flown.flight {
            Flight::Collision(t) => ends.iter().filter(|end| f64::from(t) > end.1).count(),
            Flight::Escape => PARTS,
        };
        for (c, parts) in parts.iter_mut().enumerate() {
            let weight = f64::from(flown.weight.channel(c));
            for (k, samples) in parts.iter_mut().enumerate() {
                samples.push(if k == part || k == PARTS + 1 { weight } else { 0.0 });
            }
        }
    });
    let mut bins = Vec::new();
    let mut totals = Vec::new();
    for (c, parts) in parts.into_iter().enumerate() {
        let relative = f64::from(channels.of(1.0).channel(c));
        let through = |tau: f64| if relative == 0.0 { 1.0 } else { (-relative * tau).exp() };
        for (k, samples) in parts.into_iter().enumerate() {
            if k == PARTS + 1 {
                totals.push((samples, 1.0));
                continue;
            }
            let start = if k == 0 { 0.0 } else { ends.get(k - 1).map_or(depth, |end| end.0) };
            let exact = if k == PARTS {
                through(depth)
            } else {
                through(start) - through(ends.get(k).map_or(depth, |end| end.0))
            };
            // Too few flights end there for a normal mean.
            if exact * f64::from(n) >= 50.0 {
                bins.push((samples, exact));
            }
        }
    }
    let (z, _, _, bad, missed) = judge(&bins);
    let (z_total, deviation, worst, bad_total, missed_total) = judge(&totals);
    let z = if z.abs() > z_total.abs() { z } else { z_total };
    Outcome {
        judged: (z, deviation, worst, bad.max(bad_total), missed || missed_total),
        lookups: tally.lookups as f64 / f64::from(n),
        steps: tally.majorant_steps as f64 / f64::from(n),
    }
}

/// Levels whose differences tell whether a series' variance is finite, and differences for each.
const LEVELS: (u32, u32) = (11, 128);

fn estimate_non_exponential<F: ExactField, C: Channels>(
    method: NonExponentialMethod,
    field: impl Fn() -> F,
    channels: C,
    depth: f64,
) -> Result<Outcome, Error> {
    let function = TransmittanceFunction::Power(Power::new(2.0).map_err(Error::Media)?);
    let passage = Passage { function: &function, start: StartCorrelation::Uncorrelated };
    let mut samples = vec![Samples::default(); C::Value::COUNT];
    let (tally, n) = draw(|rng, tally| {
        let value = match method {
            NonExponentialMethod::Regular => {
                exact_non_exponential(&field(), passage, channels, tally)
            }
            NonExponentialMethod::Ratio => {
                let field = Scaled::new(field(), passage.rate(rng).unwrap_or(1.0));
                Estimator::Ratio.estimate(field, channels, 0.0, rng, tally)
            }
            NonExponentialMethod::Debiased(c) => {
                let series = DebiasingSeries {
                    continuation_probability: 2f64.powf(-c) as f32,
                    ..DebiasingSeries::default()
                };
                debiased_non_exponential(field(), passage, channels, series, rng, tally)
            }
        };
        for (c, samples) in samples.iter_mut().enumerate() {
            samples.push(f64::from(value.channel(c)));
        }
    });
    let exact = |c: usize| {
        let relative = f64::from(channels.of(1.0).channel(c));
        if relative == 0.0 { 1.0 } else { passage.survival(relative * depth) }
    };
    let samples: Vec<_> = samples.into_iter().enumerate().map(|(c, s)| (s, exact(c))).collect();
    let mut judged = judge(&samples);
    if let NonExponentialMethod::Debiased(c) = method
        && !Levels::measured(&field, passage, LEVELS.0, LEVELS.1).variance_is_finite(2f64.powf(-c))
    {
        judged.1 = f64::INFINITY;
    }
    Ok(Outcome {
        judged,
        lookups: tally.lookups as f64 / f64::from(n),
        steps: tally.majorant_steps as f64 / f64::from(n),
    })
}

fn ask<F: ExactField, C: Channels>(
    method: Method,
    field: impl Fn() -> F,
    channels: C,
    depth: f64,
) -> Result<Outcome, Error> {
    Ok(match method {
        Method::Transmittance(estimator) => estimate(estimator, field, channels, depth),
        Method::Distance(sampler) => fly(sampler, field, channels, depth),
        Method::NonExponential(method) => estimate_non_exponential(method, field, channels, depth)?,
    })
}

fn render_picture(
    method: Method,
    scene: &Scene,
    expected: &[f64],
    max_bounces: Option<u32>,
) -> Result<Outcome, Error> {
    let base = RenderSettings {
        samples: 0..64,
        seed: 11,
        max_bounces,
        filter: Filter::Box { radius: 1e-4 },
        ..RenderSettings::default()
    };
    let settings = match method {
        Method::Transmittance(estimator) => {
            RenderSettings { transmittance: Some(estimator), ..base }
        }
        Method::Distance(sampler) => RenderSettings {
            distance: Some(sampler),
            transmittance: Some(Estimator::Ratio),
            ..base
        },
        Method::NonExponential(_) => base,
    };
    let renderer = Renderer::new(scene, &settings).map_err(Error::Render)?;
    let [width, height] = scene.camera.resolution();
    let mut film = Film::new([width, height], None)?;
    let counters = renderer.render(&mut film, &Unmonitored).map_err(Error::Render)?;
    let (image, variance) = (film.image(), film.variance());
    let (mut difference, mut noise, mut truth) = (0.0f64, 0.0f64, 0.0f64);
    let mut worst = 1.0f64;
    for (i, exact) in (0..).zip(expected) {
        let (x, y) = (i % width, i / width);
        let value = f64::from(image.get("G", x, y).unwrap_or(f32::NAN));
        difference += value - exact;
        noise += f64::from(variance.get("G", x, y).unwrap_or(f32::NAN));
        truth += exact;
        if (value / exact - 1.0).abs() > (worst - 1.0).abs() {
            worst = value / exact;
        }
    }
    let pixels = f64::from(width * height);
    let samples = 64.0;
    let beyond = (difference.abs() - 1e-5 * truth).max(0.0) * difference.signum();
    let z = if beyond == 0.0 { 0.0 } else { beyond / noise.sqrt() };
    let deviation = (noise / pixels * samples).sqrt() / (truth / pixels);
    let missed = difference.abs() > 0.5 * truth;
    let paths = counters.paths as f64;
    Ok(Outcome {
        judged: (z, deviation, worst, counters.dropped, missed),
        lookups: counters.lookups as f64 / paths,
        steps: counters.majorant_steps as f64 / paths,
    })
}

fn weakness(facts: Facts, broken: bool) -> &'static str {
    if broken { facts.weakness_without_bounds } else { facts.weakness }
}

/// Why a method does not bear a stress.
fn reason(method: Method, stress: &Stress) -> &'static str {
    let broken = stress.broken;
    match method {
        Method::Transmittance(estimator) => weakness(estimator.facts(), broken),
        Method::Distance(sampler) => weakness(sampler.facts(), broken),
        Method::NonExponential(NonExponentialMethod::Regular) => "exact but for rounding",
        Method::NonExponential(NonExponentialMethod::Ratio) if broken => {
            "null ratios change sign where the bound does not hold, the more so at high rates"
        }
        Method::NonExponential(NonExponentialMethod::Ratio) => {
            "as ratio tracking, on thicker media where the rate is high"
        }
        Method::NonExponential(NonExponentialMethod::Debiased(_)) => {
            "infinite variance, as far as sixteen thousand samples show: levels are chosen more rarely than their differences shrink, or the rarer ones carry what the coarse ones miss"
        }
    }
}

fn cell(method: Method, stress: &Stress) -> Result<StabilityCell, Error> {
    let blank = StabilityCell {
        method: method.name(),
        stress: stress.name.clone(),
        verdict: Verdict::Refused,
        z: f64::NAN,
        relative_deviation: f64::NAN,
        lookups: f64::NAN,
        steps: f64::NAN,
        worst: f64::NAN,
        non_finite: 0,
        reason: "",
    };
    if method == Method::Distance(DistanceSampler::Analytic) && !stress.homogeneous {
        let reason = "closed form of constant extinction only: the plan refuses grids";
        return Ok(StabilityCell { reason, ..blank });
    }
    if method == Method::Distance(DistanceSampler::Equiangular) && stress.name != "light in smoke" {
        let reason = "no point light that points could be aimed at: the plan flies";
        return Ok(StabilityCell { reason, ..blank });
    }
    if matches!((method, &stress.subject), (Method::NonExponential(_), Subject::Picture(..))) {
        let reason = "expectations of pictures are those of the exponential transmittance";
        return Ok(StabilityCell { reason, ..blank });
    }
    let outcome = match &stress.subject {
        Subject::Profile(case) => ask(method, || case.ray(), Grey, case.optical_depth())?,
        Subject::Chromatic(case, relative) => {
            ask(method, || case.ray(), ChromaticRatio(*relative), case.optical_depth())?
        }
        Subject::Grid(medium, origin, direction) => {
            let d = direction.as_dvec3();
            let depth = optical_depth(medium, *origin, d, 0.0, 1e30, &mut Tally::default());
            let span = medium.span(*origin, *direction, f64::INFINITY).ok_or(Error::Argument {
                what: format!("{}: the ray misses the grid", stress.name),
                remedy: "aim the ray at it",
            })?;
            ask(method, || medium.any_ray(&span, 1.0), Grey, depth)?
        }
        Subject::Homogeneous(medium, length) => {
            let depth = medium.largest_sigma_t() * f64::from(*length);
            let span = medium.span(DVec3::ZERO, Vec3::X, f64::from(*length));
            let span = span.ok_or(Error::Argument {
                what: format!("{}: the ray has no length", stress.name),
                remedy: "give it one",
            })?;
            ask(method, || medium.any_ray(&span, 1.0), Grey, depth)?
        }
        Subject::Picture(scene, expected, max_bounces) => {
            render_picture(method, scene, expected, *max_bounces)?
        }
    };
    let (z, deviation, worst, non_finite, missed) = outcome.judged;
    let verdict = if non_finite > 0 || !z.is_finite() && !missed {
        Verdict::Fails
    } else if z.abs() > Z_LIMIT && !method.is_unbiased() {
        Verdict::Biased
    } else if z.abs() > Z_LIMIT || missed || deviation > FAILS {
        Verdict::Fails
    } else if deviation > NOISY {
        Verdict::Noisy
    } else {
        Verdict::Ok
    };
    Ok(StabilityCell {
        verdict,
        z,
        relative_deviation: deviation,
        lookups: outcome.lookups,
        steps: outcome.steps,
        worst,
        non_finite,
        reason: if verdict == Verdict::Ok { "" } else { reason(method, stress) },
        ..blank
    })
}

/// Measures every method under every stress. The same on every machine and any number of threads.
///
/// # Errors
/// If a scene of a stress cannot be built.
pub fn stability() -> Result<Stability, Error> {
    let stresses = all_stresses()?;
    let pairs: Vec<(Method, &Stress)> =
        Method::all().into_iter().flat_map(|m| stresses.iter().map(move |s| (m, s))).collect();
    let cells: Result<Vec<StabilityCell>, Error> =
        pairs.into_par_iter().map(|(method, stress)| cell(method, stress)).collect();
    Ok(Stability {
        stresses: stresses.iter().map(|s| (s.name.clone(), s.what.clone())).collect(),
        cells: cells?,
    })
}

impl Stability {
    /// All figures.
    pub fn table(&self) -> Table {
        let mut table = Table::new(&[
            "method",
            "stress",
            "verdict",
            "z",
            "relative deviation",
            "lookups",
            "steps",
            "worst / exact",
            "non-finite",
            "reason",
        ]);
        for cell in &self.cells {
            table.push(vec![
                cell.method.as_str().into(),
                cell.stress.as_str().into(),
                cell.verdict.name().into(),
                cell.z.into(),
                cell.relative_deviation.into(),
                cell.lookups.into(),
                cell.steps.into(),
                cell.worst.into(),
                Cell::Count(cell.non_finite),
                cell.reason.into(),
            ]);
        }
        table
    }

    /// The verdicts as a matrix of stresses by methods.
    pub fn matrix(&self) -> Table {
        let mut methods: Vec<&str> = Vec::new();
        for cell in &self.cells {
            if !methods.contains(&cell.method.as_str()) {
                methods.push(&cell.method);
            }
        }
        let mut columns = vec!["stress"];
        columns.extend(&methods);
        let mut table = Table::new(&columns);
        for (stress, _) in &self.stresses {
            let verdict = |method: &&str| {
                let of = |c: &&StabilityCell| c.method == *method && c.stress == *stress;
                self.cells.iter().find(of).map_or("", |c| c.verdict.name()).into()
            };
            let mut row: Vec<Cell> = vec![stress.as_str().into()];
            row.extend(methods.iter().map(verdict));
            table.push(row);
        }
        table
    }

    /// The page of the documentation.
    pub fn markdown(&self) -> String {
        let count = |v: Verdict| self.cells.iter().filter(|c| c.verdict == v).count();
        let mut page = format!(
            "# Where methods break\n\nWritten by `pileus chart stability`; a test keeps the verdicts from changing unseen. Every cell is {SAMPLES} estimates \
             (fewer where they need more than {MAX_EVENTS} lookups and steps) of a fixed seed, without roulette.\n\n\
             - **ok**: the mean is within {Z_LIMIT} standard errors of the exact value, and the standard deviation of one estimate is at most {NOISY} times that value \
             (for flights: of their total weight, whose mean is 1).\n\
             - **noisy**: unbiased, but noisier than that.\n\
             - **biased**: a method that is named biased, and is caught.\n\
             - **fails**: wrong by more than {Z_LIMIT} standard errors, off by more than half (what matters was never sampled), a standard deviation above {FAILS} times the \
             value, or an estimate that is not finite.\n\
             - **refused**: the plan does not run it there, or there is nothing to compare it with.\n\n\
             A debiasing series fails also where its variance is infinite: where the mean squares of its differences fall more slowly than the probabilities of its levels, \
             as far as sixteen thousand samples show.\n\n\
             {} cells are ok, {} noisy, {} biased, {} fail, {} are refused. Transmittances below {SMALLEST:e}, where single precision ends, are not asked for: there zero is ok. \
             Every figure is in [stability.csv](stability.csv).\n\n",
            count(Verdict::Ok),
            count(Verdict::Noisy),
            count(Verdict::Biased),
            count(Verdict::Fails),
            count(Verdict::Refused),
        );
        let matrix = self.matrix();
        for (title, kind) in [
            ("Transmittance", "transmittance "),
            ("Distances", "distance "),
            ("Transmittance under a power law of k 2", "power law "),
        ] {
            let keep: Vec<usize> = (0..matrix.columns.len())
                .filter(|i| *i == 0 || matrix.columns[*i].starts_with(kind))
                .collect();
            let part = Table {
                columns: keep.iter().map(|i| matrix.columns[*i].replace(kind, "")).collect(),
                rows: matrix
                    .rows
                    .iter()
                    .map(|row| keep.iter().map(|i| row[*i].clone()).collect())
                    .collect(),
            };
            page += &format!("## {title}\n\n{}\n", part.markdown());
        }
        page += "## The stresses\n\n";
        for (name, what) in &self.stresses {
            page += &format!("- **{name}**: {what}.\n");
        }
        page += "\n## Why\n\n";
        let mut told: Vec<(&str, &str)> = Vec::new();
        for cell in self.cells.iter().filter(|c| !c.reason.is_empty()) {
            if !told.contains(&(&cell.method, cell.reason)) {
                told.push((&cell.method, cell.reason));
                let stresses: Vec<&str> = self
                    .cells
                    .iter()
                    .filter(|c| c.method == cell.method && c.reason == cell.reason)
                    .map(|c| c.stress.as_str())
                    .collect();
                let list = if stresses.len() > 12 {
                    "most stresses".to_owned()
                } else {
                    stresses.join(", ")
                };
                page += &format!("- **{}** ({list}): {}.\n", cell.method, cell.reason);
            }
        }
        page
    }

    /// The map as a chart, with deviation over optical depth and over looseness.
    pub fn chart(&self) -> Chart {
        let along = |prefix: &str| -> Vec<Series> {
            let mut series: Vec<Series> = Vec::new();
            for cell in &self.cells {
                let Some(x) = cell.stress.strip_prefix(prefix).and_then(|x| x.parse::<f64>().ok())
                else {
                    continue;
                };
                let point = [x, cell.relative_deviation];
                match series.iter_mut().find(|s| s.name == cell.method) {
                    Some(series) => series.points.push(point),
                    None => series.push(Series {
                        name: cell.method.clone(),
                        points: vec![point],
                        line: true,
                    }),
                }
            }
            series
        };
        let plot = |name: &str, title: &str, x: &str, prefix: &str| Plot {
            name: name.into(),
            title: title.into(),
            x: Axis::log(x),
            y: Axis::log("relative standard deviation"),
            series: along(prefix),
        };
        Chart {
            name: "stability".into(),
            title: "Where methods break".into(),
            notes: vec![
                "Every method under every stress; see the page of the documentation of the same name for what the verdicts mean.".into(),
            ],
            provenance: Provenance::here(20_261_123).with("samples per cell", SAMPLES),
            table: self.table(),
            plots: vec![
                plot("depth", "Deviation over optical depth, tight bound", "optical depth", "depth "),
                plot("loose", "Deviation under loose bounds, optical depth 1", "bound too loose by", "loose "),
                plot("broken", "Deviation where bounds do not hold, optical depth 2", "extinction over bound", "broken bound "),
            ],
            pictures: Vec::new(),
        }
    }
}
