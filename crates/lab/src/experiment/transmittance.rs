//! Every transmittance estimator on the same rays: variance times cost, convergence, bias.

use super::measure::Samples;
use super::rays::{LabRay, RayClass};
use crate::chart::{Axis, Cell, Chart, Plot, Provenance, Series, Table};
use crate::profile::ProfileCase;
use pileus_media::kernel::{GridShape, Voxel, VoxelKernel};
use pileus_media::transmittance::{
    Control, DEBIASED_SAMPLES, Estimator, debiased_ray_marching, residual_ratio_tracking,
    unbiased_ray_marching,
};
use pileus_media::{ExactField, Grey, Medium, Span, Tally};
use rand_pcg::Pcg32;
use std::time::Instant;

/// An estimator, or a variant of one that jobs cannot name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TransmittanceMethod {
    /// One of those that jobs name.
    Named(Estimator),
    /// Residual ratio tracking about the middle of minorant and majorant.
    ResidualRatioMiddle,
    /// Unbiased ray marching with symmetric means on intervals of at most this majorant depth, cut
    /// at majorant cells.
    UnbiasedRayMarchingCut(f32),
    /// Debiased ray marching on such intervals.
    DebiasedRayMarchingCut(f32),
}

impl TransmittanceMethod {
    /// All estimators by name, and the variants that are charted beside them.
    pub fn all() -> Vec<TransmittanceMethod> {
        let mut methods: Vec<_> = Estimator::ALL.map(TransmittanceMethod::Named).to_vec();
        methods.push(TransmittanceMethod::ResidualRatioMiddle);
        methods.push(TransmittanceMethod::UnbiasedRayMarchingCut(1.0));
        methods.push(TransmittanceMethod::UnbiasedRayMarchingCut(8.0));
        methods.push(TransmittanceMethod::DebiasedRayMarchingCut(8.0));
        methods
    }

    /// Name of the method, as charts have it.
    pub fn name(self) -> String {
        match self {
            TransmittanceMethod::Named(estimator) => estimator.name().to_owned(),
            TransmittanceMethod::ResidualRatioMiddle => "residual_ratio, middle".to_owned(),
            TransmittanceMethod::UnbiasedRayMarchingCut(depth) => {
                format!("unbiased_ray_marching, cut {depth}")
            }
            TransmittanceMethod::DebiasedRayMarchingCut(depth) => {
                format!("debiased_ray_marching, cut {depth}")
            }
        }
    }

    /// Whether the mean of estimates is the transmittance.
    pub fn is_unbiased(self) -> bool {
        !matches!(self, TransmittanceMethod::Named(estimator) if !estimator.is_unbiased())
    }

    /// One estimate.
    pub fn estimate<F: ExactField>(self, field: F, rng: &mut Pcg32, tally: &mut Tally) -> f32 {
        match self {
            TransmittanceMethod::Named(estimator) => {
                estimator.estimate(field, Grey, 0.0, rng, tally)
            }
            TransmittanceMethod::ResidualRatioMiddle => {
                residual_ratio_tracking(field, Grey, Control::Middle, 0.0, rng, tally)
            }
            TransmittanceMethod::UnbiasedRayMarchingCut(depth) => {
                unbiased_ray_marching(field, Grey, depth, 0.0, rng, tally)
            }
            TransmittanceMethod::DebiasedRayMarchingCut(depth) => {
                debiased_ray_marching(field, Grey, DEBIASED_SAMPLES, depth, 0.0, rng, tally)
            }
        }
    }
}

/// What transmittance is estimated of.
#[derive(Debug, Clone)]
pub enum Subject<'a> {
    /// Rays through a grid.
    Rays {
        /// The medium.
        medium: &'a Medium,
        /// Rays of it.
        rays: Vec<LabRay>,
    },
    /// Closed forms, one class each.
    Profiles(Vec<ProfileCase>),
}

/// How much is measured.
#[derive(Debug, Clone)]
pub struct TransmittanceSettings {
    /// Estimates per ray and method.
    pub samples: u32,
    /// Seed.
    pub seed: u64,
    /// Methods.
    pub methods: Vec<TransmittanceMethod>,
    /// Seconds after which a method is given no more samples on a ray.
    pub seconds_per_ray: f64,
}

/// Estimates of one method on one ray.
struct Measured {
    class: String,
    exact: f64,
    samples: Samples,
}

fn sample<F: ExactField>(
    settings: &TransmittanceSettings,
    method: TransmittanceMethod,
    stream: u64,
    field: impl Fn() -> F,
) -> Samples {
    let mut rng = Pcg32::new(settings.seed, stream);
    let mut samples = Samples::default();
    let start = Instant::now();
    for i in 0..settings.samples {
        let value = method.estimate(field(), &mut rng, &mut samples.tally);
        samples.push(f64::from(value));
        if i % 64 == 63 && start.elapsed().as_secs_f64() > settings.seconds_per_ray {
            break;
        }
    }
    samples.seconds = start.elapsed().as_secs_f64();
    samples
}

struct OnRays<'a> {
    medium: &'a Medium,
    rays: &'a [LabRay],
    settings: &'a TransmittanceSettings,
    method: TransmittanceMethod,
}

impl OnRays<'_> {
    fn measure<F: ExactField>(&self, field: impl Fn(&Span) -> F) -> Vec<Measured> {
        let measure = |(i, ray): (usize, &LabRay)| {
            let span = self.medium.span(ray.origin, ray.direction, f64::INFINITY)?;
            let samples = sample(self.settings, self.method, i as u64, || field(&span));
            let exact = (-ray.optical_depth).exp();
            Some(Measured { class: ray.class.name().to_owned(), exact, samples })
        };
        self.rays.iter().enumerate().filter_map(measure).collect()
    }
}

/// On a grid whose rays are compiled for its voxels.
struct OnGrid<'a>(OnRays<'a>, &'a GridShape);

impl VoxelKernel for OnGrid<'_> {
    type Output = Vec<Measured>;
    fn run<V: Voxel>(self, voxels: &[V]) -> Vec<Measured> {
        let OnGrid(rays, grid) = self;
        rays.measure(|span| grid.ray(voxels, span, 1.0))
    }
}

/// Largest |z| that chance explains: for the normal law, once in a million charts of a hundred rays
/// and twenty methods.
const Z_LIMIT: f64 = 6.5;

/// Pooled figures of one method on the rays of one class.
struct Pooled {
    rays: usize,
    rel_variance: f64,
    lookups: f64,
    steps: f64,
    nanoseconds: f64,
    worst_z: f64,
    negative: f64,
    non_finite: u64,
    worst: f64,
    curve: Vec<[f64; 2]>,
}

fn pool(measured: &[&Measured]) -> Pooled {
    let rays = measured.len();
    let n: f64 =
        measured.iter().map(|m| m.samples.values.len() as f64 + m.samples.non_finite as f64).sum();
    let sum = |f: &dyn Fn(&Measured) -> f64| measured.iter().map(|m| f(m)).sum::<f64>();
    let scale = sum(&|m| m.exact * m.exact) / rays as f64;
    let nanoseconds = 1e9 * sum(&|m| m.samples.seconds) / n;
    let mut curve = Vec::new();
    let mut group = 1;
    loop {
        let errors: Option<Vec<f64>> =
            measured.iter().map(|m| m.samples.squared_error(group, m.exact)).collect();
        let Some(errors) = errors else { break };
        let error = (errors.iter().sum::<f64>() / rays as f64 / scale).sqrt();
        curve.push([group as f64 * nanoseconds * 1e-9, error]);
        group *= 2;
    }
    let z = |m: &Measured| m.samples.moments().z(m.exact, 2e-5 * m.exact).abs();
    let off = |m: &Measured| m.samples.moments().worst;
    Pooled {
        rays,
        rel_variance: sum(&|m| m.samples.moments().variance) / rays as f64 / scale,
        lookups: sum(&|m| m.samples.tally.lookups as f64) / n,
        steps: sum(&|m| m.samples.tally.majorant_steps as f64) / n,
        nanoseconds,
        worst_z: measured.iter().map(|m| z(m)).fold(0.0, f64::max),
        negative: sum(&|m| m.samples.moments().negative) / rays as f64,
        non_finite: measured.iter().map(|m| m.samples.non_finite).sum(),
        worst: measured
            .iter()
            .map(|m| off(m))
            .max_by(|a, b| a.abs().total_cmp(&b.abs()))
            .unwrap_or(0.0),
        curve,
    }
}

/// Relative error below which a curve shows the rounding of single precision, not noise.
const ROUNDING: f64 = 1e-5;

/// Slope of the error over time on logarithmic axes, by least squares; `NaN` without error beyond
/// rounding.
fn slope(curve: &[[f64; 2]]) -> f64 {
    let points: Vec<[f64; 2]> =
        curve.iter().filter(|p| p[1] > ROUNDING).map(|p| [p[0].ln(), p[1].ln()]).collect();
    let n = points.len() as f64;
    let mean = |k: usize| points.iter().map(|p| p[k]).sum::<f64>() / n;
    let (mx, my) = (mean(0), mean(1));
    let above: f64 = points.iter().map(|p| (p[0] - mx) * (p[1] - my)).sum();
    let below: f64 = points.iter().map(|p| (p[0] - mx).powi(2)).sum();
    if points.len() >= 3 { above / below } else { f64::NAN }
}

/// Measures all methods on the rays of a subject, one thread, one ray after the other.
pub fn chart_transmittance(
    name: &str,
    subject: &Subject<'_>,
    settings: &TransmittanceSettings,
) -> Chart {
    let mut table = Table::new(&[
        "method",
        "class",
        "rays",
        "relative variance",
        "lookups",
        "steps",
        "ns",
        "rel. variance x lookups",
        "rel. variance x us",
        "slope",
        "worst |z|",
        "verdict",
        "negative",
        "non-finite",
        "worst estimate",
    ]);
    let mut classes: Vec<String> = match subject {
        Subject::Rays { .. } => RayClass::ALL.map(|c| c.name().to_owned()).to_vec(),
        Subject::Profiles(cases) => cases.iter().map(|c| c.name.clone()).collect(),
    };
    classes.push("all".into());
    let mut curves: Vec<(String, Vec<Series>)> =
        classes.iter().map(|c| (c.clone(), Vec::new())).collect();
    let mut costs: Vec<Series> = Vec::new();
    for method in &settings.methods {
        let measured = match subject {
            Subject::Rays { medium, rays } => {
                let on = OnRays { medium, rays, settings, method: *method };
                match medium.default_grid() {
                    Some(grid) => grid.with_voxels(OnGrid(on, grid)),
                    None => on.measure(|span| medium.any_ray(span, 1.0)),
                }
            }
            Subject::Profiles(cases) => cases
                .iter()
                .enumerate()
                .map(|(i, case)| Measured {
                    class: case.name.clone(),
                    exact: (-case.optical_depth()).exp(),
                    samples: sample(settings, *method, i as u64, || case.ray()),
                })
                .collect(),
        };
        let mut cost = Vec::new();
        for (k, (class, series)) in curves.iter_mut().enumerate() {
            let of_class: Vec<&Measured> =
                measured.iter().filter(|m| class == "all" || m.class == *class).collect();
            // A pool of different closed forms has no meaning.
            if of_class.is_empty() || (class == "all" && matches!(subject, Subject::Profiles(_))) {
                continue;
            }
            let pooled = pool(&of_class);
            let efficiency = pooled.rel_variance * pooled.nanoseconds * 1e-3;
            let verdict = if pooled.non_finite > 0 {
                "fails"
            } else if pooled.worst_z > Z_LIMIT {
                if method.is_unbiased() { "noisy" } else { "biased" }
            } else {
                "ok"
            };
            table.push(vec![
                method.name().into(),
                class.as_str().into(),
                (pooled.rays as u64).into(),
                pooled.rel_variance.into(),
                pooled.lookups.into(),
                pooled.steps.into(),
                pooled.nanoseconds.into(),
                (pooled.rel_variance * pooled.lookups).into(),
                efficiency.into(),
                slope(&pooled.curve).into(),
                pooled.worst_z.into(),
                verdict.into(),
                pooled.negative.into(),
                Cell::Count(pooled.non_finite),
                pooled.worst.into(),
            ]);
            series.push(Series { name: method.name(), points: pooled.curve, line: true });
            cost.push([k as f64, efficiency]);
        }
        costs.push(Series { name: method.name(), points: cost, line: false });
    }
    let mut plots: Vec<Plot> = curves
        .into_iter()
        .filter(|(_, series)| !series.is_empty())
        .map(|(class, series)| Plot {
            name: format!("error-{}", class.replace(|c: char| !c.is_ascii_alphanumeric(), "-")),
            title: format!("{name}, {class} rays: error against time"),
            x: Axis::log("seconds per ray"),
            y: Axis::log("root mean squared error, relative"),
            series,
        })
        .collect();
    let order: Vec<String> = classes.iter().enumerate().map(|(k, c)| format!("{k} {c}")).collect();
    plots.push(Plot {
        name: "cost".into(),
        title: format!("{name}: relative variance x time"),
        x: Axis::linear(&format!("class: {}", order.join(", "))),
        y: Axis::log("relative variance x microseconds"),
        series: costs,
    });
    let depths = match subject {
        Subject::Rays { rays, .. } => format!(
            "{} shadow rays from points where the medium is dense, by class: {}.",
            rays.len(),
            RayClass::ALL
                .map(|c| format!("{} {}", rays.iter().filter(|r| r.class == c).count(), c.name()))
                .join(", ")
        ),
        Subject::Profiles(cases) => {
            format!("{} closed forms, each under its one bound.", cases.len())
        }
    };
    Chart {
        name: format!("transmittance-{name}"),
        title: format!("Transmittance estimators on {name}"),
        notes: vec![
            depths,
            "Relative variance: mean variance of one estimate over the mean squared transmittance of the class. Error: root mean squared distance \
             of means of 1, 2, 4, ... estimates from the exact transmittance, in the same unit. No roulette. Times are of one thread and include setting up the ray."
                .into(),
            format!(
                "Verdict: the distance of a ray's mean from the exact one exceeds {Z_LIMIT} standard errors by chance once in a million charts. \
                 `biased` is a biased method caught; `noisy` an unbiased one whose estimates are too heavy-tailed for a normal mean."
            ),
        ],
        provenance: Provenance::here(settings.seed).with("samples per ray", settings.samples),
        table,
        plots,
        pictures: Vec::new(),
    }
}
