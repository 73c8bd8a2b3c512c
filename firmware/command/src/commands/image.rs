//! `cargo firmware image`: what the memories of a board in RTL are loaded with.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use vgstereo_emulated::Request;

use super::images::Calibration;
use super::selection::{Alone, Selection};
use crate::board::Board;
use crate::build::build;
use crate::pair::Pair;
use crate::simulation::write_images;
use crate::toolchain::ensure_complete;

/// Columns, lines and disparities of the frames.
const FRAME: (u32, u32, u16) = (160, 120, 32);

/// The arguments of `image`.
#[derive(Debug, Args)]
pub struct Image {
    /// Folder for code.hex and data.hex, a line for each word.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Whole frames of 160x120 px and 32 disparities to match. Without this option the board sends frames for ever and
    /// takes the commands of the link.
    #[arg(long, value_name = "N")]
    frames: Option<u32>,
    #[command(flatten)]
    calibration: Calibration,
    #[command(flatten)]
    alone: Alone,
    #[command(flatten)]
    selection: Selection,
}

impl Image {
    /// Builds the firmware of the board in RTL and writes its image.
    ///
    /// # Errors
    /// Fails with one line that says what is missing, does not build or cannot be written, or that the board has no
    /// such memories.
    pub fn run(self) -> Result<String> {
        let boards = self.alone.of(self.selection.boards())?;
        let simulated = boards
            .into_iter()
            .find_map(|board: Board| Some((board, board.simulation?)));
        let (board, simulation) =
            simulated.context("the board's memories are not those of an FPGA")?;
        ensure_complete(&[board])?;
        let (width, height, disparities) = FRAME;
        let calibrated = self.calibration.pair(Some((width, height)), disparities)?;
        let pair = calibrated.unwrap_or_else(|| Pair::rendered(width, height, disparities));
        let request = match self.frames {
            Some(frames) => pair.request(simulation.preset, frames, &[])?,
            None => Request {
                camera: None,
                ..pair.live_request(simulation.preset, &[])?
            },
        };
        fs::create_dir_all(&self.out)
            .with_context(|| format!("cannot write {}", self.out.display()))?;
        let rectification = pair.rectification.as_deref();
        let firmware = build(&board)?;
        write_images(&board, &firmware, &request, rectification, &self.out)?;
        Ok(format!("{}\n", self.out.display()))
    }
}
