//! `pileus plan`.

use pileus_integrator::{Plan, Prepass, Renderer};
use serde::Serialize;

use crate::cli::PlanOptions;
use crate::command::{Prepared, prepare};
use crate::failure::Failure;
use crate::film_plan::FilmPlan;
use crate::report::Report;
use crate::settings::Overrides;
use crate::words;

/// The plan as JSON, with the film beside its keys, and with `--predict` what some paths ahead have
/// told.
#[derive(Serialize)]
struct PlanOfRender<'a> {
    #[serde(flatten)]
    plan: &'a Plan,
    film: &'a FilmPlan,
    #[serde(skip_serializing_if = "Option::is_none")]
    prepass: Option<&'a Prepass>,
}

pub(crate) fn run(options: &PlanOptions, report: &Report) -> Result<(), Failure> {
    let Prepared { settings, loaded, plan, film } = prepare(&options.input, &Overrides::default())?;
    let renderer = match options.predict {
        true => Some(
            Renderer::new(&loaded.scene, &settings.render)
                .map_err(|error| words::of_job(&settings, error))?,
        ),
        false => None,
    };
    let prepass = renderer.as_ref().map(Renderer::prepass);
    if options.json {
        report.json(&PlanOfRender { plan: &plan, film: &film, prepass });
    } else {
        let told = prepass.map(ToString::to_string).unwrap_or_default();
        report.text(format!("{plan}{told}{film}").trim_end());
    }
    for warning in prepass.iter().flat_map(|prepass| &prepass.warnings) {
        tracing::warn!("{warning}");
    }
    Ok(())
}
