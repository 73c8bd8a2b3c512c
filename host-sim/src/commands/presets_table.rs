//! `vgstereo presets`: lists the presets with their parameters, memory and latency.

use anyhow::{Result, ensure};
use clap::Args;
use vgstereo_core::{Config, DisparityRange, Preset};

use crate::arguments::parse_preset;
use crate::parameters::to_toml;
use crate::tables::{kib, table};

/// The arguments of `vgstereo presets`.
#[derive(Debug, Args)]
pub struct Presets {
    /// Width of the images, px. Their height does not matter: memory does not grow with it.
    #[arg(long, value_name = "PX", default_value_t = 450)]
    width: u16,
    /// Largest disparity searched, px, smaller than the width.
    #[arg(long, value_name = "N", default_value_t = 59)]
    d_max: u16,
    /// Print this preset's parameters as TOML, a start for one's own (`--config`).
    #[arg(long, value_name = "NAME", value_parser = parse_preset)]
    toml: Option<Preset>,
}

impl Presets {
    /// Returns the table of the presets, or the parameters of one of them as TOML.
    ///
    /// # Errors
    /// Fails when the disparities do not fit the width.
    pub fn run(self) -> Result<String> {
        if let Some(preset) = self.toml {
            return to_toml(&preset.parameters());
        }
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
                "KiB",
                "KiB in colour",
                "latency lines",
            ],
            2,
        );
        for preset in Preset::ALL {
            let parameters = preset.parameters();
            let grey = Config::new(parameters, self.width, disparities);
            let colour = Config {
                colour: true,
                ..grey
            };
            let bytes = |config: &Config| kib(config.memory_words() * size_of::<u32>());
            let [near, far] = parameters.sigmas_px;
            table.add_row([
                preset.name().to_owned(),
                preset.summary().to_owned(),
                parameters.synapses.to_string(),
                if near == far {
                    near.to_string()
                } else {
                    format!("{near}, {far}")
                },
                format!("{}, {}", parameters.support.x_px, parameters.support.y_px),
                bytes(&grey),
                bytes(&colour),
                parameters.latency_lines().to_string(),
            ]);
        }
        Ok(format!(
            "{table}\nworking memory for lines of {} px and disparities 0 to {}, any height\n",
            self.width, self.d_max
        ))
    }
}
