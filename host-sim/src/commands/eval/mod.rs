//! `vgstereo eval`: percentages of bad pixels on scenes with ground truth.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use image::ImageFormat;
use serde::Serialize;
use vgstereo_core::{DisparityRange, Preset};

use crate::arguments::{
    InterpolationName, Overrides, name_of, output_of, parse_preset, parse_threshold,
};
use crate::dataset::{
    distinct_names, ensure_distinct, find_scenes, load_calibrated, load_scene_with, scene_files,
};
use crate::escapes::{shown, shown_name};
use crate::files::{encode, ensure_distinct_outputs, make_folder, write_files};
use crate::images::{bits_note, parse_bits};
use crate::line_offset::{LineOffset, lowered};
use crate::link::recorded::Lacking;
use crate::pictures::{colour_disparities, error_map};
use crate::prepared::Prepared;
use crate::scene::GroundTruth;
use crate::terminal::{note, progress_bar};
use compare::{Ranked, ensure_comparable, ensure_has_masks, rank, ranking_table};
use report::{Cost, Gathered, PresetReport, SceneReport, results_table, tenths_table};
use spread::SpreadReport;

mod compare;
mod recorded;
mod report;
mod spread;

/// The arguments of `vgstereo eval`.
#[derive(Debug, Args)]
#[command(
    after_help = "DIR holds one folder per scene: left.png, right.png, gt_left.png, meta.toml (d_max, gt_scale),\n\
    and the masks nonocc.png, all.png, disc.png where there are.\n\n\
    Scenes:      vgstereo eval middlebury tsukuba venus teddy cones --preset paper-raw,paper --compare\n\
    A recording: vgstereo eval walk.mcap --truth middlebury/teddy --preset micro\n\n\
    Of a recording, the disparities that the board has found are judged, as `board`, and its pairs are matched with the \
    presets that --preset names; with all presets, where there are pairs alone. The scene of --truth needs no views."
)]
pub struct Eval {
    /// Folder of scenes, or with --truth a recording of a board's link.
    dir: PathBuf,
    /// Judge each frame of a recording by the truth of the scene in this folder, which the board saw.
    #[arg(long, value_name = "SCENE", conflicts_with_all = ["scenes", "seeds", "compare", "bits"])]
    truth: Option<PathBuf>,
    /// Scenes to measure, by the name of their folder [default: all directly in DIR].
    scenes: Vec<String>,
    /// Presets, separated by commas [default: all].
    #[arg(long, value_name = "P,P", value_delimiter = ',', value_parser = parse_preset)]
    preset: Vec<Preset>,
    /// A pixel is bad when its disparity is further than this from the truth, px.
    #[arg(long, value_name = "PX", default_value_t = 1.0, value_parser = parse_threshold)]
    threshold: f32,
    /// Repeat with each of these seeds, separated by commas, and report the spread.
    #[arg(
        long,
        value_name = "N,N",
        value_delimiter = ',',
        conflicts_with = "seed"
    )]
    seeds: Vec<u64>,
    /// The views are as the cameras gave them, and are rectified by the calibration files that
    /// meta.toml names, as `match --calibration` does; its table `rectified` may have the projections
    /// P1 and P2 that the truth is for.
    #[arg(long)]
    calibrated: bool,
    /// With --calibrated: how levels between raw pixels are made.
    #[arg(long, value_enum, default_value_t, requires = "calibrated")]
    interpolation: InterpolationName,
    /// Match the grey of colour images.
    #[arg(long)]
    grey: bool,
    /// Bits that views of 16 bits use, 8 to 16 [default: as many as the largest level of the pair
    /// has].
    #[arg(long, value_name = "N", value_parser = parse_bits)]
    bits: Option<u8>,
    /// Leave out what was filled in: percentages are of the disparities found, `invalid` is
    /// the share of pixels without one.
    #[arg(long)]
    sparse: bool,
    /// Also tell how many of the disparities found are bad in each tenth of them, from the least
    /// confident to the most, over all scenes.
    #[arg(long, conflicts_with = "seeds")]
    by_confidence: bool,
    /// Also rank the presets among published results on Middlebury v2: tsukuba, venus, teddy
    /// and cones must be among the scenes, with their masks.
    #[arg(long, conflicts_with_all = ["seeds", "sparse"])]
    compare: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Write coloured disparities and error maps into this folder; with --seeds, those of each seed.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    line_offset: LineOffset,
    /// Threads per frame; the figures but the time do not depend on their number. The
    /// SGM presets take at most 2.
    #[arg(long, value_name = "N", default_value = "1")]
    threads: NonZeroUsize,
    #[command(flatten)]
    overrides: Overrides,
}

/// The JSON that `--json` prints unless there are several seeds.
#[derive(Debug, Serialize)]
struct Report<'a> {
    presets: &'a [PresetReport],
    /// What the recording lacks that was judged.
    #[serde(flatten)]
    recording: Option<Lacking>,
    /// The presets and the published methods on the scenes of Middlebury v2, best first.
    #[serde(skip_serializing_if = "Option::is_none")]
    comparison: Option<Vec<Ranked>>,
}

impl Eval {
    /// Measures the presets on the scenes and returns a table or JSON.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn run(self) -> Result<String> {
        let presets = if self.preset.is_empty() {
            Preset::ALL.to_vec()
        } else {
            self.preset.clone()
        };
        ensure_distinct("preset", &presets)?;
        ensure_distinct("seed", &self.seeds)?;
        for &preset in &presets {
            self.overrides.apply(preset)?;
        }
        if let Some(truth) = &self.truth {
            return self.recorded(truth, &presets);
        }
        ensure!(
            !self.dir.is_file(),
            "{} is no folder of scenes; of a recording, --truth names the scene",
            shown(&self.dir)
        );
        let folders = find_scenes(&self.dir, &self.scenes)?;
        if self.compare {
            ensure_comparable(self.threshold, &folders)?;
        }
        if let Some(out) = &self.out {
            self.ensure_keeps_inputs(out, &presets, &folders)?;
            make_folder(out)?;
        }
        let by_seed = self.measure_all(&presets, &folders)?;
        match by_seed.as_slice() {
            [presets] => self.report_one(presets, None),
            by_seed => self.report_spread(by_seed),
        }
    }

    /// Checks that no picture replaces another one or what is read.
    ///
    /// # Errors
    /// Fails with one line that names two paths.
    fn ensure_keeps_inputs(
        &self,
        out: &Path,
        presets: &[Preset],
        folders: &[PathBuf],
    ) -> Result<()> {
        let mut inputs = scene_files(folders)?;
        inputs.extend(self.overrides.config.clone());
        let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
        for name in distinct_names(folders) {
            let runs = self.seeds().into_iter();
            let runs = runs.flat_map(|seed| presets.iter().map(move |&preset| (seed, preset)));
            let outputs: Vec<PathBuf> = runs
                .flat_map(|(seed, preset)| self.picture_paths(out, &name, preset.name(), seed))
                .collect();
            let outputs: Vec<&Path> = outputs.iter().map(PathBuf::as_path).collect();
            ensure_distinct_outputs(&inputs, &outputs).context("--out")?;
        }
        Ok(())
    }

    /// The seeds of the runs; `None` is the presets' own.
    fn seeds(&self) -> Vec<Option<u64>> {
        match self.seeds.as_slice() {
            [] => vec![self.overrides.seed],
            seeds => seeds.iter().copied().map(Some).collect(),
        }
    }

    /// The pictures of a run: disparities and errors. Those of several seeds name theirs.
    fn picture_paths(
        &self,
        out: &Path,
        scene: &str,
        preset: &str,
        seed: Option<u64>,
    ) -> [PathBuf; 2] {
        let seed = seed.filter(|_| !self.seeds.is_empty());
        let seed = seed.map_or_else(String::new, |seed| format!("-seed-{seed}"));
        ["disparity", "error"].map(|what| out.join(format!("{scene}-{preset}{seed}-{what}.png")))
    }

    /// Returns, for each seed, the reports of all presets.
    fn measure_all(
        &self,
        presets: &[Preset],
        folders: &[PathBuf],
    ) -> Result<Vec<Vec<PresetReport>>> {
        let seeds = self.seeds();
        let runs: Vec<(Option<u64>, Preset)> = seeds
            .iter()
            .flat_map(|&seed| presets.iter().map(move |&preset| (seed, preset)))
            .collect();
        let bar = progress_bar((runs.len() * folders.len()) as u64, "matching");
        let mut gathered: Vec<Gathered> = runs.iter().map(|_| Gathered::NONE).collect();
        // Scenes are the outer loop, so that one of them is in memory at a time.
        for (folder, name) in folders.iter().zip(distinct_names(folders)) {
            let mut prepared = self.load(folder)?;
            if let Some(bits) = prepared.scene.bits {
                bar.suspend(|| note(&format!("{}: {}", shown_name(&name), bits_note(bits))));
            }
            prepared.scene.name = name;
            for (&(seed, preset), gathered) in runs.iter().zip(&mut gathered) {
                let overrides = Overrides {
                    seed,
                    ..self.overrides.clone()
                };
                self.measure(&prepared, preset, &overrides, gathered)?;
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        let names = presets.iter().map(|&preset| {
            let parameters = self.overrides.apply(preset)?;
            Ok(name_of(&parameters, preset))
        });
        let names: Vec<String> = names.collect::<Result<_>>()?;
        let mut reports = names
            .iter()
            .cycle()
            .zip(gathered)
            .map(|(name, gathered)| PresetReport::new(name, gathered));
        let by_seed = seeds
            .iter()
            .map(|_| reports.by_ref().take(presets.len()).collect());
        Ok(by_seed.collect())
    }

    /// Loads a scene, with the right view lowered as `--line-offset` says.
    fn load(&self, folder: &Path) -> Result<Prepared> {
        let (mut scene, made) = if self.calibrated {
            let (scene, made) = load_calibrated(folder, self.bits, self.interpolation.into())?;
            (scene, Some(made))
        } else {
            (load_scene_with(folder, self.bits)?, None)
        };
        if self.line_offset.px != 0.0 {
            scene.right = lowered(&scene.right, self.line_offset.px);
        }
        let prepared = match &made {
            Some(made) => Prepared::rectified(scene, self.grey, &made.maps.rectification()?),
            None => Prepared::new(scene, self.grey),
        };
        let prepared = prepared.with_context(|| shown(folder))?;
        if self.compare {
            ensure_has_masks(folder, &prepared)?;
        }
        Ok(prepared)
    }

    /// Matches one scene with one preset, writes its pictures if they are wanted, and adds its figures to
    /// those gathered.
    fn measure(
        &self,
        prepared: &Prepared,
        preset: Preset,
        overrides: &Overrides,
        gathered: &mut Gathered,
    ) -> Result<()> {
        let output = output_of(self.sparse);
        let matched = prepared.matched(overrides.apply(preset)?, output, self.threads.get())?;
        let bad = prepared.measure(&matched, self.threshold, self.sparse)?;
        if let Some(out) = &self.out {
            let scene = &prepared.scene;
            let paths = self.picture_paths(out, &scene.name, preset.name(), overrides.seed);
            let (map, width) = (&matched.disparities_q4, scene.left.width());
            let disparities = prepared.disparities();
            self.write_pictures(&paths, map, width, disparities, scene.truth.as_ref())?;
        }
        let scene = &prepared.scene;
        if let Some(truth) = scene.truth.as_ref().filter(|_| self.by_confidence) {
            let (disparities_q4, confidences) = (&matched.disparities_q4, &matched.confidences);
            let counts = &mut gathered.by_confidence;
            counts.count(disparities_q4, confidences, truth, self.threshold);
        }
        let cost = Some(Cost::of(&matched));
        let size = scene.left.dimensions();
        let report = SceneReport::new(&scene.name, size, scene.d_max, &bad, cost);
        gathered.scenes.push(report);
        Ok(())
    }

    /// Writes pictures of disparities, 1/16 px, in lines of `width` px, and of their errors.
    fn write_pictures(
        &self,
        [disparity_path, error_path]: &[PathBuf; 2],
        map: &[i16],
        width: u32,
        disparities: DisparityRange,
        truth: Option<&GroundTruth>,
    ) -> Result<()> {
        let coloured = colour_disparities(map, width, disparities);
        let mut files = vec![(disparity_path, encode(&coloured.into(), ImageFormat::Png)?)];
        if let Some(truth) = truth {
            let errors = error_map(map, width, truth, self.threshold);
            files.push((error_path, encode(&errors.into(), ImageFormat::Png)?));
        }
        // A name may begin with those of folders.
        if let Some(folder) = disparity_path.parent() {
            make_folder(folder)?;
        }
        write_files(&files)
    }

    /// Returns the table or the JSON of a single seed.
    fn report_one(&self, presets: &[PresetReport], recording: Option<Lacking>) -> Result<String> {
        let comparison = self.compare.then(|| rank(presets));
        if self.json {
            let report = Report {
                presets,
                recording,
                comparison,
            };
            return Ok(serde_json::to_string(&report)? + "\n");
        }
        let ranking = comparison.map_or_else(String::new, |ranking| ranking_table(&ranking));
        let results = results_table(presets, self.threshold, self.sparse);
        Ok(results + &tenths_table(presets) + &ranking)
    }

    /// Returns the table or the JSON of several seeds.
    fn report_spread(&self, by_seed: &[Vec<PresetReport>]) -> Result<String> {
        let report = SpreadReport::new(self.seeds.clone(), by_seed);
        if self.json {
            Ok(serde_json::to_string(&report)? + "\n")
        } else {
            Ok(report.table(self.threshold))
        }
    }
}
