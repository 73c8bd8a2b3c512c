//! The frames of a recording, judged by the truth of a scene.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use vgstereo_core::{DisparityRange, Preset};

use super::Eval;
use super::report::{Gathered, PresetReport, SceneReport};
use crate::arguments::name_of;
use crate::dataset::{KnownScene, scene_files};
use crate::escapes::shown;
use crate::files::{ensure_distinct_outputs, make_folder};
use crate::line_offset::lowered;
use crate::link::board::{Board, Frame};
use crate::link::client::Memory;
use crate::link::recorded::{DENSE, Found, Frames, JUDGED, Pair, found, pair};
use crate::metrics::BadPixels;
use crate::prepared::Prepared;
use crate::scene::Scene;
use crate::terminal::{note, spinner};

/// The name of what the board has found, among those of presets.
const BOARD: &str = "board";

/// What of a frame can be judged: at least one of the two.
struct Seen {
    found: Option<Found>,
    pair: Option<Pair>,
}

impl Seen {
    fn of(frame: &Frame, board: &Board) -> Result<Option<Self>> {
        let seen = Self {
            found: found(frame, board)?,
            pair: pair(frame)?,
        };
        Ok((seen.found.is_some() || seen.pair.is_some()).then_some(seen))
    }
}

/// Frames that are judged, and what came of it.
struct Judging<'a> {
    eval: &'a Eval,
    known: KnownScene,
    /// The files that are read.
    inputs: Vec<PathBuf>,
    /// The figures of what the board has found.
    board: Gathered,
    /// Those of each preset.
    presets: Vec<(Preset, Gathered)>,
    /// Whether filled in disparities could not be told from those found.
    is_dense: bool,
}

impl Eval {
    /// Judges the frames of the recording by the truth of the scene in `folder`. Those with pairs alone are
    /// matched with these presets, the others with those that `--preset` names.
    pub(super) fn recorded(&self, folder: &Path, presets: &[Preset]) -> Result<String> {
        let name = shown(&self.dir);
        ensure!(
            self.dir.is_file(),
            "{name}: there is no such file: with --truth, it is a recording"
        );
        let mut inputs = scene_files(&[folder.to_owned()])?;
        inputs.extend(self.overrides.config.clone());
        inputs.push(self.dir.clone());
        let mut judging = Judging {
            eval: self,
            known: KnownScene::load(folder)?,
            inputs,
            board: Gathered::NONE,
            presets: presets
                .iter()
                .map(|&preset| (preset, Gathered::NONE))
                .collect(),
            is_dense: false,
        };
        let mut memory = Memory::default();
        let mut frames = Frames::open(&self.dir, &mut memory)?;
        let bar = spinner();
        let mut count = 0_u64;
        while let Some((frame, seen)) = frames.next_of(Seen::of)? {
            let judged = judging.judge(&frames, &frame, seen?);
            judged.with_context(|| frames.place_of(&frame))?;
            count += 1;
            bar.set_message(format!("judging: {count} frames"));
            bar.tick();
        }
        bar.finish_and_clear();
        if count == 0 {
            return Err(frames.none(JUDGED));
        }
        let reports = judging.gathered()?;
        for lack in frames.lacks(JUDGED) {
            note(&lack);
        }
        self.report_one(&reports, Some(frames.lacking()))
    }
}

impl Judging<'_> {
    /// The reports of all frames, without presets that nothing was matched with.
    fn gathered(self) -> Result<Vec<PresetReport>> {
        let eval = self.eval;
        let is_matched = self
            .presets
            .iter()
            .any(|(_, frames)| !frames.scenes.is_empty());
        ensure!(
            is_matched || eval.preset.is_empty(),
            "{}: --preset: it has no pair of views to match",
            shown(&eval.dir)
        );
        if self.is_dense && eval.sparse {
            note(DENSE);
        }
        let mut gathered = Vec::new();
        if !self.board.scenes.is_empty() {
            gathered.push(PresetReport::new(BOARD, self.board));
        }
        for (preset, frames) in self.presets {
            if !frames.scenes.is_empty() {
                let parameters = eval.overrides.apply(preset)?;
                let name = name_of(&parameters, preset);
                gathered.push(PresetReport::new(&name, frames));
            }
        }
        Ok(gathered)
    }

    /// Judges a frame of this name.
    fn judge(&mut self, frames: &Frames<'_>, name: &str, seen: Seen) -> Result<()> {
        let is_matched = seen.found.is_none() || !self.eval.preset.is_empty();
        if let Some(found) = seen.found {
            let d_max = frames.d_max_px().and_then(|px| u16::try_from(px).ok());
            self.judge_found(name, d_max.unwrap_or(self.known.d_max()), &found)?;
            self.is_dense |= found.confidences.is_none();
        }
        let Some(pair) = seen.pair.filter(|_| is_matched) else {
            return Ok(());
        };
        frames.ensure_rectifiable(&pair, self.eval.calibrated, "--calibrated")?;
        let prepared = self.prepared(name, pair)?;
        for at in 0..self.presets.len() {
            let (eval, preset) = (self.eval, self.presets[at].0);
            self.pictures(name, preset.name())?;
            let gathered = &mut self.presets[at].1;
            eval.measure(&prepared, preset, &eval.overrides, gathered)?;
        }
        Ok(())
    }

    /// Judges what the board has found.
    fn judge_found(&mut self, name: &str, d_max: u16, found: &Found) -> Result<()> {
        let (eval, truth) = (self.eval, &self.known.truth);
        let [width, height] = found.size;
        self.ensure_as_large((width, height))?;
        let sparse_q4 = eval.sparse.then(|| found.sparse_q4());
        let disparities_q4 = sparse_q4.as_ref().unwrap_or(&found.disparities_q4);
        let bad = BadPixels::measure(disparities_q4, truth, eval.threshold, eval.sparse);
        if let Some(paths) = self.pictures(name, BOARD)? {
            let range = DisparityRange::up_to(d_max);
            eval.write_pictures(&paths, disparities_q4, width, range, Some(truth))?;
        }
        let confidences = found.confidences.as_ref();
        if let Some(confidences) = confidences.filter(|_| eval.by_confidence) {
            let counts = &mut self.board.by_confidence;
            counts.count(&found.disparities_q4, confidences, truth, eval.threshold);
        }
        let report = SceneReport::new(name, (width, height), d_max, &bad, None);
        self.board.scenes.push(report);
        Ok(())
    }

    /// A pair as a scene with the truth, rectified where it is not.
    fn prepared(&self, name: &str, pair: Pair) -> Result<Prepared> {
        let (eval, known) = (self.eval, &self.known);
        let size = pair.left.dimensions();
        let mut scene = Scene {
            name: name.to_owned(),
            left: pair.left,
            right: pair.right,
            bits: None,
            d_max: known.d_max(),
            truth: Some(known.truth.clone()),
        };
        if eval.line_offset.px != 0.0 {
            scene.right = lowered(&scene.right, eval.line_offset.px);
        }
        if eval.calibrated && !pair.is_rectified {
            let made = known.rectification(size, eval.interpolation.into())?;
            return Prepared::rectified(scene, eval.grey, &made.maps.rectification()?);
        }
        self.ensure_as_large(size)?;
        Prepared::new(scene, eval.grey)
    }

    /// The pictures of a frame, if they are wanted; checked that none of them replaces what is read.
    fn pictures(&self, frame: &str, preset: &str) -> Result<Option<[PathBuf; 2]>> {
        let Some(out) = &self.eval.out else {
            return Ok(None);
        };
        let pictures = self.eval.picture_paths(out, frame, preset, None);
        let inputs: Vec<&Path> = self.inputs.iter().map(PathBuf::as_path).collect();
        let outputs: Vec<&Path> = pictures.iter().map(PathBuf::as_path).collect();
        ensure_distinct_outputs(&inputs, &outputs).context("--out")?;
        make_folder(out)?;
        Ok(Some(pictures))
    }

    /// Checks that what is judged is as large as the truth.
    fn ensure_as_large(&self, (width, height): (u32, u32)) -> Result<()> {
        let known = &self.known;
        ensure!(
            (width, height) == known.size,
            "it is of {width}x{height} px, and the truth in {} of {}x{}",
            shown(&known.folder),
            known.size.0,
            known.size.1
        );
        Ok(())
    }
}
