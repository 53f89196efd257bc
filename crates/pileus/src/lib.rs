#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod cli;
mod command;
mod escape;
pub mod failure;
mod film_plan;
pub mod input;
pub mod job;
mod machine;
mod outputs;
mod record;
pub mod report;
pub mod schema;
pub mod settings;
pub mod validate;
mod words;

use std::process::ExitCode;

use clap::Parser;

use crate::cli::{Arguments, Command};
use crate::failure::{Exit, Failure};
use crate::report::Report;

/// Runs the program: reads the command line, does what it says, prints what went wrong.
pub fn run() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => return Report::command_line(&error),
    };
    let report = Report::new(arguments.common.quiet, arguments.common.verbose);
    match dispatch(&arguments, &report).and_then(|()| report.finish()) {
        Ok(()) => ExitCode::from(Exit::Success as u8),
        Err(failure) => {
            report.failure(&failure);
            ExitCode::from(failure.exit() as u8)
        }
    }
}

fn dispatch(arguments: &Arguments, report: &Report) -> Result<(), Failure> {
    let threads = arguments.common.threads.unwrap_or(0);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| {
        Failure::usage(format!("{threads} threads cannot be started: {error}"), "use fewer threads")
    })?;
    pool.install(|| match &arguments.command {
        Command::Render(options) => command::render::run(options, report),
        Command::Info(options) => command::info::run(options, report),
        Command::Check(options) => command::check::run(options, report),
        Command::Plan(options) => command::plan::run(options, report),
        Command::Schema(options) => command::schema::run(options, report),
        #[cfg(feature = "lab")]
        Command::Compare(options) => command::compare::run(options, report),
        Command::Probe(options) => command::probe::run(options, report),
        #[cfg(feature = "lab")]
        Command::Chart(options) => command::chart::run(options, report),
    })
}
