//! The command behind `cargo firmware`.

use std::process::ExitCode;

use vgstereo_boards::commands::CommandLine;
use vgstereo_sim::terminal;

fn main() -> ExitCode {
    terminal::run(CommandLine::run)
}
