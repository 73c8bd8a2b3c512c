//! The verbs of `cargo firmware`, each with its arguments and what it prints.

use anyhow::Result;
use clap::{Args, Parser, Subcommand};

use crate::board::{Board, UnknownBoard};
use crate::build::{build, lint};
use crate::toolchain::{ensure_complete, install, needs};
use vgstereo_sim::tables::table;

pub mod bench;
pub mod run;
pub mod size;
pub mod verify;

/// Firmware: built, and on emulated boards fed with images as by a camera and held to the
/// host's results byte for byte.
#[derive(Debug, Parser)]
#[command(name = "cargo firmware", bin_name = "cargo firmware", version)]
pub struct CommandLine {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Show what the boards need and what of it is missing.
    Setup(Setup),
    /// Build the firmware as it is released.
    Build(Selection),
    /// Check the boards' crates with clippy; a warning is an error.
    Lint(Selection),
    /// Run a board on a pair of images and write its disparity map.
    Run(run::Run),
    /// Compare boards with the host, byte for byte, with every preset that fits.
    Verify(verify::Verify),
    /// Count instructions per pixel and disparity, in all and per stage.
    Bench(bench::Bench),
    /// Show the bytes of flash and RAM that the firmware takes.
    Size(size::Size),
}

/// One board or all.
#[derive(Debug, Clone, Args)]
pub struct Selection {
    /// Only this board: stm32f405, mps2-an500, riscv-virt, riscv-virt-zbb or stm32h743.
    #[arg(long, value_name = "B", value_parser = parse_board)]
    board: Option<Board>,
}

impl Selection {
    /// The boards meant.
    #[must_use]
    pub fn boards(&self) -> Vec<Board> {
        self.board.map_or(Board::ALL.to_vec(), |board| vec![board])
    }
}

/// One emulated board or all of them.
#[derive(Debug, Clone, Args)]
pub struct EmulatedSelection {
    /// Only this board: stm32f405, mps2-an500, riscv-virt or riscv-virt-zbb.
    #[arg(long, value_name = "B", value_parser = parse_emulated_board)]
    board: Option<Board>,
}

impl EmulatedSelection {
    /// The boards meant.
    #[must_use]
    pub fn boards(&self) -> Vec<Board> {
        self.board
            .map_or(Board::emulated().collect(), |board| vec![board])
    }
}

#[derive(Debug, Args)]
struct Setup {
    /// Install what is missing, on Debian, with apt-get.
    #[arg(long)]
    install: bool,
    #[command(flatten)]
    selection: Selection,
}

impl CommandLine {
    /// Runs the verb; gives what to print.
    ///
    /// # Errors
    /// One line that says what is wrong or missing.
    pub fn run(self) -> Result<String> {
        match self.verb {
            Verb::Setup(setup) => setup.run(),
            Verb::Build(selection) => {
                let boards = selection.boards();
                ensure_complete(&boards)?;
                let mut text = String::new();
                for board in boards {
                    text += &format!("{}: {}\n", board.name, build(&board)?.display());
                }
                Ok(text)
            }
            Verb::Lint(selection) => {
                let mut boards = selection.boards();
                // Flags of the compiler do not change what there is to lint.
                boards.dedup_by_key(|board| board.folder);
                let mut text = String::new();
                for board in boards {
                    lint(&board)?;
                    text += &format!("{}: no warnings\n", board.name);
                }
                Ok(text)
            }
            Verb::Run(run) => run.run(),
            Verb::Verify(verify) => verify.run(),
            Verb::Bench(bench) => bench.run(),
            Verb::Size(size) => size.run(),
        }
    }
}

impl Setup {
    fn run(self) -> Result<String> {
        let boards = self.selection.boards();
        if self.install {
            install(&boards)?;
        }
        let mut table = table(&["needed", "found"], 2);
        for need in needs(&boards)? {
            let found = need
                .found
                .unwrap_or_else(|| format!("missing: {}", need.remedy));
            table.add_row([need.what, found]);
        }
        ensure_complete(&boards)?;
        Ok(format!("{table}\n"))
    }
}

fn parse_board(name: &str) -> Result<Board, String> {
    name.parse()
        .map_err(|error: UnknownBoard| error.to_string())
}

fn parse_emulated_board(name: &str) -> Result<Board, String> {
    let board = parse_board(name)?;
    board.emulation().map_err(|error| error.to_string())?;
    Ok(board)
}
