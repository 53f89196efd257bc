//! `pileus plan`.

use pileus_integrator::Plan;

use crate::cli::PlanOptions;
use crate::command::{Planned, Prepared, prepare};
use crate::failure::Failure;
use crate::report::Report;
use crate::settings::Overrides;

pub(crate) fn run(options: &PlanOptions, report: &Report) -> Result<(), Failure> {
    let planned: Planned = if options.predict { Plan::new } else { Plan::without_paths };
    let Prepared { plan, .. } = prepare(planned, &options.input, &Overrides::default())?;
    if options.json {
        report.json(&plan);
    } else {
        report.text(plan.to_string().trim_end());
    }
    Ok(())
}
