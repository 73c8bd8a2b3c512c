//! `vgstereo exposure`: how many more pixels are bad when the two cameras differ in exposure.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde::Serialize;
use vgstereo_core::{Output, Preset};

use crate::arguments::{aggregating_unless_named, parse_preset, parse_threshold};
use crate::dataset::{ensure_distinct, find_scenes, load_scene};
use crate::escapes::shown_name;
use crate::exposure::Exposure;
use crate::prepared::Prepared;
use crate::render::{Exposures, RenderOptions};
use crate::tables::{difference, percent, table};
use crate::terminal::progress_bar;

/// The arguments of `vgstereo exposure`.
#[derive(Debug, Args)]
#[command(
    after_help = "The built-in scene is rendered with each exposure; of scenes in a folder the right view's\n\
    levels are changed and clamped.\n\n\
    Example: vgstereo exposure middlebury teddy --preset micro,balanced"
)]
pub struct ExposureWedge {
    /// Folder of scenes, as for `eval`; measured after the built-in scene.
    dir: Option<PathBuf>,
    /// Scenes, by the name of their folder [default: all directly in DIR].
    scenes: Vec<String>,
    /// Presets, separated by commas [default: all that aggregate].
    #[arg(long, value_name = "P,P", value_delimiter = ',', value_parser = parse_preset)]
    preset: Vec<Preset>,
    /// A pixel is bad when its disparity is further than this from the truth, px.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = parse_threshold)]
    threshold: f32,
    /// Match the grey of colour images.
    #[arg(long)]
    grey: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The exposures of the right camera: gain, gradient of the gain, offset and gradient of the
/// offset. The first one is equal to that of the left camera.
const WEDGE: [[f32; 4]; 17] = [
    [1.0, 0.0, 0.0, 0.0],
    [0.6, 0.0, 0.0, 0.0],
    [0.8, 0.0, 0.0, 0.0],
    [1.25, 0.0, 0.0, 0.0],
    [1.6, 0.0, 0.0, 0.0],
    [1.0, 0.0, -30.0, 0.0],
    [1.0, 0.0, 30.0, 0.0],
    [0.6, 0.0, -30.0, 0.0],
    [0.6, 0.0, 30.0, 0.0],
    [0.8, 0.0, 30.0, 0.0],
    [1.25, 0.0, -30.0, 0.0],
    [1.6, 0.0, -30.0, 0.0],
    [1.6, 0.0, 30.0, 0.0],
    [1.1, 1.0, 0.0, 0.0],
    [1.1, -1.0, 0.0, 0.0],
    [1.0, 0.0, 0.0, 60.0],
    [1.0, 0.0, 0.0, -60.0],
];

/// The JSON that `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    scenes: Vec<SceneReport>,
}

#[derive(Debug, Serialize)]
struct SceneReport {
    scene: String,
    exposures: Vec<ExposureReport>,
}

#[derive(Debug, Serialize)]
struct ExposureReport {
    /// The gain in the first line and in the last line.
    gain: [f64; 2],
    /// The offset in the first line and in the last line, grey levels.
    offset: [f64; 2],
    presets: Vec<PresetReport>,
}

#[derive(Debug, Serialize)]
struct PresetReport {
    preset: String,
    /// The bad pixels, percent, averaged over the masks.
    average: Option<f64>,
    /// The average less that with equal exposure, percent.
    cost: Option<f64>,
}

impl ExposureWedge {
    /// Measures every scene at every exposure and returns a table or JSON.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn run(self) -> Result<String> {
        let presets = aggregating_unless_named(&self.preset);
        ensure_distinct("preset", &presets)?;
        let folders = match &self.dir {
            Some(dir) => find_scenes(dir, &self.scenes)?,
            None => Vec::new(),
        };
        let built_in = Exposures::new(&RenderOptions::default());
        let steps = (1 + folders.len()) * WEDGE.len();
        let bar = progress_bar(steps as u64, "matching");
        let mut report = Report { scenes: Vec::new() };
        for folder in [None].into_iter().chain(folders.iter().map(Some)) {
            let stored = folder.map(|folder| load_scene(folder)).transpose()?;
            let mut name = String::new();
            let mut exposures: Vec<ExposureReport> = Vec::new();
            for [gain, gain_gradient, offset, offset_gradient] in WEDGE {
                let exposure = Exposure {
                    gain,
                    gain_gradient,
                    offset,
                    offset_gradient,
                };
                let scene = match &stored {
                    Some(stored) => {
                        let mut scene = stored.clone();
                        exposure.apply(&mut scene.right);
                        scene
                    }
                    None => built_in.scene(exposure),
                };
                let prepared = Prepared::new(scene, self.grey)?;
                let equal = exposures.first();
                let measured = presets.iter().enumerate().map(|(index, &preset)| {
                    let matched = prepared.matched(preset.parameters(), Output::Dense, 1)?;
                    let average = prepared.measure(&matched, self.threshold, false)?.average();
                    let before = match equal {
                        Some(equal) => equal.presets.get(index).and_then(|p| p.average),
                        None => average,
                    };
                    Ok(PresetReport {
                        preset: preset.name().to_owned(),
                        average,
                        cost: average
                            .zip(before)
                            .map(|(average, before)| average - before),
                    })
                });
                let presets = measured.collect::<Result<_>>()?;
                let (first, last) = (exposure.of_line(0, 2), exposure.of_line(1, 2));
                name.clone_from(&prepared.scene.name);
                exposures.push(ExposureReport {
                    gain: [first.0, last.0],
                    offset: [first.1, last.1],
                    presets,
                });
                bar.inc(1);
            }
            report.scenes.push(SceneReport {
                scene: name,
                exposures,
            });
        }
        bar.finish_and_clear();
        if self.json {
            Ok(serde_json::to_string(&report)? + "\n")
        } else {
            Ok(results_table(&report, &presets, self.threshold))
        }
    }
}

/// Returns the table of all scenes and exposures, and a line below it that explains the figures.
fn results_table(report: &Report, presets: &[Preset], threshold_px: f32) -> String {
    let mut header = vec!["scene", "gain", "offset"];
    header.extend(presets.iter().flat_map(|preset| [preset.name(), "cost"]));
    let mut table = table(&header, 3);
    for scene in &report.scenes {
        for exposure in &scene.exposures {
            let mut row = vec![
                shown_name(&scene.scene),
                from_to(exposure.gain),
                from_to(exposure.offset),
            ];
            for preset in &exposure.presets {
                row.push(percent(preset.average));
                row.push(difference(preset.cost));
            }
            table.add_row(row);
        }
    }
    format!(
        "{table}\naverage over the masks of the bad pixels in percent, further than {threshold_px} px; cost: more\n\
         than with equal exposure; a number of the first line to that of the last\n"
    )
}

/// Returns the number of the first line and that of the last line as text; one number if they
/// are equal.
fn from_to([first, last]: [f64; 2]) -> String {
    let number = |value: f64| format!("{}", (value * 100.0).round() / 100.0);
    if first == last {
        number(first)
    } else {
        format!("{} to {}", number(first), number(last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_tells_the_exposure_and_its_cost() {
        let report = Report {
            scenes: vec![SceneReport {
                scene: "yard".to_owned(),
                exposures: vec![ExposureReport {
                    gain: [f64::from(0.6_f32), 1.6],
                    offset: [-30.0; 2],
                    presets: vec![PresetReport {
                        preset: "lite".to_owned(),
                        average: Some(9.5),
                        cost: Some(1.25),
                    }],
                }],
            }],
        };
        let text = results_table(&report, &[Preset::Lite], 1.0);
        let row = text.lines().nth(2).unwrap();
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        assert_eq!(cells[1..6], ["yard", "0.6 to 1.6", "-30", "9.50", "+1.25"]);
    }
}
