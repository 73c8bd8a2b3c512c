//! The commands of `vgstereo`. Each has its arguments, and a `run` that returns what to print.

use anyhow::Result;
use clap::{Parser, Subcommand};

pub mod ablate;
pub mod demo;
pub mod eval;
pub mod exposure;
pub mod matching;
pub mod presets_table;
pub mod sweep;

/// Dense stereo matching with VG-RAM weightless neural networks, on the very core that
/// firmware links.
///
/// Without a command: the demo. A built-in stereo scene is fed line by line through the
/// camera trait and the firmware's session; the table and the pictures show what came out.
#[derive(Debug, Parser)]
#[command(name = "vgstereo", version, args_conflicts_with_subcommands = true)]
pub struct CommandLine {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    demo: demo::Demo,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Match a rectified pair of images and write its disparity map.
    Match(matching::Match),
    /// Measure presets on scenes with ground truth: percentages of bad pixels.
    Eval(eval::Eval),
    /// Measure the error over the number of synapses and sigma: the paper's Figures 3 to 6.
    Sweep(sweep::Sweep),
    /// Measure a preset without each of its stages in turn.
    Ablate(ablate::Ablate),
    /// Measure presets with the right camera exposed differently, on the built-in scene too.
    Exposure(exposure::ExposureWedge),
    /// Show each preset's parameters, working memory and latency.
    Presets(presets_table::Presets),
}

impl CommandLine {
    /// Runs the command and returns the text to print.
    ///
    /// # Errors
    /// Fails with one line that says what is wrong with the input, or which file could not be
    /// written.
    pub fn run(self) -> Result<String> {
        match self.command {
            None => self.demo.run(),
            Some(Command::Match(matching)) => matching.run(),
            Some(Command::Eval(eval)) => eval.run(),
            Some(Command::Sweep(sweep)) => sweep.run(),
            Some(Command::Ablate(ablate)) => ablate.run(),
            Some(Command::Exposure(wedge)) => wedge.run(),
            Some(Command::Presets(presets)) => presets.run(),
        }
    }
}
