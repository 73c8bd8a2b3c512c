//! The options of what a board sees and searches, which `run` and `live` take.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use clap::Args;
use vgstereo_core::{DisparityRange, Preset};
use vgstereo_emulated::Request;
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_firmware::scripted::{NotAFault, ScriptedFault};
use vgstereo_sim::arguments::parse_preset;

use super::images::Images;
use crate::board::Board;
use crate::elf::Sizes;
use crate::model;
use crate::pair::Pair;

/// The number of disparities that are searched unless a scene or `--d-max` states another.
const DEFAULT_DISPARITIES: u16 = 32;

/// The options of the verbs that run a board on a pair of images.
#[derive(Debug, Args)]
pub struct Source {
    #[command(flatten)]
    images: Images,
    /// Folder of a scene, as `vgstereo eval` reads them. A small board gets the scene in grey
    /// and half as large.
    #[arg(long, value_name = "DIR", conflicts_with_all = ["left", "calibration"])]
    scene: Option<PathBuf>,
    /// Preset; `vgstereo presets` lists them.
    #[arg(long, value_name = "P", default_value_t = Preset::Lite, value_parser = parse_preset)]
    pub preset: Preset,
    /// Largest disparity to search, px [default: 31, the scene's, or that of the real board].
    #[arg(long, value_name = "N")]
    d_max: Option<u16>,
    /// Send colour rather than grey [default for a scene on a board that is not small].
    #[arg(long)]
    colour: bool,
    /// Fault of the camera, FRAME:LINE:KIND. May be repeated.
    #[arg(long = "fault", value_name = "FAULT", value_parser = parse_fault)]
    pub faults: Vec<ScriptedFault>,
}

impl Source {
    /// Returns the scene or the images that the options name, or else the built-in scene, as this board
    /// is to search them.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn pair(&self, board: &Board) -> Result<Pair> {
        let mut pair = match &self.scene {
            Some(folder) => Pair::load(folder, board)?,
            None => self.without_scene(board)?,
        };
        if let Some(d_max) = self.d_max {
            pair.disparities = DisparityRange::up_to(d_max);
        }
        if self.colour {
            pair.format = PixelFormat::Rgb888;
        }
        Ok(pair)
    }

    fn without_scene(&self, board: &Board) -> Result<Pair> {
        let model = board.model;
        let disparities = model.map_or(DEFAULT_DISPARITIES, |built_for| built_for.disparities);
        let pair = self.images.pair(disparities)?;
        Ok(pair.unwrap_or_else(|| match &model {
            Some(built_for) => model::built_in_pair(built_for),
            None => Pair::rendered(160, 120, disparities),
        }))
    }
}

/// Checks that an emulated board has the memory that a request for a pair takes.
///
/// # Errors
/// Fails with one line that says how much it takes and how much there is.
pub fn ensure_fits(board: &Board, firmware: &Path, pair: &Pair, request: &Request) -> Result<()> {
    let (needed, lent) = (request.working_bytes(), Sizes::read(firmware)?.lent_bytes);
    ensure!(
        needed <= lent,
        "{} at {} takes {needed} bytes of memory, {} lends {lent}",
        request.preset,
        pair.size(),
        board.name
    );
    Ok(())
}

fn parse_fault(text: &str) -> Result<ScriptedFault, String> {
    text.parse().map_err(|error: NotAFault| error.to_string())
}
