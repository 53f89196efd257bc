//! Everything the program prints: results, failures, progress.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "the one place that prints")]

use std::fmt;
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use miette::{Diagnostic, LabeledSpan, MietteHandlerOpts, NamedSource, ReportHandler};
use serde::Serialize;
use tracing_subscriber::EnvFilter;

use crate::failure::{Exit, Failure};

/// Where results and messages go.
#[derive(Debug)]
pub struct Report {
    quiet: bool,
}

impl Report {
    /// Sets up logging to standard error; `RUST_LOG` overrides `quiet` and `verbose`.
    pub fn new(quiet: bool, verbose: u8) -> Self {
        let level = match (quiet, verbose) {
            (true, _) => "error",
            (false, 0) => "info",
            (false, 1) => "debug",
            (false, _) => "trace",
        };
        let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| {
            EnvFilter::new(format!(
                "warn,pileus={level},pileus_scene={level},pileus_integrator={level}"
            ))
        });
        let filter = if quiet { EnvFilter::new("error") } else { filter };
        // A second program in one process (tests) keeps the first one's logging.
        let _ = tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(std::io::stderr)
            .with_ansi(std::io::stderr().is_terminal())
            .without_time()
            .with_target(false)
            .try_init();
        Self { quiet }
    }

    /// Prints help or a fault of the command line; the exit code that belongs to it.
    pub fn command_line(error: &clap::Error) -> ExitCode {
        // Nobody is left to tell if this fails.
        let _ = error.print();
        let exit = if error.use_stderr() { Exit::Usage } else { Exit::Success };
        ExitCode::from(exit as u8)
    }

    /// Prints a result as text.
    pub fn text(&self, text: impl fmt::Display) {
        // A closed pipe (`pileus info x | head`) is no reason to panic, as `println!` would.
        let _ = writeln!(std::io::stdout(), "{text}");
    }

    /// Prints a result as JSON.
    pub fn json(&self, value: &impl Serialize) {
        let text = serde_json::to_string_pretty(value).unwrap_or_else(|error| error.to_string());
        self.text(text);
    }

    /// Prints why a command ended early, its chain of causes and what to do.
    pub fn failure(&self, failure: &Failure) {
        if let Failure::Interrupted(what) = failure {
            if !self.quiet {
                eprintln!("{what}");
            }
            return;
        }
        if std::io::stderr().is_terminal() {
            let shown = Shown::new(failure);
            let handler = MietteHandlerOpts::new().terminal_links(false).build();
            eprintln!("Error: {}", Fancy { handler: &handler, shown: &shown });
            return;
        }
        eprintln!("error: {failure}");
        let mut source = std::error::Error::source(failure);
        while let Some(cause) = source {
            eprintln!("  because: {cause}");
            source = cause.source();
        }
        if !failure.remedy().is_empty() {
            eprintln!("  help: {}", failure.remedy());
        }
    }

    /// Starts a progress bar; silent when standard error is no terminal or `quiet`.
    pub(crate) fn progress(&self, total: u64) -> Progress {
        let target =
            if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(total), target);
        let style = ProgressStyle::with_template(
            "{bar:30} {percent:>3}%  {elapsed} elapsed, {left} left, {rate}",
        );
        if let Ok(style) = style {
            bar.set_style(
                style
                    .with_key("left", |state: &ProgressState, out: &mut dyn fmt::Write| {
                        let _ = write!(out, "{:#}", HumanDuration(state.eta()));
                    })
                    .with_key("rate", |state: &ProgressState, out: &mut dyn fmt::Write| {
                        let _ = write!(out, "{:.2} M paths/s", state.per_sec() * 1e-6);
                    }),
            );
        }
        Progress { bar, first_pass: AtomicBool::new(false) }
    }
}

/// A running render on the screen.
pub(crate) struct Progress {
    bar: ProgressBar,
    first_pass: AtomicBool,
}

impl Progress {
    /// Says how many samples are done; `pixels` is the number of samples in the first pass.
    pub(crate) fn set(&self, done: u64, pixels: u64) {
        self.bar.set_position(done);
        if done > pixels && !self.first_pass.swap(true, Ordering::Relaxed) {
            tracing::debug!("the first sample of every pixel is done");
        }
    }

    /// Takes the bar off the screen.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// A failure as miette shows it: with the lines of the file it speaks of.
#[derive(Debug)]
struct Shown<'a> {
    failure: &'a Failure,
    source: Option<NamedSource<String>>,
    offset: usize,
    length: usize,
}

/// Largest file of which lines are shown.
const MAX_SHOWN: u64 = 1 << 20;

impl<'a> Shown<'a> {
    fn new(failure: &'a Failure) -> Self {
        let mut shown = Self { failure, source: None, offset: 0, length: 1 };
        let Failure::Scene(error) = failure else { return shown };
        let place = error.place();
        let (Some(file), Some(line), Some(column)) = (&place.file, place.line, place.column) else {
            return shown;
        };
        let Ok(text) = crate::input::read_text(file, MAX_SHOWN) else { return shown };
        let start: usize =
            text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum();
        let Some(rest) = text.get(start..) else { return shown };
        let in_line: usize = rest.chars().take(column.saturating_sub(1)).map(char::len_utf8).sum();
        shown.offset = start + in_line;
        shown.length = rest
            .get(in_line..)
            .and_then(|rest| rest.find([',', ':', '\n', '}', ']']))
            .unwrap_or(1)
            .max(1);
        shown.source = Some(NamedSource::new(file.display().to_string(), text));
        shown
    }
}

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.failure.fmt(f)
    }
}

impl std::error::Error for Shown<'_> {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        std::error::Error::source(self.failure)
    }
}

impl Diagnostic for Shown<'_> {
    fn help<'b>(&'b self) -> Option<Box<dyn fmt::Display + 'b>> {
        let remedy = self.failure.remedy();
        (!remedy.is_empty()).then(|| Box::new(remedy) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        self.source.as_ref().map(|source| source as &dyn miette::SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        self.source.as_ref()?;
        let label = LabeledSpan::new(Some("here".into()), self.offset, self.length);
        Some(Box::new(std::iter::once(label)))
    }
}

struct Fancy<'a> {
    handler: &'a miette::MietteHandler,
    shown: &'a Shown<'a>,
}

impl fmt::Display for Fancy<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.handler.debug(self.shown, f)
    }
}
