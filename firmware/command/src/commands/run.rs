//! `cargo firmware run`: runs an emulated board on a pair of images.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use vgstereo_core::geometry::{LaserScan, Scan, ScanConfig};
use vgstereo_emulated::Report;
use vgstereo_emulated::request::ScanRequest;
use vgstereo_sim::arguments::ScanOptions;
use vgstereo_sim::disparity_files::DisparityFormat;
use vgstereo_sim::files::{ensure_distinct_outputs, write_files};
use vgstereo_sim::scan_files::ScanFormat;

use super::selection::{SoftCore, parse_executed_board};
use super::source::{Source, ensure_fits};
use crate::board::{Board, Model};
use crate::build::build;
use crate::emulator::{self, Clock};
use crate::host::Frames;
use crate::model::{self, Scenario};
use crate::pair::Pair;
use crate::simulation;
use crate::toolchain::ensure_complete;

/// The arguments of `run`.
#[derive(Debug, Args)]
#[command(
    after_help = "Without images, the built-in scene at 160x120 px. A fault is FRAME:LINE:KIND, \
    the first frame being 0: dropped-line, duplicated-line, lost-sync, truncated, \
    duplicated-frame, overrun, sync-error, short-line, short-frame, timeout, bus-error, \
    other-error.\n\nThe firmware of stm32h743 runs as it is flashed, on a model of the chip: lite \
    at 320x240 px in grey with 48 disparities, and faults overrun, short-line, short-frame and \
    timeout, one in a frame.\n\nThe RTL of softcore is simulated with its firmware: lite in grey, at most 160 columns, and \
    at the pins of its cameras the faults dropped-line, lost-sync, truncated, overrun, short-line and \
    timeout.\n\nExample: cargo firmware run --board stm32f405 --scene teddy --preset micro \
    --fault 0:20:overrun --out disparity.png"
)]
pub struct Run {
    /// The board: stm32f405, mps2-an500, mps3-an547, riscv-virt, riscv-virt-zbb, stm32h743 or softcore.
    #[arg(long, value_name = "B", value_parser = parse_executed_board)]
    board: Board,
    #[command(flatten)]
    soft_core: SoftCore,
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    scan: ScanOptions,
    /// Whole frames to wait for; the last one is written.
    #[arg(long, value_name = "N", default_value_t = 1)]
    frames: u32,
    /// Disparity map to write: .png or .pgm (value = disparity x scale, 0 = none), or .pfm
    /// (px, infinity = none).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

impl Run {
    /// Runs the board, writes the disparity map and returns the text to print.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn run(mut self) -> Result<String> {
        self.board = self.soft_core.applied(self.board);
        ensure!(self.frames > 0, "--frames must be at least 1");
        let pair = self.source.pair(&self.board)?;
        let format = DisparityFormat::choose(&self.out, None, pair.disparities)?;
        if let Some(model) = self.board.model {
            return self.run_modelled(&model, &pair, format);
        }
        if self.board.simulation.is_some() {
            self.board = self.board.alone(self.source.preset)?;
            return self.run_simulated(&pair, format);
        }
        let mut request = pair.request(self.source.preset, self.frames, &self.source.faults)?;
        let scan = match &self.scan.scan {
            Some(path) => {
                ensure_distinct_outputs(&[], &[&self.out, path]).context("--out, --scan")?;
                let format = ScanFormat::choose(path)?;
                let (camera, pitch_rad) = pair
                    .camera
                    .context("--scan needs --calibration, or the built-in scene")?;
                let config = self.scan.config(camera, request.width(), pitch_rad);
                request.scan = Some(ScanRequest::new(&config));
                let mut memory = vec![0; LaserScan::words(config.bearings, config.lines_min)];
                LaserScan::new(&config, &mut memory).context("--scan")?;
                Some((path, format, config))
            }
            None => None,
        };
        request.config().validate()?;
        ensure_complete(&[self.board])?;
        let firmware = build(&self.board)?;
        ensure_fits(&self.board, &firmware, &pair, &request)?;
        let ran = emulator::run_logged(&self.board, &firmware, &pair, &request, Clock::Host)?;
        let (frames, report, log) = ran;
        let width = request.width().into();
        let all_q4 = frames.disparities_q4();
        let pixels = all_q4.len() / self.frames as usize;
        let last_q4 = all_q4.chunks_exact(pixels.max(1)).last();
        let last_q4 = last_q4.with_context(|| format!("{} gave no frame", self.board.name))?;
        let mut files = vec![(self.out.as_path(), format.encode(last_q4, width)?)];
        if let Some((path, format, config)) = &scan {
            let (last, depth) = (LastScan::of(&frames, config)?, config.camera.depth());
            let bytes = format.encode(&last.scan(), &depth, pair.disparities)?;
            files.push((path.as_path(), bytes));
        }
        write_files(&files)?;
        let mut text = format!(
            "{}: {} on {} {}, {} bytes of working memory, {} bytes of stack\n",
            self.board.name,
            self.source.preset,
            pair.name,
            pair.size(),
            report.working_bytes,
            report.stack_bytes
        );
        for line in log {
            writeln!(text, "{line}")?;
        }
        for (name, count) in report.counters().filter(|&(_, count)| count > 0) {
            writeln!(text, "{name} {count}")?;
        }
        for (path, _) in &files {
            writeln!(text, "wrote {}", path.display())?;
        }
        Ok(text)
    }

    /// Runs the firmware of a board in RTL.
    fn run_simulated(&self, pair: &Pair, format: DisparityFormat) -> Result<String> {
        let name = self.board.name;
        ensure!(
            self.scan.scan.is_none(),
            "--scan: the firmware of {name} sends disparities"
        );
        let request = pair.request(self.source.preset, self.frames, &[])?;
        let scenario = simulation::Scenario::of(&self.source.faults)?;
        simulation::ensure_built_for(&self.board, &request)?;
        request.config().validate()?;
        ensure_complete(&[self.board])?;
        let (program, firmware) = (simulation::build(&self.board)?, build(&self.board)?);
        ensure_fits(&self.board, &firmware, pair, &request)?;
        let ran = simulation::run(&self.board, &program, &firmware, pair, &request, &scenario)?;
        let all_q4 = ran.frames.disparities_q4();
        let pixels = all_q4.len() / self.frames as usize;
        let last_q4 = all_q4.chunks_exact(pixels.max(1)).last();
        let last_q4 = last_q4.with_context(|| format!("{name} gave no frame"))?;
        write_files(&[(&self.out, format.encode(last_q4, pair.left.width())?)])?;
        let Report {
            working_bytes,
            stack_bytes,
            ..
        } = ran.report;
        let mut text = format!(
            "{name}: {} on {} {}, {} cycles, {working_bytes} bytes of working memory, {stack_bytes} bytes of stack\n",
            self.source.preset,
            pair.name,
            pair.size(),
            ran.cycles
        );
        for (name, count) in ran.report.counters().filter(|&(_, count)| count > 0) {
            writeln!(text, "{name} {count}")?;
        }
        writeln!(text, "wrote {}", self.out.display())?;
        Ok(text)
    }

    /// Runs a real board's firmware on the model of its chip.
    fn run_modelled(
        &self,
        built_for: &Model,
        pair: &Pair,
        format: DisparityFormat,
    ) -> Result<String> {
        ensure!(
            self.scan.scan.is_none(),
            "--scan: the firmware of {} sends disparities",
            self.board.name
        );
        ensure!(
            self.source.preset == built_for.preset,
            "the firmware of {} is built for {}",
            self.board.name,
            built_for.preset
        );
        model::expected(built_for, pair)?;
        let faults = u32::try_from(self.source.faults.len())?;
        let scenario = Scenario {
            // A fault costs the frame that it strikes.
            frames: self.frames.saturating_add(faults),
            faults: self.source.faults.clone(),
            until_ms: u64::MAX / 1_000_000,
            ..Scenario::default()
        };
        scenario.validate()?;
        ensure_complete(&[self.board])?;
        let (program, firmware) = (model::build(&self.board)?, build(&self.board)?);
        let ran = model::run(&program, &firmware, pair, &scenario)?;
        let taken = ran.report.ensure_all_accesses_taken();
        taken.context(self.board.name)?;
        let last = ran.frames.iter().rfind(|frame| frame.is_whole);
        let last = last.with_context(|| format!("{} gave no frame", self.board.name))?;
        let values = last.disparities.as_chunks().0.iter();
        let last_q4: Vec<i16> = values.map(|&bytes| i16::from_le_bytes(bytes)).collect();
        write_files(&[(&self.out, format.encode(&last_q4, pair.left.width())?)])?;
        let model::Report {
            time_ms,
            instructions,
            meals,
            longest_hunger_ms,
            resets,
            ..
        } = &ran.report;
        let name = self.board.name;
        let whole = ran.frames.iter().filter(|frame| frame.is_whole).count();
        let broken = ran.frames.len() - whole;
        let mut text = format!(
            "{name}: {whole} whole frames, {broken} broken, in {time_ms} ms of the board's time\n\
             {instructions} instructions; watchdog fed {meals} times, longest wait \
             {longest_hunger_ms} ms; {} restarts; no access refused\n",
            resets.len()
        );
        for line in &ran.log {
            writeln!(text, "{line}")?;
        }
        for reset in resets {
            writeln!(text, "restart: {reset}")?;
        }
        writeln!(text, "wrote {}", self.out.display())?;
        Ok(text)
    }
}

/// The scan of the last frame.
struct LastScan {
    angles_rad: [f32; 2],
    ranges_mm: Vec<u16>,
    range_max_mm: u16,
}

impl LastScan {
    fn of(frames: &Frames, config: &ScanConfig) -> Result<Self> {
        let bytes = 8 + 2 * usize::from(config.bearings);
        let last = frames.scans.rchunks_exact(bytes).next();
        let (angles, ranges) = last
            .and_then(|last| last.split_at_checked(8))
            .context("the board gave no scan")?;
        let angles = angles.as_chunks().0.iter();
        let mut angles = angles.map(|&bytes| f32::from_le_bytes(bytes));
        let ranges = ranges.as_chunks().0.iter();
        Ok(Self {
            angles_rad: std::array::from_fn(|_| angles.next().unwrap_or_default()),
            ranges_mm: ranges.map(|&bytes| u16::from_le_bytes(bytes)).collect(),
            range_max_mm: config.range_max_mm,
        })
    }

    fn scan(&self) -> Scan<'_> {
        let [bearing_min_rad, bearing_step_rad] = self.angles_rad;
        Scan {
            ranges_mm: &self.ranges_mm,
            bearing_min_rad,
            bearing_step_rad,
            range_max_mm: self.range_max_mm,
        }
    }
}
