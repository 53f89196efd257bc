//! What is remembered about a render: the image's metadata and the stats file.

use pileus_film::MetaValue;
use pileus_integrator::{Counters, PathCost, Plan};
use serde::Serialize;

use crate::film_plan::FilmPlan;
use crate::job::Job;
use crate::machine;
use crate::settings::Settings;

/// Seconds by phase.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(crate) struct Seconds {
    /// Reading files.
    pub(crate) load: f64,
    /// Building render grids and the plan.
    pub(crate) build: f64,
    /// Sampling alone.
    pub(crate) render: f64,
    /// Writing the image and its preview.
    pub(crate) write: f64,
    /// From the start of the command to the end of writing.
    pub(crate) total: f64,
}

/// The stats file.
#[derive(Debug, Serialize)]
pub(crate) struct Stats<'a> {
    pub(crate) seconds: Seconds,
    /// Samples per pixel in the image.
    pub(crate) samples: u64,
    #[serde(flatten)]
    pub(crate) counters: &'a Counters,
    pub(crate) peak_memory_bytes: Option<u64>,
    pub(crate) plan: PlanAndCost<'a>,
    pub(crate) film: &'a FilmPlan,
    pub(crate) version: &'static str,
    pub(crate) job_hash: &'a str,
    pub(crate) interrupted: bool,
    pub(crate) threads: usize,
    pub(crate) resolution: [u32; 2],
    /// Left, top, width and height of what was rendered.
    pub(crate) crop: [u32; 4],
    pub(crate) image: &'a str,
}

/// The plan, and beside what it predicted what was measured.
#[derive(Debug, Serialize)]
pub(crate) struct PlanAndCost<'a> {
    #[serde(flatten)]
    pub(crate) plan: &'a Plan,
    pub(crate) predicted: Option<PathCost>,
    pub(crate) measured: Option<PathCost>,
}

impl Stats<'_> {
    pub(crate) fn peak_memory() -> Option<u64> {
        machine::peak_memory_bytes()
    }
}

/// The version of the program.
pub(crate) const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Attributes of the image: everything that determines it and what was counted on the way. Nothing
/// here depends on time or machine, so that equal renders give equal files.
pub(crate) fn metadata(
    settings: &Settings,
    (job, job_hash): (&Job, &str),
    plan: &Plan,
    counters: &Counters,
    samples: u64,
) -> Vec<(String, MetaValue)> {
    let json =
        |value: Result<String, serde_json::Error>| MetaValue::Text(value.unwrap_or_default());
    let text = |value: String| MetaValue::Text(value);
    let render = &settings.render;
    let limit = |n: Option<u64>| n.map_or("unlimited".to_owned(), |n| n.to_string());
    [
        ("software", text(format!("Pileus {VERSION}"))),
        ("pileus:version", text(VERSION.into())),
        ("pileus:job", json(serde_json::to_string(job))),
        ("pileus:job_hash", text(job_hash.into())),
        ("pileus:plan", json(serde_json::to_string(plan))),
        ("pileus:counters", json(serde_json::to_string(counters))),
        ("pileus:samples", text(samples.to_string())),
        ("pileus:variance", text(variance_note(samples).into())),
        ("pileus:seed", text(render.seed.to_string())),
        ("pileus:max_bounces", text(limit(render.max_bounces.map(u64::from)))),
        ("pileus:max_events", text(limit(render.max_events))),
        ("pileus:biased", text(plan.biased.join("\n"))),
        ("pileus:warnings", text(plan.warnings.join("\n"))),
        ("pileus:filter", text(format!("{:?}", render.filter))),
        ("pileus:transmittance", text(plan.transmittance.name().into())),
        ("pileus:distance", text(plan.distance.name().into())),
        ("pileus:not_modelled", text(plan.not_modelled.join("\n"))),
    ]
    .into_iter()
    .map(|(name, value)| (name.to_owned(), value))
    .collect()
}

/// What the variance is worth after so many samples.
fn variance_note(samples: u64) -> &'static str {
    match samples {
        0 | 1 => "unknown (infinite): one sample per pixel",
        2..16 => "of the mean; an upper bound, fewer than 16 samples per pixel",
        _ => "of the mean, from 8 replicates (7 degrees of freedom a pixel)",
    }
}
