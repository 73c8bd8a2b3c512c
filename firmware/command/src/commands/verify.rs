//! `cargo firmware verify`: compares emulated boards with the host, byte for byte.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use rayon::prelude::*;
use vgstereo_core::Preset;
use vgstereo_emulated::Request;
use vgstereo_sim::tables::table;
use vgstereo_sim::terminal::progress_bar;

use super::images::Images;
use super::selection::{Alone, ExecutedSelection};
use crate::board::Board;
use crate::build::build;
use crate::elf::Sizes;
use crate::emulator::{self, Clock};
use crate::host;
use crate::model;
use crate::pair::Pair;
use crate::simulation::{self, Scenario};
use crate::toolchain::ensure_complete;

/// The scenes that are taken from the folder `MIDDLEBURY_DIR`.
const SCENES: [&str; 4] = ["tsukuba", "venus", "teddy", "cones"];

/// The arguments of `verify`.
#[derive(Debug, Args)]
#[command(
    after_help = "Every preset that fits a board's memory, on the built-in scene, on raw lines that are \
    rectified first (crooked), both with a laser scan where it fits, and, where the environment \
    variable MIDDLEBURY_DIR names their folder, on Tsukuba, Venus, Teddy and Cones: \
    in grey and half as large on a small board, whole and in colour on the others.\n\nThe real \
    board runs the firmware that is flashed on a model of its chip: one frame of the built-in \
    scene. It is left out where the model cannot be built, unless it is named.\n\nThe soft core's RTL is simulated \
    with its firmware, camera pins to serial port: lite, or what --preset names, on one frame of the built-in scene, \
    which takes minutes, or with --lines on a part of it. It is left out where Verilator or its processor is missing.\n\nWith images or \
    a calibration, that pair alone, in grey: on the emulated boards, and on the real one and the soft core if it is \
    named.\n\nExample: cargo firmware verify --board stm32f405 --left left.png --right right.png \
    --calibration cal.yaml"
)]
pub struct Verify {
    /// Only the first N lines of each pair: all of the firmware runs, in less time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    lines: Option<u32>,
    #[command(flatten)]
    images: Images,
    /// Number of disparities to search in these images, px.
    #[arg(long, value_name = "N", default_value_t = 32)]
    disparities: u16,
    #[command(flatten)]
    alone: Alone,
    #[command(flatten)]
    selection: ExecutedSelection,
}

/// One comparison: a board runs its firmware on a pair with a preset.
struct Case {
    board: Board,
    firmware: PathBuf,
    pair: Pair,
    request: Request,
}

impl Verify {
    /// Runs all comparisons and returns a table of them.
    ///
    /// # Errors
    /// Fails with one line that names the first case in which board and host differ, or what
    /// is missing.
    pub fn run(self) -> Result<String> {
        let given = self.images.pair(self.disparities)?;
        let mut boards = self.alone.of(self.selection.boards())?;
        if given.is_some() && !self.selection.is_one() {
            boards.retain(|board| board.emulation.is_some());
        }
        ensure_complete(&boards)?;
        let (emulated, others): (Vec<_>, Vec<_>) = boards
            .into_iter()
            .partition(|board| board.emulation.is_some());
        let folder = std::env::var_os("MIDDLEBURY_DIR").map(PathBuf::from);
        let mut cases = Vec::new();
        for board in emulated {
            let firmware = build(&board)?;
            let lent_bytes = Sizes::read(&firmware)?.lent_bytes;
            let mut pairs = match &given {
                Some(pair) => vec![pair.clone()],
                None => built_in(&board, folder.as_deref())?,
            };
            if let Some(lines) = self.lines {
                pairs.iter_mut().for_each(|pair| pair.cut(lines));
            }
            for pair in pairs {
                for preset in Preset::ALL {
                    let request = pair.request(preset, 1, &[])?;
                    let scanning = Request {
                        scan: pair.scan(),
                        ..request.clone()
                    };
                    // With a scan where there is room for it.
                    let mut requests = [scanning, request].into_iter();
                    let fitting = requests.find(|request| {
                        request.working_bytes() <= lent_bytes && board.is_built_for(request)
                    });
                    if let Some(request) = fitting {
                        cases.push(Case {
                            board,
                            firmware: firmware.clone(),
                            pair: pair.clone(),
                            request,
                        });
                    }
                }
            }
        }
        ensure!(
            !cases.is_empty() || !others.is_empty(),
            "no preset fits the memory of these boards with this pair"
        );
        let bar = progress_bar(cases.len() as u64, "boards against the host");
        let compared: Result<Vec<()>> = cases
            .par_iter()
            .map(|case| {
                let compared = case.compare();
                bar.inc(1);
                compared
            })
            .collect();
        bar.finish_and_clear();
        compared?;

        let mut table = table(&["board", "scene", "size", "identical with"], 4);
        for rows in cases.chunk_by(|a, b| {
            (a.board, &a.pair.name, a.pair.size()) == (b.board, &b.pair.name, b.pair.size())
        }) {
            if let [first, ..] = rows {
                let presets: Vec<_> = rows.iter().map(|case| case.request.preset.name()).collect();
                table.add_row([
                    first.board.full_name(),
                    first.pair.name.clone(),
                    first.pair.size(),
                    presets.join(", "),
                ]);
            }
        }
        for board in others {
            if board.model.is_some() {
                table.add_row(compare_modelled(&board, given.as_ref())?);
                continue;
            }
            let pairs = match &given {
                Some(pair) => vec![pair.clone()],
                None => built_in_simulated(&board, folder.as_deref(), self.lines)?,
            };
            for mut pair in pairs {
                if let Some(lines) = self.lines {
                    pair.cut(lines);
                }
                table.add_row(compare_simulated(&board, &pair)?);
            }
        }
        let note = match folder {
            _ if given.is_some() => "",
            Some(_) => "",
            None => "MIDDLEBURY_DIR is not set: the built-in scene alone\n",
        };
        Ok(format!("{table}\n{note}"))
    }
}

/// Returns the pairs that a board is verified on unless others are named: two sizes of the built-in
/// scene, one taken for raw lines, and the scenes in `folder` if there is one.
fn built_in(board: &Board, folder: Option<&Path>) -> Result<Vec<Pair>> {
    let mut pairs = vec![
        Pair::rendered(160, 120, 32),
        Pair::rendered(320, 240, 48),
        Pair::crooked(160, 120, 32, true)?,
    ];
    for scene in SCENES {
        if let Some(folder) = folder {
            pairs.push(Pair::load(&folder.join(scene), board)?);
        }
    }
    Ok(pairs)
}

/// Returns the pairs that a board in RTL is verified on unless others are named: the built-in scene, one taken for raw
/// lines, of which there are only `lines` if that is given, and the middle of a scene in `folder` if there is one.
fn built_in_simulated(
    board: &Board,
    folder: Option<&Path>,
    lines: Option<u32>,
) -> Result<Vec<Pair>> {
    // They cannot be cut later, as their rectification is for all of them.
    let raw_lines = lines.map_or(120, |lines| lines.min(120) as u16);
    let mut pairs = vec![
        Pair::rendered(160, 120, 32),
        Pair::crooked(160, raw_lines, 32, true)?,
    ];
    if let Some(folder) = folder {
        pairs.push(Pair::load(&folder.join("teddy"), board)?.middle(160));
    }
    Ok(pairs)
}

/// Runs a real board's firmware on the model of its chip until a frame of this pair, or of the built-in
/// one, has come, compares that with the host's, and returns the row of the table.
///
/// # Errors
/// Fails with one line that says what differs, or what the chip refused.
fn compare_modelled(board: &Board, pair: Option<&Pair>) -> Result<[String; 4]> {
    let built_for = board.model.context("the board has a model")?;
    let pair = pair.map_or_else(|| model::built_in_pair(&built_for), Pair::clone);
    let expected = model::expected(&built_for, &pair)?;
    let (program, firmware) = (model::build(board)?, build(board)?);
    let scenario = model::Scenario {
        frames: 1,
        until_ms: 10_000,
        ..model::Scenario::default()
    };
    let ran = model::run(&program, &firmware, &pair, &scenario)?;
    let whole = ran.frames.iter().find(|frame| frame.is_whole);
    let whole = whole.with_context(|| format!("{}: no frame: {:?}", board.name, ran.log))?;
    ensure!(
        whole.disparities == expected.disparities,
        "{}: the frame differs from the host's",
        board.name
    );
    let taken = ran.report.ensure_all_accesses_taken();
    taken.context(board.name)?;
    let resets = &ran.report.resets;
    ensure!(resets.is_empty(), "{}: resets {resets:?}", board.name);
    let name = format!("{}, modelled", board.name);
    Ok([
        name,
        pair.name.clone(),
        pair.size(),
        built_for.preset.to_string(),
    ])
}

/// Runs the firmware of a board in RTL on this pair, compares the frame with the host's, and returns the row of the
/// table.
///
/// # Errors
/// Fails with one line that says what differs, or what the simulation complains of.
fn compare_simulated(board: &Board, pair: &Pair) -> Result<[String; 4]> {
    let built_for = board.simulation.context("the board is simulated")?;
    let request = pair.request(built_for.preset, 1, &[])?;
    let (program, firmware) = (simulation::build(board)?, build(board)?);
    let scenario = Scenario::default();
    let ran = simulation::run(board, &program, &firmware, pair, &request, &scenario)?;
    let (host, _) = host::run(pair, &request)?;
    let difference = host::first_difference(&ran.frames, &host, pair.left.width());
    ensure!(
        difference.is_none(),
        "{}, {} {}, {}: {}",
        board.name,
        pair.name,
        pair.size(),
        built_for.preset,
        difference.unwrap_or_default()
    );
    let name = format!("{}, simulated", board.full_name());
    Ok([
        name,
        pair.name.clone(),
        pair.size(),
        built_for.preset.to_string(),
    ])
}

impl Case {
    /// Runs the case on the board and on the host.
    ///
    /// # Errors
    /// Fails with one line that names the case and the first pixel that differs.
    fn compare(&self) -> Result<()> {
        let (pair, request) = (&self.pair, &self.request);
        let (board, _) = emulator::run(&self.board, &self.firmware, pair, request, Clock::Host)?;
        let (host, _) = host::run(pair, request)?;
        let difference = host::first_difference(&board, &host, self.pair.left.width());
        ensure!(
            difference.is_none(),
            "{}, {} {}, {}: {}",
            self.board.name,
            self.pair.name,
            self.pair.size(),
            self.request.preset,
            difference.unwrap_or_default()
        );
        Ok(())
    }
}
