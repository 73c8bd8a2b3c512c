//! `vgstereo eval`: percentages of bad pixels on scenes with ground truth.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde::Serialize;
use vgstereo_core::config::{Config, Output, Parameters};
use vgstereo_core::disparity::DisparityRange;
use vgstereo_core::preset::Preset;

use super::{Overrides, kib, output_of, parse_preset, percent, progress_bar, table, views_of};
use crate::dataset::{ensure_distinct, find_scenes, load_scene};
use crate::files::{make_folder, write_png};
use crate::frame::{Matched, match_frame};
use crate::kernels::HostKernels;
use crate::line_offset::{LineOffset, lowered};
use crate::metrics::{BadPixels, mean};
use crate::pictures::{colour_disparities, error_map};
use crate::published::{self, METHODS, PAPER, SCENES};
use crate::scene::Scene;
use crate::views::Views;

/// Arguments of `vgstereo eval`.
#[derive(Debug, Args)]
#[command(
    after_help = "DIR holds one folder per scene: left.png, right.png, gt_left.png, meta.toml (d_max, gt_scale),\n\
    and the masks nonocc.png, all.png, disc.png where there are.\n\n\
    Example: vgstereo eval middlebury tsukuba venus teddy cones --preset paper-raw,paper --compare"
)]
pub struct Eval {
    /// Folder of scenes.
    dir: PathBuf,
    /// Scenes to measure, by the name of their folder [default: all directly in DIR].
    scenes: Vec<String>,
    /// Presets, separated by commas [default: all].
    #[arg(long, value_name = "P,P", value_delimiter = ',', value_parser = parse_preset)]
    preset: Vec<Preset>,
    /// A pixel is bad when its disparity is further than this from the truth, px.
    #[arg(long, value_name = "PX", default_value_t = 1.0)]
    threshold: f32,
    /// Repeat with each of these seeds, separated by commas, and report the spread.
    #[arg(
        long,
        value_name = "N,N",
        value_delimiter = ',',
        conflicts_with = "seed"
    )]
    seeds: Vec<u64>,
    /// Match the grey of colour images.
    #[arg(long)]
    grey: bool,
    /// Leave out what was filled in: percentages are of the disparities found, `invalid` is
    /// the share of pixels without one.
    #[arg(long)]
    sparse: bool,
    /// Also rank the presets among published results on Middlebury v2: tsukuba, venus, teddy
    /// and cones must be among the scenes, with their masks.
    #[arg(long, conflicts_with_all = ["seeds", "sparse"])]
    compare: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Write coloured disparities and error maps into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    line_offset: LineOffset,
    /// Threads per frame; the figures but the time do not depend on their number. The
    /// aggregating presets take at most 2.
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,
    #[command(flatten)]
    overrides: Overrides,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report {
    presets: Vec<PresetReport>,
    /// Presets and published methods on the scenes of Middlebury v2, best first.
    #[serde(skip_serializing_if = "Option::is_none")]
    comparison: Option<Vec<Ranked>>,
}

#[derive(Debug, Serialize)]
struct PresetReport {
    preset: String,
    average: Option<f64>,
    scenes: Vec<SceneReport>,
}

#[derive(Debug, Serialize)]
struct SceneReport {
    scene: String,
    width: u32,
    height: u32,
    d_max: u16,
    nonocc: Option<f64>,
    all: Option<f64>,
    disc: Option<f64>,
    average: Option<f64>,
    invalid: f64,
    seconds: f64,
    working_bytes: usize,
    latency_lines: u32,
}

/// What `--json` prints of several seeds.
#[derive(Debug, Serialize)]
struct SpreadReport {
    seeds: Vec<u64>,
    presets: Vec<PresetSpread>,
}

#[derive(Debug, Serialize)]
struct PresetSpread {
    preset: String,
    average: Spread,
    scenes: Vec<SceneSpread>,
}

#[derive(Debug, Serialize)]
struct SceneSpread {
    scene: String,
    #[serde(flatten)]
    spread: Spread,
}

/// Averages over the masks, one per seed.
#[derive(Debug, Serialize)]
struct Spread {
    mean: Option<f64>,
    smallest: Option<f64>,
    largest: Option<f64>,
}

impl Spread {
    fn new(averages: impl Iterator<Item = Option<f64>>) -> Self {
        let averages: Vec<f64> = averages.flatten().collect();
        Self {
            mean: mean(averages.iter().copied()),
            smallest: averages.iter().copied().reduce(f64::min),
            largest: averages.iter().copied().reduce(f64::max),
        }
    }
}

impl SpreadReport {
    /// Of reports of the same presets and scenes.
    fn new(seeds: Vec<u64>, by_seed: &[Report]) -> Self {
        let first = by_seed.first().map_or(&[][..], |report| &report.presets);
        let presets = first.iter().enumerate().map(|(index, preset)| {
            let presets: Vec<&PresetReport> = by_seed
                .iter()
                .filter_map(|report| report.presets.get(index))
                .collect();
            let scenes = preset.scenes.iter().enumerate().map(|(place, scene)| {
                let scenes = presets.iter().filter_map(|preset| preset.scenes.get(place));
                SceneSpread {
                    scene: scene.scene.clone(),
                    spread: Spread::new(scenes.map(|scene| scene.average)),
                }
            });
            PresetSpread {
                preset: preset.preset.clone(),
                average: Spread::new(presets.iter().map(|preset| preset.average)),
                scenes: scenes.collect(),
            }
        });
        Self {
            seeds,
            presets: presets.collect(),
        }
    }
}

/// A preset or a published method on the scenes of Middlebury v2.
#[derive(Debug, Serialize)]
struct Ranked {
    method: String,
    /// Not measured here.
    published: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    source: Option<&'static str>,
    average: f64,
    scenes: Vec<RankedScene>,
}

#[derive(Debug, Serialize)]
struct RankedScene {
    scene: &'static str,
    nonocc: f64,
    all: f64,
    disc: f64,
    average: f64,
}

impl RankedScene {
    fn new(scene: &'static str, [nonocc, all, disc]: [f64; 3]) -> Self {
        Self {
            scene,
            nonocc,
            all,
            disc,
            average: (nonocc + all + disc) / 3.0,
        }
    }
}

/// A scene ready to be matched.
pub(super) struct Prepared {
    pub(super) scene: Scene,
    views: Views,
}

impl Prepared {
    /// Loads a scene; in grey when asked for.
    pub(super) fn load(folder: &Path, grey: bool) -> Result<Self> {
        Self::new(load_scene(folder)?, grey).with_context(|| folder.display().to_string())
    }

    /// A scene already loaded, likewise.
    pub(super) fn new(scene: Scene, grey: bool) -> Result<Self> {
        let views = views_of(&scene.left, &scene.right, grey)?;
        Ok(Self { scene, views })
    }

    /// Whether there is a mask for each of the benchmark's figures.
    fn has_all_masks(&self) -> bool {
        let truth = self.scene.truth.as_ref();
        truth.is_some_and(|truth| {
            truth.nonocc.is_some() && truth.all.is_some() && truth.disc.is_some()
        })
    }

    /// Matches it.
    pub(super) fn matched(
        &self,
        parameters: Parameters,
        output: Output,
        threads: usize,
    ) -> Result<Matched> {
        let config = Config {
            format: self.views.format,
            output,
            ..Config::new(parameters, self.views.width, self.disparities())
        };
        match_frame(&config, &self.views, HostKernels::fastest(), threads)
            .with_context(|| self.scene.name.clone())
    }

    /// Measures disparities against the truth.
    pub(super) fn measure(
        &self,
        matched: &Matched,
        threshold_px: f32,
        sparse: bool,
    ) -> Result<BadPixels> {
        let truth = self.scene.truth.as_ref();
        let truth = truth.with_context(|| format!("{} has no ground truth", self.scene.name))?;
        Ok(BadPixels::measure(
            &matched.disparities_q4,
            truth,
            threshold_px,
            sparse,
        ))
    }

    fn disparities(&self) -> DisparityRange {
        DisparityRange::up_to(self.scene.d_max)
    }
}

impl Eval {
    /// Measures and prints a table or JSON.
    ///
    /// # Errors
    /// One line that names the file or option and the reason.
    pub fn run(self) -> Result<String> {
        ensure!(self.threshold > 0.0, "--threshold must be above 0");
        let presets = if self.preset.is_empty() {
            Preset::ALL.to_vec()
        } else {
            self.preset.clone()
        };
        ensure_distinct("preset", &presets)?;
        ensure_distinct("seed", &self.seeds)?;
        let folders = find_scenes(&self.dir, &self.scenes)?;
        self.ensure_comparable(&folders)?;
        if let Some(out) = &self.out {
            make_folder(out)?;
        }
        let seeds: Vec<Option<u64>> = match self.seeds.as_slice() {
            [] => vec![self.overrides.seed],
            seeds => seeds.iter().copied().map(Some).collect(),
        };
        let steps = presets.len() * folders.len() * seeds.len();
        let bar = progress_bar(steps as u64, "matching");
        let runs = seeds.len() * presets.len();
        let mut reports: Vec<Vec<SceneReport>> = (0..runs).map(|_| Vec::new()).collect();
        for folder in &folders {
            let mut scene = load_scene(folder)?;
            if self.line_offset.px != 0.0 {
                scene.right = lowered(&scene.right, self.line_offset.px);
            }
            let prepared =
                Prepared::new(scene, self.grey).with_context(|| folder.display().to_string())?;
            ensure!(
                !self.compare || !is_of_v2(folder) || prepared.has_all_masks(),
                "--compare needs nonocc.png, all.png and disc.png: {} has not all of them",
                folder.display()
            );
            let runs = seeds
                .iter()
                .flat_map(|seed| presets.iter().map(move |p| (seed, p)));
            for ((&seed, &preset), reports) in runs.zip(&mut reports) {
                let overrides = Overrides {
                    seed,
                    ..self.overrides.clone()
                };
                reports.push(self.measure(&prepared, preset, &overrides)?);
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        let mut by_seed: Vec<Report> = Vec::new();
        let mut reports = reports.into_iter();
        for _ in &seeds {
            let presets: Vec<PresetReport> = presets
                .iter()
                .zip(&mut reports)
                .map(|(preset, scenes)| PresetReport {
                    preset: preset.name().to_owned(),
                    average: mean(scenes.iter().filter_map(|scene| scene.average)),
                    scenes,
                })
                .collect();
            by_seed.push(Report {
                comparison: self.compare.then(|| compare(&presets)),
                presets,
            });
        }
        match by_seed.as_slice() {
            [report] if self.json => Ok(serde_json::to_string(report)? + "\n"),
            [report] => Ok(self.results_table(report)),
            by_seed => {
                let report = SpreadReport::new(self.seeds.clone(), by_seed);
                if self.json {
                    Ok(serde_json::to_string(&report)? + "\n")
                } else {
                    Ok(self.spread_table(&report))
                }
            }
        }
    }

    /// Refuses to compare what was not measured as the published figures were.
    fn ensure_comparable(&self, folders: &[PathBuf]) -> Result<()> {
        if !self.compare {
            return Ok(());
        }
        ensure!(
            self.threshold == published::THRESHOLD_PX,
            "--compare: the published figures are for a threshold of {} px, not {}",
            published::THRESHOLD_PX,
            self.threshold
        );
        for scene in SCENES {
            ensure!(
                folders.iter().any(|folder| folder.ends_with(scene)),
                "--compare: the published figures are for {}; {scene} is not among the scenes",
                SCENES.join(", ")
            );
        }
        Ok(())
    }

    fn measure(
        &self,
        prepared: &Prepared,
        preset: Preset,
        overrides: &Overrides,
    ) -> Result<SceneReport> {
        let output = output_of(self.sparse);
        let matched = prepared.matched(overrides.apply(preset)?, output, self.threads)?;
        let bad = prepared.measure(&matched, self.threshold, self.sparse)?;
        let scene = &prepared.scene;
        let (width, height) = scene.left.dimensions();
        if let Some(out) = &self.out {
            let map = &matched.disparities_q4;
            let name = |what: &str| out.join(format!("{}-{preset}-{what}.png", scene.name));
            let coloured = colour_disparities(map, width, prepared.disparities());
            write_png(&name("disparity"), &coloured.into())?;
            if let Some(truth) = &scene.truth {
                let errors = error_map(map, width, truth, self.threshold);
                write_png(&name("error"), &errors.into())?;
            }
        }
        Ok(SceneReport {
            scene: scene.name.clone(),
            width,
            height,
            d_max: scene.d_max,
            nonocc: bad.nonocc,
            all: bad.all,
            disc: bad.disc,
            average: bad.average(),
            invalid: bad.invalid,
            seconds: matched.time.as_secs_f64(),
            working_bytes: matched.working_bytes,
            latency_lines: matched.latency_lines,
        })
    }

    fn results_table(&self, report: &Report) -> String {
        let mut table = table(
            &[
                "preset", "scene", "nonocc", "all", "disc", "average", "invalid", "ms", "KiB",
                "lines",
            ],
            2,
        );
        for preset in &report.presets {
            for scene in &preset.scenes {
                table.add_row([
                    preset.preset.clone(),
                    scene.scene.clone(),
                    percent(scene.nonocc),
                    percent(scene.all),
                    percent(scene.disc),
                    percent(scene.average),
                    percent(Some(scene.invalid)),
                    format!("{:.1}", scene.seconds * 1e3),
                    kib(scene.working_bytes),
                    scene.latency_lines.to_string(),
                ]);
            }
            table.add_row(average_row(&preset.preset, "average", preset.average));
        }
        let measured = report
            .presets
            .first()
            .map_or(&[][..], |preset| &preset.scenes);
        let published: Vec<_> = SCENES
            .iter()
            .zip(PAPER.bad_percent)
            .filter(|(name, _)| measured.iter().any(|scene| scene.scene == **name))
            .collect();
        for (name, masks) in &published {
            let mut row = vec!["published".to_owned(), (**name).to_owned()];
            row.extend(masks.iter().map(|&value| percent(Some(value))));
            row.push(percent(mean(masks.iter().copied())));
            table.add_row(row);
        }
        if published.len() == SCENES.len() {
            table.add_row(average_row("published", "average", PAPER.mean()));
        }
        let among = if self.sparse {
            ", of the disparities found"
        } else {
            " or without a disparity"
        };
        let note = if published.is_empty() {
            ""
        } else {
            "; published: the paper's own figures"
        };
        let comparison = report
            .comparison
            .as_deref()
            .map_or_else(String::new, comparison_table);
        format!(
            "{table}\nbad pixels in percent, further than {} px from the truth{among}{note}\n{comparison}",
            self.threshold
        )
    }

    fn spread_table(&self, report: &SpreadReport) -> String {
        let mut table = table(&["preset", "scene", "mean", "smallest", "largest"], 2);
        for preset in &report.presets {
            let scenes = preset.scenes.iter().map(|s| (s.scene.as_str(), &s.spread));
            for (name, spread) in scenes.chain([("average", &preset.average)]) {
                table.add_row([
                    preset.preset.clone(),
                    name.to_owned(),
                    percent(spread.mean),
                    percent(spread.smallest),
                    percent(spread.largest),
                ]);
            }
        }
        format!(
            "{table}\naverage over the masks of the bad pixels in percent, further than {} px; {} seeds\n",
            self.threshold,
            report.seeds.len()
        )
    }
}

/// Whether a folder is that of a scene of Middlebury v2.
fn is_of_v2(folder: &Path) -> bool {
    SCENES.iter().any(|scene| folder.ends_with(scene))
}

/// Presets that were measured on all scenes of Middlebury v2 among published methods.
fn compare(presets: &[PresetReport]) -> Vec<Ranked> {
    let measured = presets.iter().filter_map(|preset| {
        let scenes = SCENES.iter().map(|&name| {
            let scene = preset.scenes.iter().find(|scene| scene.scene == name)?;
            Some(RankedScene::new(
                name,
                [scene.nonocc?, scene.all?, scene.disc?],
            ))
        });
        let scenes = scenes.collect::<Option<Vec<_>>>()?;
        Some(Ranked {
            method: preset.preset.clone(),
            published: false,
            source: None,
            average: mean(scenes.iter().map(|scene| scene.average))?,
            scenes,
        })
    });
    let published = METHODS.iter().map(|method| Ranked {
        method: method.method.to_owned(),
        published: true,
        source: Some(method.source),
        average: method.average,
        scenes: SCENES
            .iter()
            .zip(method.bad_percent)
            .map(|(&name, masks)| RankedScene::new(name, masks))
            .collect(),
    });
    let mut ranked: Vec<Ranked> = measured.chain(published).collect();
    ranked.sort_by(|a, b| a.average.total_cmp(&b.average));
    ranked
}

fn comparison_table(comparison: &[Ranked]) -> String {
    let mut header = vec!["method", "source"];
    header.extend(SCENES);
    header.push("average");
    let mut table = table(&header, 2);
    for method in comparison {
        let mut row = vec![
            method.method.clone(),
            method.source.unwrap_or("measured here").to_owned(),
        ];
        let averages = method.scenes.iter().map(|scene| scene.average);
        row.extend(
            averages
                .chain([method.average])
                .map(|value| percent(Some(value))),
        );
        table.add_row(row);
    }
    format!(
        "\n{table}\naverages over nonocc, all and disc; those with a source are published figures\n"
    )
}

fn average_row(preset: &str, scene: &str, average: Option<f64>) -> Vec<String> {
    let mut row = vec![preset.to_owned(), scene.to_owned()];
    row.extend([String::new(), String::new(), String::new()]);
    row.push(percent(average));
    row
}
