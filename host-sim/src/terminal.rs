//! A command at a terminal: what it gives is printed, what is wrong said on one line.

use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use anyhow::Result;
use clap::Parser;

/// Reads the arguments, runs the command and prints what it gives; code 2 with one line on
/// standard error where something is wrong.
pub fn run<C: Parser>(command: impl FnOnce(C) -> Result<String>) -> ExitCode {
    let command_line = match C::try_parse() {
        Ok(command_line) => command_line,
        // Help and version, asked for.
        Err(error) if !error.use_stderr() => error.exit(),
        Err(error) => {
            let text = error.to_string();
            // What is wrong comes first, then an empty line, hints and usage.
            let wrong = text.split("\n\n").next().unwrap_or(&text);
            return fail(wrong.trim_start_matches("error: "));
        }
    };
    match command(command_line) {
        Ok(text) => match std::io::stdout().write_all(text.as_bytes()) {
            // The reader has seen enough.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
            Err(error) => fail(&format!("cannot write to standard output: {error}")),
            Ok(()) => ExitCode::SUCCESS,
        },
        Err(error) => fail(&format!("{error:#}")),
    }
}

/// Says on one line what is wrong.
fn fail(message: &str) -> ExitCode {
    let line: Vec<&str> = message.split_whitespace().collect();
    // Without standard error there is nobody left to tell.
    let _ = writeln!(std::io::stderr(), "error: {}", line.join(" "));
    ExitCode::from(2)
}
