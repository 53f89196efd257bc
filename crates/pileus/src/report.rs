//! Everything the program prints: results, failures, progress.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "the one place that prints")]

use std::fmt;
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

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
        if let Failure::Interrupted { what, .. } = failure {
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

    /// Starts to show how far a render of `total` pixel samples, `pixels` of them a sample of each
    /// pixel, has come: a bar, or lines in the log where standard error is no terminal; silent if
    /// `quiet`.
    pub(crate) fn progress(&self, total: u64, pixels: u64) -> Progress {
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
        let lines = !self.quiet && !std::io::stderr().is_terminal();
        Progress {
            bar,
            pixels,
            first_pass: AtomicBool::new(false),
            log: lines.then(|| ProgressLog::start(total, pixels)),
        }
    }
}

/// Seconds from the start of a render to the first line about its progress.
const FIRST_LINE: f64 = 2.0;

/// When the line after one at `elapsed` seconds is due: every 10 s at first, ever more rarely in
/// long renders, every 10 minutes at last.
fn next_line(elapsed: f64) -> f64 {
    elapsed + (elapsed * 0.25).clamp(10.0, 600.0)
}

/// Seconds for people.
fn duration(seconds: f64) -> String {
    // Casts saturate: what is longer than all time is shown as a long time.
    let s = seconds.round().max(0.0) as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {:02} s", s / 60, s % 60),
        _ => format!("{} h {:02} min", s / 3600, s / 60 % 60),
    }
}

/// How far a render has come after `elapsed` seconds, with an estimate of the rest as long as
/// samples take.
fn progress_line(done: u64, total: u64, pixels: u64, elapsed: f64) -> String {
    let (done, all) = (done as f64, total as f64);
    let per_pixel = |n: f64| n / pixels.max(1) as f64;
    let rest = match done {
        0.0 => "rest unknown".to_owned(),
        _ => format!("about {} left", duration(elapsed * (all - done) / done)),
    };
    format!(
        "rendering: {:.1} %, {:.1} of {} samples per pixel, {} elapsed, {rest}",
        100.0 * done / all.max(1.0),
        per_pixel(done),
        per_pixel(all),
        duration(elapsed)
    )
}

/// Lines about a running render, from a thread of their own, so that they come also while no tile
/// gets done.
struct ProgressLog {
    done: Arc<AtomicU64>,
    /// Dropped to end the thread.
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl ProgressLog {
    fn start(total: u64, pixels: u64) -> ProgressLog {
        let done = Arc::new(AtomicU64::new(0));
        let (stop, stopped) = channel::<()>();
        let (begun, read) = (Instant::now(), Arc::clone(&done));
        let lines = move || {
            let mut due = FIRST_LINE;
            loop {
                let wait = Duration::from_secs_f64((due - begun.elapsed().as_secs_f64()).max(0.0));
                if stopped.recv_timeout(wait) != Err(RecvTimeoutError::Timeout) {
                    return;
                }
                let elapsed = begun.elapsed().as_secs_f64();
                let line = progress_line(read.load(Ordering::Relaxed), total, pixels, elapsed);
                tracing::info!("{line}");
                due = next_line(elapsed);
            }
        };
        // Without a thread there are no lines: no reason not to render.
        let thread = std::thread::Builder::new().name("progress".into()).spawn(lines).ok();
        ProgressLog { done, stop: Some(stop), thread }
    }
}

impl Drop for ProgressLog {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so.
            let _ = thread.join();
        }
    }
}

/// A running render on the screen.
pub(crate) struct Progress {
    bar: ProgressBar,
    pixels: u64,
    first_pass: AtomicBool,
    log: Option<ProgressLog>,
}

impl Progress {
    /// Says how many pixel samples are done.
    pub(crate) fn set(&self, done: u64) {
        self.bar.set_position(done);
        if let Some(log) = &self.log {
            log.done.fetch_max(done, Ordering::Relaxed);
        }
        if done > self.pixels && !self.first_pass.swap(true, Ordering::Relaxed) {
            tracing::debug!("the first sample of every pixel is done");
        }
    }

    /// Takes the bar off the screen, and ends the lines.
    pub(crate) fn finish(self) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_lines_are_few_and_tell_what_is_left() {
        assert_eq!(
            progress_line(3200, 12800, 100, 30.0),
            "rendering: 25.0 %, 32.0 of 128 samples per pixel, 30 s elapsed, about 1 min 30 s left"
        );
        assert!(progress_line(0, 12800, 100, 7300.0).ends_with("2 h 01 min elapsed, rest unknown"));
        let lines = |length: f64| {
            let mut times = vec![FIRST_LINE];
            while let Some(last) = times.last().filter(|last| **last < length) {
                times.push(next_line(*last));
            }
            times.len()
        };
        assert_eq!((lines(1.0), lines(40.0)), (1, 5));
        assert!(lines(3600.0) < 30 && lines(86_400.0) < 180);
    }
}
