//! `pileus plan`.

use pileus_integrator::Plan;
use serde::Serialize;

use crate::cli::PlanOptions;
use crate::command::{Prepared, prepare};
use crate::failure::Failure;
use crate::film_plan::FilmPlan;
use crate::report::Report;
use crate::settings::Overrides;

/// The plan as JSON, with the film beside its keys.
#[derive(Serialize)]
struct PlanAndFilm<'a> {
    #[serde(flatten)]
    plan: &'a Plan,
    film: &'a FilmPlan,
}

pub(crate) fn run(options: &PlanOptions, report: &Report) -> Result<(), Failure> {
    let Prepared { plan, film, .. } = prepare(&options.input, &Overrides::default())?;
    if options.json {
        report.json(&PlanAndFilm { plan: &plan, film: &film });
    } else {
        report.text(format_args!("{plan}{film}"));
    }
    Ok(())
}
