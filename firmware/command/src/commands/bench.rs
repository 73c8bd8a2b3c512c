//! `cargo firmware bench`: instructions, RAM and flash that matching takes on emulated boards.

use std::path::Path;

use anyhow::{Result, ensure};
use clap::Args;
use rayon::prelude::*;
use serde::{Serialize, Serializer};
use vgstereo_core::Preset;
use vgstereo_emulated::meter::Stage;
use vgstereo_emulated::request::HAMMING_CELLS;
use vgstereo_emulated::{Report, Request};
use vgstereo_sim::tables::{kib, table};
use vgstereo_sim::terminal::progress_bar;

use super::images::Images;
use super::selection::{Alone, CountedSelection};
use crate::board::{
    Board, MPS2_AN500, MPS3_AN547, RISCV_VIRT, RISCV_VIRT_ZBB, SOFTCORE, STM32F405,
};
use crate::build::build;
use crate::elf::Sizes;
use crate::emulator::{self, Clock};
use crate::pair::Pair;
use crate::simulation::{self, Scenario};
use crate::toolchain::ensure_complete;

/// Cases that are measured: a board, the width and height of the views in px, the number of
/// disparities, and the presets.
const CASES: [(Board, u32, u32, u16, &[Preset]); 7] = [
    (STM32F405, 160, 120, 32, &[Preset::Lite, Preset::Micro]),
    (STM32F405, 320, 240, 48, &[Preset::Lite, Preset::Micro]),
    (
        MPS2_AN500,
        450,
        375,
        60,
        &[Preset::Lite, Preset::Micro, Preset::Balanced],
    ),
    (
        MPS3_AN547,
        320,
        240,
        48,
        &[Preset::Lite, Preset::Micro, Preset::Balanced],
    ),
    (RISCV_VIRT, 320, 240, 48, &[Preset::Lite, Preset::Micro]),
    (RISCV_VIRT_ZBB, 320, 240, 48, &[Preset::Lite, Preset::Micro]),
    (SOFTCORE, 160, 120, 32, &[Preset::Lite, Preset::Micro]),
];

/// The case that is run once more with raw lines, which are rectified first by resampling both views, and
/// once more with a laser scan.
const SPECIAL: (Board, u16, u16, u16, Preset) = (STM32F405, 320, 240, 48, Preset::Lite);

/// The name of the rows that measure the Hamming stage alone: distances of patterns of 64
/// cells, without masks and without differences of levels.
pub const HAMMING: &str = "hamming-64";
const _: () = assert!(HAMMING_CELLS == 64);

/// The arguments of `bench`.
#[derive(Debug, Args)]
#[command(
    after_help = "On the built-in scene in grey, one frame. The emulator counts instructions, not \
    cycles; every run gives the same numbers. The soft core, if it is named, counts its cycles: of one frame, which \
    takes minutes. The counter is read before and after each call of a \
    kernel: the stages sum to the total. The rows hamming-64 are of that stage alone: distances \
    of 64-bit patterns, without masks and levels, within the pipeline of lite. Frames per second = clock in Hz x instructions per \
    cycle / (instructions per pixel and disparity x width x height x disparities).\n\nWith images or a \
    calibration, that pair alone, in grey, with every preset that fits a board's memory.\n\nExample: \
    cargo firmware bench --board stm32f405 --calibration cal.yaml --binned 2"
)]
pub struct Bench {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    images: Images,
    /// Number of disparities to search in these images, px.
    #[arg(long, value_name = "N", default_value_t = 32)]
    disparities: u16,
    #[command(flatten)]
    alone: Alone,
    #[command(flatten)]
    selection: CountedSelection,
}

/// Cost of matching views of one size with one preset on a board: instructions, RAM and flash.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// The name of the pair.
    pub scene: String,
    /// The name of the board.
    pub board: String,
    /// The name of the preset, or [`HAMMING`].
    pub preset: &'static str,
    /// Whether the lines are raw, and rectified first.
    pub is_rectified: bool,
    /// Whether a laser scan is made of the frame.
    pub is_scanned: bool,
    /// The width of each view, px.
    pub width: u32,
    /// The height of each view, px.
    pub height: u32,
    /// The number of disparities that are searched.
    pub disparities: u16,
    /// The unit of the counts: `instructions`, or on a simulated board `cycles`.
    pub counted: &'static str,
    /// Instructions or cycles per pixel and disparity of one frame, without those of camera, sink and link.
    pub instructions_per_pixel_disparity: f64,
    /// The name of each stage with its instructions or cycles per pixel and disparity.
    #[serde(serialize_with = "as_map")]
    pub stages: Vec<(&'static str, f64)>,
    /// Bytes of statics, and of the lent memory as far as matcher and session use it.
    pub static_ram_bytes: u64,
    /// Bytes of stack: the most that was in use at a time.
    pub stack_bytes: u32,
    /// Bytes of flash: code, constants and initial values, with every preset linked in unless the board is built for
    /// one.
    pub flash_bytes: u64,
}

#[derive(Debug, Serialize)]
struct Rows {
    boards: Vec<Row>,
}

fn as_map<S: Serializer>(stages: &[(&str, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(stages.iter().copied())
}

impl Bench {
    /// Builds the firmware, runs all cases with instructions counted, and returns a table or
    /// JSON.
    ///
    /// # Errors
    /// Fails with one line that says what is missing or fails.
    pub fn run(self) -> Result<String> {
        let given = self.images.pair(self.disparities)?;
        let boards = self.alone.of(self.selection.boards())?;
        ensure_complete(&boards)?;
        let mut cases = Vec::new();
        for board in boards {
            let firmware = build(&board)?;
            let mut tasks = match &given {
                Some(pair) => fitting(pair, Sizes::read(&firmware)?.lent_bytes)?,
                None => built_in(&board)?,
            };
            tasks.retain(|(_, request)| board.is_built_for(request));
            if board.simulation.is_some() {
                tasks.retain(|(_, request)| {
                    simulation::ensure_built_for(&board, request).is_ok() && !request.hamming_alone
                });
            }
            cases.extend(
                tasks
                    .into_iter()
                    .map(|(pair, request)| (board, firmware.clone(), pair, request)),
            );
        }
        ensure!(
            !cases.is_empty(),
            "no preset fits the memory of these boards with this pair"
        );
        let bar = progress_bar(cases.len() as u64, "counting instructions");
        let rows: Result<Vec<Row>> = cases
            .into_par_iter()
            .map(|(board, firmware, pair, request)| {
                let report = counted(&board, &firmware, &pair, &request)?;
                let sizes = Sizes::read(&firmware)?;
                let (width, height) = pair.matched_size()?;
                let disparities = pair.disparities.count;
                let all = f64::from(width) * f64::from(height) * f64::from(disparities);
                let stages: Vec<_> = Stage::ALL
                    .into_iter()
                    .zip(report.instructions)
                    .filter(|&(stage, _)| match request.hamming_alone {
                        true => stage == Stage::Hamming,
                        false => stage != Stage::Files,
                    })
                    .collect();
                let matching = stages.iter().filter(|(stage, _)| stage.is_matching());
                let total: u64 = matching.map(|&(_, instructions)| instructions).sum();
                let each = |instructions: u64| thousandths(instructions as f64 / all);
                bar.inc(1);
                Ok(Row {
                    scene: pair.name,
                    board: board.full_name(),
                    preset: match request.hamming_alone {
                        true => HAMMING,
                        false => request.preset.name(),
                    },
                    is_rectified: pair.rectification.is_some(),
                    is_scanned: request.scan.is_some(),
                    width,
                    height,
                    disparities,
                    counted: match board.simulation {
                        Some(_) => "cycles",
                        None => "instructions",
                    },
                    instructions_per_pixel_disparity: each(total),
                    stages: stages.iter().map(|&(s, n)| (s.name(), each(n))).collect(),
                    static_ram_bytes: sizes.statics_bytes + u64::from(report.working_bytes),
                    stack_bytes: report.stack_bytes,
                    flash_bytes: sizes.flash_bytes,
                })
            })
            .collect();
        bar.finish_and_clear();
        let boards = rows?;
        if self.json {
            return Ok(format!("{}\n", serde_json::to_string(&Rows { boards })?));
        }
        Ok(as_text(&boards))
    }
}

/// Runs a board with its costs counted, and returns its report.
fn counted(board: &Board, firmware: &Path, pair: &Pair, request: &Request) -> Result<Report> {
    if board.simulation.is_some() {
        let program = simulation::build(board)?;
        let scenario = Scenario::default();
        let ran = simulation::run(board, &program, firmware, pair, request, &scenario)?;
        return Ok(ran.report);
    }
    let clock = Clock::Instructions;
    let (_, report) = emulator::run(board, firmware, pair, request, clock)?;
    Ok(report)
}

/// Returns the pairs and requests that a board is measured with unless images are named: those of [`CASES`]
/// and [`SPECIAL`].
fn built_in(board: &Board) -> Result<Vec<(Pair, Request)>> {
    let mut tasks = Vec::new();
    for &(of, width, height, disparities, presets) in &CASES {
        if of.name == board.name {
            let pair = Pair::rendered(width, height, disparities);
            let presets = presets.iter().map(|&preset| (preset, false));
            for (preset, hamming_alone) in presets.chain([(Preset::Lite, true)]) {
                let request = Request {
                    hamming_alone,
                    ..pair.request(preset, 1, &[])?
                };
                tasks.push((pair.clone(), request));
            }
        }
    }
    let (of, width, height, disparities, preset) = SPECIAL;
    if of.name == board.name {
        let pair = Pair::rendered(width.into(), height.into(), disparities);
        let request = Request {
            scan: pair.scan(),
            ..pair.request(preset, 1, &[])?
        };
        tasks.push((pair, request));
        let pair = Pair::crooked(width, height, disparities, false)?;
        let request = pair.request(preset, 1, &[])?;
        tasks.push((pair, request));
    }
    Ok(tasks)
}

/// A pair with every preset for which this memory, bytes, is large enough.
fn fitting(pair: &Pair, lent_bytes: usize) -> Result<Vec<(Pair, Request)>> {
    let mut tasks = Vec::new();
    for preset in Preset::ALL {
        let request = pair.request(preset, 1, &[])?;
        if request.working_bytes() <= lent_bytes {
            tasks.push((pair.clone(), request));
        }
    }
    Ok(tasks)
}

/// Instructions per pixel of the resampling of both views, in the first case that has it.
fn per_pixel(rows: &[Row]) -> String {
    let row = rows.iter().find(|row| row.is_rectified);
    let each = row.and_then(|row| {
        let mut stages = row.stages.iter();
        let (_, each) = stages.find(|(name, _)| *name == Stage::Rectification.name())?;
        Some(each * f64::from(row.disparities))
    });
    each.map_or_else(|| "no".to_owned(), |each| format!("{each:.1}"))
}

fn thousandths(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

fn as_text(rows: &[Row]) -> String {
    let header = [
        "board",
        "preset",
        "size",
        "total",
        "rectifi-\ncation",
        "sampling",
        "masks",
        "Hamming",
        "aggre-\ngation",
        "selec-\ntion",
        "surfaces,\nmedians",
        "checks,\nrest",
        "link",
        "per line",
        "RAM KiB",
        "stack KiB",
        "flash KiB",
    ];
    let mut table = table(&header, 3);
    for row in rows {
        let per_line = row.instructions_per_pixel_disparity
            * f64::from(row.width)
            * f64::from(row.disparities);
        let mut cells = vec![
            row.board.clone(),
            match (row.is_rectified, row.is_scanned) {
                (true, _) => format!("{}, raw", row.preset),
                (_, true) => format!("{}, scan", row.preset),
                _ => row.preset.to_owned(),
            },
            format!("{}x{}x{}", row.width, row.height, row.disparities),
            format!("{:.1}", row.instructions_per_pixel_disparity),
        ];
        for stage in Stage::ALL.iter().filter(|&&stage| stage != Stage::Files) {
            let counted = row.stages.iter().find(|(name, _)| *name == stage.name());
            cells.push(counted.map_or_else(String::new, |(_, each)| format!("{each:.1}")));
        }
        let kib = |bytes: u64| usize::try_from(bytes).map_or_else(|_| String::new(), kib);
        cells.extend([
            format!("{per_line:.0}"),
            kib(row.static_ram_bytes),
            kib(row.stack_bytes.into()),
            kib(row.flash_bytes),
        ]);
        table.add_row(cells);
    }
    let counted = match rows {
        [
            Row {
                counted: "cycles", ..
            },
            ..,
        ] => "cycles",
        _ => "instructions (not cycles)",
    };
    format!(
        "{table}\n{counted} per pixel and disparity, in all and per stage; link: besides, to pack, \
         frame and check the disparities for the host; {}, grey; scan: with a laser scan of 60 bearings; raw: lines that are rectified first, {} instructions per \
         pixel for resampling both views\n",
        rows.first().map_or("", |row| row.scene.as_str()),
        per_pixel(rows)
    )
}
