//! How a command meets its terminal: results on standard output, errors as one line on
//! standard error, and progress while it works.

use std::io::{ErrorKind, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
#[cfg(unix)]
use signal_hook::consts::{SIGINT, SIGTERM};
#[cfg(unix)]
use signal_hook::iterator::Signals;

use crate::escapes::printable;
#[cfg(unix)]
use crate::files::without_temporary_files;

/// What a command has to say when it is done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Said {
    /// Text for standard output.
    Output(String),
    /// Text for standard error, as standard output has got a file.
    Aside(String),
}

impl From<String> for Said {
    fn from(text: String) -> Self {
        Self::Output(text)
    }
}

/// Parses the arguments, runs `command` with them and prints the text that it returns.
///
/// Returns code 0 on success. On a failure it prints one line on standard error and returns
/// code 2. Characters that cannot be seen, which file names may have, are printed
/// as escapes.
pub fn run<C: Parser, S: Into<Said>>(command: impl FnOnce(C) -> Result<S>) -> ExitCode {
    leave_nothing_behind();
    let command_line = match C::try_parse() {
        Ok(command_line) => command_line,
        // The user asked for the help or the version.
        Err(error) if !error.use_stderr() => error.exit(),
        Err(error) => {
            let text = error.to_string();
            // The error comes first, then an empty line, hints and usage.
            let wrong = text.split("\n\n").next().unwrap_or(&text);
            return fail(wrong.trim_start_matches("error: "));
        }
    };
    let written = match command(command_line).map(Into::into) {
        Ok(Said::Output(text)) => write_output(printable(&text).as_bytes()),
        Ok(Said::Aside(text)) => {
            let written = std::io::stderr().write_all(printable(&text).as_bytes());
            written.context("cannot write to standard error")
        }
        Err(error) => Err(error),
    };
    match written {
        // The reader of a pipe has closed it because it has seen enough.
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => fail(&format!("{error:#}")),
        Ok(()) => ExitCode::SUCCESS,
    }
}

/// Writes bytes to standard output.
///
/// # Errors
/// Fails with one line that gives the reason.
pub fn write_output(bytes: &[u8]) -> Result<()> {
    let written = std::io::stdout().write_all(bytes);
    written.context("cannot write to standard output")
}

fn is_closed_pipe(error: &anyhow::Error) -> bool {
    let cause = error.root_cause().downcast_ref::<std::io::Error>();
    cause.is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
}

/// Whether the command that runs looks for [`Interrupts`], and whether one has come.
static IS_HEEDED: AtomicBool = AtomicBool::new(false);
static HAS_COME: AtomicBool = AtomicBool::new(false);

/// While this lives, the first interrupt or request to end does not end the process: the command looks
/// for it, and ends well. Where signals cannot be caught, they end the process as ever.
#[derive(Debug)]
pub struct Interrupts(());

impl Interrupts {
    /// Heeds them from now on.
    #[must_use]
    pub fn heeded() -> Self {
        HAS_COME.store(false, Ordering::Relaxed);
        IS_HEEDED.store(true, Ordering::Relaxed);
        Self(())
    }

    /// Whether one has come.
    #[must_use]
    pub fn have_come(&self) -> bool {
        HAS_COME.load(Ordering::Relaxed)
    }
}

impl Drop for Interrupts {
    fn drop(&mut self) {
        IS_HEEDED.store(false, Ordering::Relaxed);
    }
}

/// Lets an interrupt or a request to end wait until no temporary file is left. Where signals
/// cannot be caught, they end the process as ever.
fn leave_nothing_behind() {
    #[cfg(unix)]
    if let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) {
        std::thread::spawn(move || {
            for signal in signals.forever() {
                // The second one ends a command that does not heed the first.
                if IS_HEEDED.load(Ordering::Relaxed) && !HAS_COME.swap(true, Ordering::Relaxed) {
                    continue;
                }
                // Kept until the process has ended, which shells see as by the signal.
                let _guard = without_temporary_files();
                let _ = signal_hook::low_level::emulate_default_handler(signal);
            }
        });
    }
}

/// Prints a line on standard error, beside the results.
pub fn note(line: &str) {
    // When standard error is closed, the line cannot be shown anywhere.
    let _ = writeln!(std::io::stderr(), "{}", printable(line));
}

/// Prints an error message as one line on standard error and returns code 2.
fn fail(message: &str) -> ExitCode {
    let lines: Vec<&str> = message.lines().map(str::trim).collect();
    let line = printable(&lines.join(" ")).into_owned();
    // When standard error is closed as well, the message cannot be shown anywhere.
    let _ = writeln!(std::io::stderr(), "error: {line}");
    ExitCode::from(2)
}

/// Returns a progress bar of `steps` steps, labelled `what`. It is drawn on standard error,
/// and only when that is a terminal.
#[must_use]
pub fn progress_bar(steps: u64, what: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} [{bar:32}] {pos}/{len} {eta}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(steps)
        .with_style(style)
        .with_message(what.to_owned())
}

/// Returns a line that shows what goes on, by its message. It is drawn on standard error, and only when
/// that is a terminal.
#[must_use]
pub fn spinner() -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {wide_msg}");
    ProgressBar::new_spinner()
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
}
