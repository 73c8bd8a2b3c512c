//! How a command meets its terminal: results on standard output, errors as one line on
//! standard error, and progress while it works.

use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};

/// Parses the arguments, runs `command` with them and prints the text that it returns.
///
/// Returns code 0 on success. On a failure it prints one line on standard error and returns
/// code 2.
pub fn run<C: Parser>(command: impl FnOnce(C) -> Result<String>) -> ExitCode {
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
    match command(command_line) {
        Ok(text) => match std::io::stdout().write_all(text.as_bytes()) {
            // The reader of a pipe has closed it because it has seen enough.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
            Err(error) => fail(&format!("cannot write to standard output: {error}")),
            Ok(()) => ExitCode::SUCCESS,
        },
        Err(error) => fail(&format!("{error:#}")),
    }
}

/// Prints an error message as one line on standard error and returns code 2.
fn fail(message: &str) -> ExitCode {
    let line: Vec<&str> = message.split_whitespace().collect();
    // When standard error is closed as well, the message cannot be shown anywhere.
    let _ = writeln!(std::io::stderr(), "error: {}", line.join(" "));
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
