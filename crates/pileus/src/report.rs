//! Everything the program prints: results, failures, progress.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "the one place that prints")]

use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

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
    /// [`Failure::Output`] with what the system said first.
    pub fn finish(&self) -> Result<(), Failure> {
        let mut unwritten = self.unwritten.lock().unwrap_or_else(PoisonError::into_inner);
        unwritten.take().map_or(Ok(()), |error| Err(Failure::Output(error)))
    }

    /// Prints why a command ended early, its chain of causes and what to do.
    pub fn failure(&self, failure: &Failure) {
        let mut out = Messages;
        match failure {
            Failure::Interrupted(what) => {
                if !self.quiet {
                    let _ = writeln!(out, "{}", escape::line(what));
                }
                return;
            }
            // Who reads had enough (`pileus info x | head`) and need not be told.
            Failure::Output(error) if error.kind() == io::ErrorKind::BrokenPipe => return,
            _ => {}
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
