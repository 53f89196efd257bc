//! Everything the program prints: results, failures, progress.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "the one place that prints")]

use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use miette::{Diagnostic, LabeledSpan, MietteHandlerOpts, NamedSource, ReportHandler};
use serde::Serialize;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

use crate::escape;
use crate::failure::{Exit, Failure};

/// Where results and messages go.
#[derive(Debug)]
pub struct Report {
    quiet: bool,
    /// The first failure to print a result.
    unwritten: Mutex<Option<io::Error>>,
}

/// Standard error. Where it cannot be written (a closed pipe, a full disk) messages are lost, and
/// the pictures that they speak of are not.
struct Messages;

impl Write for Messages {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let _ = io::stderr().write_all(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let _ = io::stderr().flush();
        Ok(())
    }
}

/// A line of the log: level and message, without control characters of names in it.
struct LogLine;

impl<S, N> FormatEvent<S, N> for LogLine
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let mut text = String::new();
        context.format_fields(Writer::new(&mut text), event)?;
        let level = *event.metadata().level();
        // Reports for those who asked for more have several lines.
        let text = if level <= Level::INFO { escape::line(&text) } else { escape::lines(&text) };
        if !writer.has_ansi_escapes() {
            return writeln!(writer, "{level:>5} {text}");
        }
        let color = match level {
            Level::ERROR => 31,
            Level::WARN => 33,
            Level::INFO => 32,
            Level::DEBUG => 34,
            _ => 35,
        };
        writeln!(writer, "\u{1b}[{color}m{level:>5}\u{1b}[0m {text}")
    }
}

/// Whether a pipe was closed by who read from it.
fn had_enough(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::BrokenPipe
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
            .log_internal_errors(false)
            .with_ansi(std::io::stderr().is_terminal())
            .event_format(LogLine)
            .with_writer(|| Messages)
            .try_init();
        Self { quiet, unwritten: Mutex::new(None) }
    }

    /// Prints help or a fault of the command line; the exit code that belongs to it.
    pub fn command_line(error: &clap::Error) -> ExitCode {
        let printed = error.print().and_then(|()| io::stdout().flush());
        let exit = match (error.use_stderr(), printed) {
            (true, _) => Exit::Usage,
            (false, Ok(())) => Exit::Success,
            (false, Err(error)) if had_enough(&error) => Exit::Success,
            (false, Err(_)) => Exit::Io,
        };
        ExitCode::from(exit as u8)
    }

    /// Prints a result as text. Where that fails, [`Self::finish`] tells.
    pub fn text(&self, text: impl fmt::Display) {
        self.print(&escape::lines(&text.to_string()));
    }

    /// Prints a result as JSON. Where that fails, [`Self::finish`] tells.
    pub fn json(&self, value: &impl Serialize) {
        let text = serde_json::to_string_pretty(value).unwrap_or_else(|error| error.to_string());
        self.print(&escape::json(&text));
    }

    fn print(&self, text: &str) {
        let mut out = io::stdout().lock();
        if let Err(error) = writeln!(out, "{text}").and_then(|()| out.flush()) {
            let mut unwritten = self.unwritten.lock().unwrap_or_else(PoisonError::into_inner);
            unwritten.get_or_insert(error);
        }
    }

    /// Whether all results could be printed.
    ///
    /// # Errors
    /// [`Failure::Output`] with what the system said first; none where who reads had enough
    /// (`pileus info x | head`).
    pub fn finish(&self) -> Result<(), Failure> {
        let mut unwritten = self.unwritten.lock().unwrap_or_else(PoisonError::into_inner);
        match unwritten.take() {
            Some(error) if !had_enough(&error) => Err(Failure::Output(error)),
            _ => Ok(()),
        }
    }

    /// Prints why a command ended early, its chain of causes and what to do.
    pub fn failure(&self, failure: &Failure) {
        let mut out = Messages;
        if let Failure::Interrupted { what, .. } = failure {
            if !self.quiet {
                let _ = writeln!(out, "{}", escape::line(what));
            }
            return;
        }
        if std::io::stderr().is_terminal() {
            let shown = Shown::new(failure);
            let handler = MietteHandlerOpts::new().terminal_links(false).build();
            let _ = writeln!(out, "Error: {}", Fancy { handler: &handler, shown: &shown });
            return;
        }
        let _ = writeln!(out, "error: {}", escape::line(&failure.to_string()));
        let mut source = std::error::Error::source(failure);
        while let Some(cause) = source {
            let _ = writeln!(out, "  because: {}", escape::line(&cause.to_string()));
            source = cause.source();
        }
        if !failure.remedy().is_empty() {
            let _ = writeln!(out, "  help: {}", escape::line(failure.remedy()));
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

/// A failure as miette shows it: with the lines of the file it speaks of, and without control
/// characters.
#[derive(Debug)]
struct Shown {
    message: Message,
    remedy: String,
    source: Option<NamedSource<String>>,
    offset: usize,
    length: usize,
}

/// A message and its chain of causes.
#[derive(Debug)]
struct Message {
    text: String,
    cause: Option<Box<Message>>,
}

impl Message {
    fn new(error: &dyn std::error::Error) -> Self {
        let text = escape::line(&error.to_string()).into_owned();
        Self { text, cause: error.source().map(|source| Box::new(Self::new(source))) }
    }
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::error::Error for Message {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.cause.as_ref().map(|cause| cause.as_ref() as _)
    }
}

/// Largest file of which lines are shown.
const MAX_SHOWN: u64 = 1 << 20;

impl Shown {
    fn new(failure: &Failure) -> Self {
        let message = Message::new(failure);
        let remedy = escape::line(failure.remedy()).into_owned();
        let mut shown = Self { message, remedy, source: None, offset: 0, length: 1 };
        let Failure::Scene(error) = failure else { return shown };
        let place = error.place();
        let (Some(file), Some(line), Some(column)) = (&place.file, place.line, place.column) else {
            return shown;
        };
        // What was read from a pipe is gone, and to read on would wait.
        if !std::fs::metadata(file).is_ok_and(|metadata| metadata.is_file()) {
            return shown;
        }
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
        let name = file.display().to_string();
        let text = escape::same_length(&text);
        shown.source = Some(NamedSource::new(escape::line(&name), text));
        shown
    }
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.message.fmt(f)
    }
}

impl std::error::Error for Shown {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        std::error::Error::source(&self.message)
    }
}

impl Diagnostic for Shown {
    fn help<'b>(&'b self) -> Option<Box<dyn fmt::Display + 'b>> {
        (!self.remedy.is_empty()).then(|| Box::new(&self.remedy) as Box<dyn fmt::Display>)
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
    shown: &'a Shown,
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
