//! `vgstereo presets`: what each preset is and what it takes.

use anyhow::{Result, ensure};
use clap::Args;
use vgstereo_core::config::Config;
use vgstereo_core::disparity::DisparityRange;
use vgstereo_core::matching::TieBreak;
use vgstereo_core::preset::Preset;

use super::{kib, table};

/// Arguments of `vgstereo presets`.
#[derive(Debug, Args)]
pub struct Presets {
    /// Width of the images, px. Their height does not matter: memory does not grow with it.
    #[arg(long, value_name = "PX", default_value_t = 450)]
    width: u16,
    /// Largest disparity searched, px, smaller than the width.
    #[arg(long, value_name = "N", default_value_t = 59)]
    d_max: u16,
}

impl Presets {
    /// Prints the table.
    ///
    /// # Errors
    /// When the disparities do not fit the width.
    pub fn run(self) -> Result<String> {
        let disparities = DisparityRange::up_to(self.d_max);
        ensure!(
            disparities.fits(self.width),
            "--d-max {} does not fit a width of {} px: it must be smaller, and at most 2047",
            self.d_max,
            self.width
        );
        let mut table = table(
            &[
                "preset",
                "what it is",
                "synapses",
                "sigma px",
                "reach px",
                "ties",
                "vote passes",
                "median px",
                "KiB",
                "latency lines",
            ],
            2,
        );
        for preset in Preset::ALL {
            let parameters = preset.parameters();
            let config = Config::new(parameters, self.width, disparities);
            let or_none = |value: u8, text: String| if value == 0 { "-".to_owned() } else { text };
            let median = 2 * parameters.median_reach_px + 1;
            table.add_row([
                preset.name().to_owned(),
                preset.summary().to_owned(),
                parameters.synapses.to_string(),
                parameters.sigma_px.to_string(),
                format!("{}, {}", parameters.support.x_px, parameters.support.y_px),
                match parameters.ties {
                    TieBreak::Lowest => "lowest".to_owned(),
                    TieBreak::Random { .. } => "random".to_owned(),
                },
                or_none(
                    parameters.vote_passes,
                    format!(
                        "{} of {} best",
                        parameters.vote_passes, parameters.candidates
                    ),
                ),
                or_none(parameters.median_reach_px, format!("{median}x{median}")),
                kib(config.memory_words() * size_of::<u32>()),
                parameters.latency_lines().to_string(),
            ]);
        }
        Ok(format!(
            "{table}\nworking memory for lines of {} px and disparities 0 to {}, any height\n",
            self.width, self.d_max
        ))
    }
}
