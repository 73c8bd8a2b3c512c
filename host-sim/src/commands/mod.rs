//! The commands of `vgstereo`, each with its arguments and what it prints.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, Result};
use clap::{Args, Parser, Subcommand};
use comfy_table::{CellAlignment, Table, presets};
use image::RgbImage;
use indicatif::{ProgressBar, ProgressStyle};
use vgstereo_core::config::{Output, Parameters};
use vgstereo_core::preset::Preset;

use crate::parameters::{with_file, with_setting};
use crate::views::Views;

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
    /// Runs the command; gives what to print.
    ///
    /// # Errors
    /// One line that says what is wrong with the input, or which file could not be written.
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

/// Parameters that replace those of a preset, later ones over earlier ones.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Parameters, instead of the preset's")]
pub struct Overrides {
    /// TOML file of parameters; those it leaves out stay the preset's. `vgstereo presets
    /// --toml NAME` prints one to start from.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Any parameter by its name in that file, such as `method.p1=12`; `none` leaves a stage
    /// out, such as `method.vote=none`; one that the preset leaves out is given whole, such as
    /// `method.speckle={size_min=8,step_q4=32,reach_y_px=2}`. May be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Synapses per neuron, |W|: a multiple of 16 from 16 to 1024.
    #[arg(long, value_name = "N")]
    pub synapses: Option<u16>,
    /// Standard deviation of the synapses' offsets, px: above 0, at most 10. Their reach
    /// becomes three times as much, rounded up.
    #[arg(long, value_name = "X")]
    pub sigma: Option<f32>,
    /// Seed of the synapses' offsets and of random ties.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
}

impl Overrides {
    /// The preset's parameters with these in their place.
    ///
    /// # Errors
    /// One line that names the file or option and the reason.
    pub fn apply(&self, preset: Preset) -> Result<Parameters> {
        let mut parameters = preset.parameters();
        if let Some(path) = &self.config {
            parameters = with_file(&parameters, path)?;
        }
        for setting in &self.set {
            parameters = with_setting(&parameters, setting)?;
        }
        if let Some(synapses) = self.synapses {
            parameters.synapses = synapses;
        }
        if let Some(sigma_px) = self.sigma {
            parameters = parameters.with_sigma(sigma_px);
        }
        if let Some(seed) = self.seed {
            parameters = parameters.with_seed(seed);
        }
        Ok(parameters)
    }
}

/// Reads a preset's name.
///
/// # Errors
/// One line with the names that there are.
pub fn parse_preset(name: &str) -> Result<Preset, String> {
    name.parse()
        .map_err(|error: vgstereo_core::preset::UnknownPreset| error.to_string())
}

/// The lines of a pair of images, in grey when asked for.
fn views_of(left: &RgbImage, right: &RgbImage, grey: bool) -> Result<Views> {
    Views::new(left, right, grey)
        .with_context(|| format!("images are at most {} px wide", u16::MAX))
}

/// The output that `--sparse` asks for.
fn output_of(sparse: bool) -> Output {
    if sparse {
        Output::Sparse
    } else {
        Output::Dense
    }
}

/// A bar for long work, on standard error, and only where a person looks on.
#[must_use]
pub fn progress_bar(steps: u64, what: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg} [{bar:32}] {pos}/{len} {eta}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(steps)
        .with_style(style)
        .with_message(what.to_owned())
}

/// An empty table whose columns but the first `texts` are numbers.
#[must_use]
pub fn table(header: &[&str], texts: usize) -> Table {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN).set_header(header);
    for column in table.column_iter_mut().skip(texts) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// A percentage of two decimals; a dash where there is none.
fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}

fn milliseconds(time: Duration) -> String {
    format!("{:.1}", time.as_secs_f64() * 1e3)
}

/// Bytes in KiB, one decimal.
#[must_use]
pub fn kib(bytes: usize) -> String {
    format!("{:.1}", bytes as f64 / 1024.0)
}
