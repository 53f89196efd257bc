//! `pileus plan`.

use crate::cli::PlanOptions;
use crate::command::{Prepared, prepare};
use crate::failure::Failure;
use crate::report::Report;
use crate::settings::Overrides;

pub(crate) fn run(options: &PlanOptions, report: &Report) -> Result<(), Failure> {
    let Prepared { plan, .. } = prepare(&options.input, &Overrides::default())?;
    if options.json {
        report.json(&plan);
    } else {
        report.text(plan.to_string().trim_end());
    }
    Ok(())
}
