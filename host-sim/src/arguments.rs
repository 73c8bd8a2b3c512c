//! Command-line options that several commands take.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use vgstereo_core::{Output, Parameters, Preset};

use crate::parameters::{with_file, with_setting};

/// Options that replace parameters of a preset. A later field overrides an earlier one.
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
    /// Returns the parameters of `preset` after these options have replaced some of them.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
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

/// Returns a name for parameters that started from `preset`: that of the preset that they are,
/// whatever their seed, or else that of `preset`, marked as changed.
#[must_use]
pub fn name_of(parameters: &Parameters, preset: Preset) -> String {
    let is_same = |other: &Preset| {
        let other = other.parameters();
        parameters.with_seed(other.seed) == other
    };
    // The given preset first, should two be alike.
    match std::iter::once(preset).chain(Preset::ALL).find(is_same) {
        Some(same) => same.name().to_owned(),
        None => format!("{preset}, changed"),
    }
}

/// Returns the preset that has this name.
///
/// # Errors
/// Fails with one line that lists the names of all presets.
pub fn parse_preset(name: &str) -> Result<Preset, String> {
    name.parse()
        .map_err(|error: vgstereo_core::config::UnknownPreset| error.to_string())
}

/// Returns the threshold of bad pixels that a text states, px.
///
/// # Errors
/// Fails when it is not a number above 0, or more than 2047 px, the largest disparity of all.
pub fn parse_threshold(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(px) if px > 0.0 && px <= 2047.0 => Ok(px),
        _ => Err("it must be above 0 and at most 2047 px".to_owned()),
    }
}

/// Returns the output that the option `--sparse` asks for: sparse when it is set, otherwise
/// dense.
#[must_use]
pub fn output_of(sparse: bool) -> Output {
    if sparse {
        Output::Sparse
    } else {
        Output::Dense
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_named_for_what_they_are() {
        let micro = Preset::Micro.parameters();
        for preset in Preset::ALL {
            assert_eq!(name_of(&preset.parameters(), preset), preset.name());
            // A file of another preset's parameters replaces all of them.
            assert_eq!(name_of(&micro.with_seed(77), preset), "micro");
        }
        let changed = micro.with_sigma(2.0);
        assert_eq!(name_of(&changed, Preset::Micro), "micro, changed");
    }
}
