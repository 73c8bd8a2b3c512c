//! The commands of `vgstereo`. Each has its arguments, and a `run` that returns what to print.

use anyhow::Result;
use clap::{CommandFactory, Parser, Subcommand};
use clap_complete::Shell;

use crate::terminal::Said;

pub mod ablate;
mod board;
pub mod calibration;
pub mod capture;
pub mod demo;
pub mod eval;
pub mod exposure;
pub mod matching;
pub mod presets_table;
pub mod record;
pub mod replay;
pub mod stress;
pub mod sweep;
pub mod view;
pub mod wall;

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
    /// The demo, as without a command: match the built-in scene with every preset.
    Demo(demo::Demo),
    /// Match a rectified pair of images and write its disparity map.
    Match(Box<matching::Match>),
    /// Take pairs of pictures from a board, to calibrate its cameras by.
    Capture(capture::Capture),
    /// Make the rectification of two real cameras from their calibration files.
    Calibration(calibration::Calibration),
    /// Measure presets on scenes with ground truth: percentages of bad pixels.
    Eval(eval::Eval),
    /// Measure the error over the number of synapses and sigma: the paper's Figures 3 to 6.
    Sweep(sweep::Sweep),
    /// Measure a preset without each of its stages in turn.
    Ablate(ablate::Ablate),
    /// Measure presets with the right camera exposed differently, on the built-in scene too.
    Exposure(exposure::ExposureWedge),
    /// Measure presets on scenes that are disturbed: noise, blur, bands, JPEG, a turned camera.
    Stress(stress::Stress),
    /// Measure the figures of depth cameras on a flat wall: fill rate, accuracy, noise.
    Wall(wall::Wall),
    /// Show each preset's parameters, working memory and latency.
    Presets(presets_table::Presets),
    /// Show what a stereo camera sends, live, on a page in the browser.
    View(Box<view::View>),
    /// Record what a stereo camera sends: the bytes of its link, with the times at which they came.
    Record(record::Record),
    /// Play a recording to whatever reads a board, or take its bytes out.
    Replay(replay::Replay),
    /// Print completions for a shell, to be sourced or put where it looks for them.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Print the manual page, for `man -l -`.
    Man,
}

impl CommandLine {
    /// Runs the command and returns what to print.
    ///
    /// # Errors
    /// Fails with one line that says what is wrong with the input, or which file could not be
    /// written.
    pub fn run(self) -> Result<Said> {
        let text = match self.command.unwrap_or(Command::Demo(self.demo)) {
            Command::Demo(demo) => demo.run()?,
            Command::Match(matching) => return matching.run(),
            Command::Capture(capture) => capture.run()?,
            Command::Calibration(calibration) => calibration.run()?,
            Command::Eval(eval) => eval.run()?,
            Command::Sweep(sweep) => sweep.run()?,
            Command::Ablate(ablate) => ablate.run()?,
            Command::Exposure(wedge) => wedge.run()?,
            Command::Stress(stress) => stress.run()?,
            Command::Wall(wall) => wall.run()?,
            Command::Presets(presets) => presets.run()?,
            Command::View(view) => view.run()?,
            Command::Record(record) => record.run()?,
            Command::Replay(replay) => return replay.run(),
            Command::Completions { shell } => {
                let mut script = Vec::new();
                let mut command = Self::command();
                clap_complete::generate(shell, &mut command, "vgstereo", &mut script);
                String::from_utf8(script)?
            }
            Command::Man => {
                let mut command = Self::command();
                // Names the commands below as they are called.
                command.build();
                let mut pages = Vec::new();
                let below = command.get_subcommands().filter(|c| c.get_name() != "help");
                for command in std::iter::once(&command).chain(below) {
                    clap_mangen::Man::new(command.clone()).render(&mut pages)?;
                }
                String::from_utf8(pages)?
            }
        };
        Ok(text.into())
    }
}
