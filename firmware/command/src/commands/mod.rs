//! The verbs of `cargo firmware`. Each has its arguments, and a `run` that returns what to
//! print.

use anyhow::Result;
use clap::{Args, Parser, Subcommand};

use vgstereo_sim::tables::table;

use crate::build::{build, lint};
use crate::model;
use crate::toolchain::{ensure_complete, install, needs};
use selection::{Alone, Selection};

pub mod bench;
pub mod image;
pub mod images;
pub mod live;
pub mod run;
pub mod selection;
pub mod size;
pub mod source;
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
    Build(Build),
    /// Check the boards' crates with clippy; a warning is an error.
    Lint(Lint),
    /// Run a board on a pair of images and write its disparity map.
    Run(Box<run::Run>),
    /// Run a board that serves the link to hosts, until it is ended.
    Live(Box<live::Live>),
    /// Compare boards with the host, byte for byte, with every preset that fits.
    Verify(Box<verify::Verify>),
    /// Count instructions per pixel and disparity, in all and per stage.
    Bench(Box<bench::Bench>),
    /// Show the bytes of flash and RAM that the firmware takes.
    Size(size::Size),
    /// Write what the memories of softcore are loaded with on an FPGA.
    Image(image::Image),
}

#[derive(Debug, Args)]
struct Build {
    #[command(flatten)]
    alone: Alone,
    #[command(flatten)]
    selection: Selection,
}

#[derive(Debug, Args)]
struct Lint {
    /// Check the models of the boards' chips as well, which takes minutes to build.
    #[arg(long)]
    models: bool,
    #[command(flatten)]
    alone: Alone,
    #[command(flatten)]
    selection: Selection,
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
    /// Runs the verb and returns the text to print.
    ///
    /// # Errors
    /// Fails with one line that says what is wrong or missing.
    pub fn run(self) -> Result<String> {
        match self.verb {
            Verb::Setup(setup) => setup.run(),
            Verb::Build(Build { alone, selection }) => {
                let boards = alone.of(selection.boards())?;
                ensure_complete(&boards)?;
                let mut text = String::new();
                for board in boards {
                    text += &format!("{}: {}\n", board.full_name(), build(&board)?.display());
                }
                Ok(text)
            }
            Verb::Lint(lint) => lint.run(),
            Verb::Run(run) => run.run(),
            Verb::Live(live) => live.run(),
            Verb::Verify(verify) => verify.run(),
            Verb::Bench(bench) => bench.run(),
            Verb::Size(size) => size.run(),
            Verb::Image(image) => image.run(),
        }
    }
}

impl Lint {
    fn run(self) -> Result<String> {
        let mut boards = self.alone.of(self.selection.boards())?;
        // Boards that differ only in compiler flags have one crate to lint.
        boards.dedup_by_key(|board| board.folder);
        let mut text = String::new();
        for board in boards {
            lint(&board)?;
            text += &format!("{}: no warnings\n", board.full_name());
            if self.models && board.model.is_some() {
                model::lint(&board)?;
                text += &format!("{}, the model: no warnings\n", board.name);
            }
        }
        Ok(text)
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
