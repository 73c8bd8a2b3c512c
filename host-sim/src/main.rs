//! The `vgstereo` command.

use std::process::ExitCode;

use vgstereo_sim::commands::CommandLine;
use vgstereo_sim::terminal;

fn main() -> ExitCode {
    terminal::run(CommandLine::run)
}
