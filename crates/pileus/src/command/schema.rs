//! `pileus schema`.

use crate::cli::SchemaOptions;
use crate::failure::Failure;
use crate::report::Report;
use crate::schema;

pub(crate) fn run(options: &SchemaOptions, report: &Report) -> Result<(), Failure> {
    if options.properties {
        report.text(schema::properties_table().trim_end());
    } else if options.markdown {
        report.text(schema::reference_page().trim_end());
    } else {
        report.json(&schema::job_schema());
    }
    Ok(())
}
