//! `vgstereo stress`: how many more pixels are bad when cameras, lamps, transport or the world disturb the
//! pictures.

use std::num::NonZeroU32;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde::Serialize;
use vgstereo_core::Preset;

use crate::arguments::{
    Overrides, aggregating_unless_named, output_of, parse_preset, parse_threshold,
};
use crate::dataset::{ensure_distinct, find_scenes, load_scene, save_scene};
use crate::escapes::{shown, shown_name};
use crate::files::make_folder;
use crate::prepared::Prepared;
use crate::render::{RenderOptions, render};
use crate::scene::Scene;
use crate::stress::{self, Kind};
use crate::tables::{difference, percent, table};
use crate::terminal::progress_bar;

/// The arguments of `vgstereo stress`.
#[derive(Debug, Args)]
#[command(
    after_help = "Kinds, with the amounts of the battery: texture (contrast that is left), noise (grey levels), blur (px, of\n\
    the right view), gamma, vignetting (share), white-balance, gain, black-level, line-offset (px), roll (degrees),\n\
    scale (percent), bands (percent, of mains light), row-noise (grey levels), jpeg (quality), clipped (gain of both\n\
    views), periodic (px), plain (level), one-grey. Figures of periodic and plain are of the painted surfaces alone.\n\n\
    Another program on the same pictures, such as OpenCV:\n\
    \x20   vgstereo stress middlebury teddy --kind noise=25 --write disturbed\n\
    \x20   python3 tools/opencv_accuracy.py disturbed/*\n\n\
    Example: vgstereo stress middlebury teddy --preset lite,micro --kind noise,jpeg=20"
)]
pub struct Stress {
    /// Folder of scenes, as for `eval` [default: the built-in scene].
    dir: Option<PathBuf>,
    /// Scenes, by the name of their folder [default: all directly in DIR].
    scenes: Vec<String>,
    /// Presets, separated by commas [default: all that aggregate].
    #[arg(long, value_name = "P,P", value_delimiter = ',', value_parser = parse_preset)]
    preset: Vec<Preset>,
    /// Kinds, separated by commas, each with an amount or without for those of the battery [default: all].
    #[arg(long, value_name = "KIND[=AMOUNT]", value_delimiter = ',', value_parser = parse_kind)]
    kind: Vec<Asked>,
    /// Seed of the noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// A pixel is bad when its disparity is further than this from the truth, px.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = parse_threshold)]
    threshold: f32,
    /// Take each picture for this many frames of one camera, each of which begins with the offsets of lines that the
    /// one before taught; figures are of the last.
    #[arg(long, value_name = "N", default_value = "1")]
    frames: NonZeroU32,
    /// Match the grey of colour images.
    #[arg(long)]
    grey: bool,
    /// Leave out what was filled in: percentages are of the disparities found.
    #[arg(long)]
    sparse: bool,
    /// Also write each disturbed scene into a folder of this one, to be measured by other programs.
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Any parameter by its name, as `eval` takes it, such as `method.line_offset_max_lines=4`. May be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// A kind that was asked for, with all amounts of the battery or this one.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Asked {
    kind: Kind,
    amount: Option<f32>,
}

/// Reads a kind with or without an amount.
fn parse_kind(text: &str) -> Result<Asked, String> {
    let (name, amount) = match text.split_once('=') {
        Some((name, amount)) => (name, Some(amount)),
        None => (text, None),
    };
    let mut all = Kind::ALL.into_iter();
    let Some((kind, ..)) = all.find(|all| all.1 == name) else {
        let names: Vec<&str> = Kind::ALL.into_iter().map(|all| all.1).collect();
        return Err(format!("there are {}", names.join(", ")));
    };
    let amount = amount.map(|amount| match amount.parse::<f32>() {
        Ok(amount) if kind.takes(amount) => Ok(amount),
        _ => Err(format!("{amount} is no amount of {name}")),
    });
    Ok(Asked {
        kind,
        amount: amount.transpose()?,
    })
}

/// The JSON that `--json` prints: for each scene the undisturbed figures and those of each disturbance.
#[derive(Debug, Serialize)]
struct Report {
    scenes: Vec<SceneReport>,
}

#[derive(Debug, Serialize)]
struct SceneReport {
    scene: String,
    rows: Vec<Row>,
}

#[derive(Debug, Serialize)]
struct Row {
    /// The kind; `None` for the scene as it is.
    kind: Option<&'static str>,
    amount: Option<f32>,
    presets: Vec<PresetReport>,
}

#[derive(Debug, Serialize)]
struct PresetReport {
    preset: &'static str,
    /// The bad pixels, percent, averaged over the masks.
    average: Option<f64>,
    /// The average less that of the undisturbed scene, percent.
    cost: Option<f64>,
    /// All pixels without a disparity, percent.
    invalid: f64,
}

impl Stress {
    /// Measures every scene under every disturbance and returns a table or JSON.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn run(self) -> Result<String> {
        let presets = aggregating_unless_named(&self.preset);
        ensure_distinct("preset", &presets)?;
        let battery = self.battery();
        let scenes: Vec<Scene> = match &self.dir {
            Some(dir) => find_scenes(dir, &self.scenes)?
                .iter()
                .map(|folder| load_scene(folder))
                .collect::<Result<_>>()?,
            None => vec![render(&RenderOptions::default())],
        };
        for scene in &scenes {
            ensure!(
                scene.truth.is_some(),
                "{} has no ground truth",
                shown_name(&scene.name)
            );
        }
        if let Some(folder) = &self.write {
            make_folder(folder)?;
        }
        let bar = progress_bar((scenes.len() * (1 + battery.len())) as u64, "matching");
        let mut report = Report { scenes: Vec::new() };
        for scene in &scenes {
            let mut rows = vec![self.row(scene.clone(), None, &presets, None)?];
            bar.inc(1);
            for &disturbance in &battery {
                let mut disturbed = scene.clone();
                disturbance
                    .apply(&mut disturbed, self.seed)
                    .with_context(|| shown_name(&scene.name))?;
                let before = rows.first();
                let row = self.row(disturbed, Some(disturbance), &presets, before)?;
                rows.push(row);
                bar.inc(1);
            }
            report.scenes.push(SceneReport {
                scene: scene.name.clone(),
                rows,
            });
        }
        bar.finish_and_clear();
        if self.json {
            return Ok(serde_json::to_string(&report)? + "\n");
        }
        Ok(results_table(&report, &presets, self.threshold))
    }

    /// All disturbances, in the order of the kinds that were asked for.
    fn battery(&self) -> Vec<stress::Stress> {
        let all = Kind::ALL.map(|(kind, ..)| Asked { kind, amount: None });
        let asked = match self.kind.as_slice() {
            [] => &all[..],
            asked => asked,
        };
        let of = |&Asked { kind, amount }: &Asked| {
            let amounts = amount.map_or(kind.amounts().to_vec(), |amount| vec![amount]);
            amounts
                .into_iter()
                .map(move |amount| stress::Stress { kind, amount })
        };
        asked.iter().flat_map(of).collect()
    }

    /// Measures a scene, and writes it if it is disturbed and that was asked for. Costs are against the row
    /// `before`, that of the scene as it is.
    fn row(
        &self,
        scene: Scene,
        disturbance: Option<stress::Stress>,
        presets: &[Preset],
        before: Option<&Row>,
    ) -> Result<Row> {
        if let (Some(folder), Some(disturbance)) = (&self.write, disturbance) {
            let name = format!(
                "{}-{}-{}",
                scene.name,
                disturbance.kind.name(),
                disturbance.amount
            );
            let folder = folder.join(name);
            save_scene(&folder, &scene, None).with_context(|| shown(&folder))?;
        }
        let prepared = Prepared::new(scene, self.grey)?;
        let overrides = Overrides {
            set: self.set.clone(),
            ..Overrides::default()
        };
        let measured = presets.iter().enumerate().map(|(index, preset)| {
            let output = output_of(self.sparse);
            let frames = self.frames.get();
            let parameters = overrides.apply(*preset)?;
            let matched = prepared.matched_as_frame(frames, parameters, output, 2)?;
            let bad = prepared.measure(&matched, self.threshold, self.sparse)?;
            let average = bad.average();
            let before = before.and_then(|row| row.presets.get(index)?.average);
            Ok(PresetReport {
                preset: preset.name(),
                average,
                cost: average
                    .zip(before)
                    .map(|(average, before)| average - before),
                invalid: bad.invalid,
            })
        });
        Ok(Row {
            kind: disturbance.map(|disturbance| disturbance.kind.name()),
            amount: disturbance.map(|disturbance| disturbance.amount),
            presets: measured.collect::<Result<_>>()?,
        })
    }
}

/// Returns the table of all scenes and disturbances, and a line below it that explains the figures.
fn results_table(report: &Report, presets: &[Preset], threshold_px: f32) -> String {
    let mut header = vec!["scene", "kind", "amount"];
    header.extend(presets.iter().flat_map(|preset| [preset.name(), "cost"]));
    let mut table = table(&header, 3);
    for scene in &report.scenes {
        for row in &scene.rows {
            let mut cells = vec![
                shown_name(&scene.scene),
                row.kind.unwrap_or("as it is").to_owned(),
                row.amount
                    .map(|amount| amount.to_string())
                    .unwrap_or_default(),
            ];
            for preset in &row.presets {
                cells.push(percent(preset.average));
                cells.push(difference(preset.cost));
            }
            table.add_row(cells);
        }
    }
    format!(
        "{table}\naverage over the masks of the bad pixels in percent, further than {threshold_px} px; cost: more than \
         of the scene as it is\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_amounts_within_their_bounds() {
        let noise = |amount| {
            Ok(Asked {
                kind: Kind::Noise,
                amount,
            })
        };
        assert_eq!(parse_kind("noise"), noise(None));
        assert_eq!(parse_kind("noise=12.5"), noise(Some(12.5)));
        for wrong in [
            "noise=-1",
            "noise=x",
            "noise=inf",
            "jpeg=0",
            "jpeg=101",
            "blur=0",
        ] {
            let error = parse_kind(wrong).unwrap_err();
            assert!(error.contains("is no amount of"), "{error}");
        }
        assert!(parse_kind("snow").unwrap_err().contains("white-balance"));
    }
}
