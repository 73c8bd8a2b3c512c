//! The options of `vgstereo match`, for one pair and for many.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use vgstereo_core::{DisparityRange, Preset, Reference};

use crate::arguments::{Overrides, ScanOptions, parse_preset};
use crate::cameras::CameraOptions;
use crate::images::parse_bits;
use crate::line_offsets::ViewOffsets;

/// The largest disparity that is searched when `--d-max` is not given, px.
const DEFAULT_D_MAX: u16 = 63;

/// What is searched for and what is written.
#[derive(Debug, Args)]
pub(super) struct Options {
    /// Disparity map to write; of many pairs with {} in the name: .png or .pgm (value = disparity x scale, 0 = none), .pfm (px,
    /// infinity = none), or - for a PFM on standard output.
    #[arg(long, value_name = "FILE")]
    pub(super) out: PathBuf,
    /// Largest disparity to search, px, smaller than the width [default: 63, or what the
    /// width allows].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub(super) d_max: Option<i16>,
    /// Smallest disparity to search, px; may be negative.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        allow_negative_numbers = true
    )]
    pub(super) min_disparity: i16,
    /// Preset; `vgstereo presets` lists them.
    #[arg(long, value_name = "P", default_value_t = Preset::Balanced, value_parser = parse_preset)]
    pub(super) preset: Preset,
    /// The view that gets the disparities.
    #[arg(long, value_enum, default_value_t = View::Left)]
    pub(super) reference: View,
    /// Steps per px in a .png or .pgm, which states them too. Below 256, values have 8 bits where the
    /// range fits them, else 16 [default: 256 in 16 bits, as KITTI has, or the largest power of two
    /// that fits].
    #[arg(long, value_name = "S")]
    pub(super) scale: Option<f32>,
    /// Also write the map in colours, as PNG.
    #[arg(long, alias = "color", value_name = "FILE")]
    pub(super) colour: Option<PathBuf>,
    /// Also write the depth along the optical axis: .png (mm, 16 bits, 0 = none) or .pfm (m, NaN = none);
    /// needs --calibration, or --focal and --baseline.
    #[arg(long, value_name = "FILE")]
    pub(super) depth: Option<PathBuf>,
    /// Also write the cloud of points that the reference view shows: .ply or .pcd, binary, in
    /// metres, x right, y down, z forward, up to 32 m to the sides and 65 m away. Each pixel has a
    /// point, row by row, NaN = none, with its colour and confidence; needs the cameras' numbers as
    /// --depth does.
    #[arg(long, value_name = "FILE")]
    pub(super) points: Option<PathBuf>,
    /// Also write the confidence of each disparity, as PNG: 1 to 255, 0 where it was filled in or there
    /// is none.
    #[arg(long, value_name = "FILE")]
    pub(super) confidence: Option<PathBuf>,
    /// Also write the rectified views into this folder, as left.png and right.png.
    #[arg(long, value_name = "DIR", requires = "calibration")]
    pub(super) rectified: Option<PathBuf>,
    /// Match the grey of colour images.
    #[arg(long)]
    pub(super) grey: bool,
    /// Bits that images of 16 bits use, 8 to 16, such as 12 for a camera of 12 bits [default: as many as
    /// the largest level of the pair has].
    #[arg(long, value_name = "N", value_parser = parse_bits)]
    pub(super) bits: Option<u8>,
    /// Leave out disparities that were filled in rather than found.
    #[arg(long)]
    pub(super) sparse: bool,
    /// What is known of how the other view's lines lie: PX,DEGREES,PERCENT, by how much they lie too low in the
    /// middle, fall to the right, and are too far apart; `match` tells it. The SGM presets learn it by themselves
    /// within some lines, and are right from the first line on if they begin with it.
    #[arg(long, value_name = "PX,DEG,%", allow_hyphen_values = true)]
    pub(super) line_offsets: Option<ViewOffsets>,
    /// Do not look for what may be wrong with the pair: views exchanged, lines off, a search range
    /// that is too small.
    #[arg(long)]
    pub(super) no_check: bool,
    /// Threads; the maps do not depend on their number. Of many pairs, each matches one at a time; on
    /// one pair, the SGM presets take at most 2.
    #[arg(long, value_name = "N", default_value = "1")]
    pub(super) threads: NonZeroUsize,
    /// Print what became of many pairs as JSON.
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    pub(super) scan: ScanOptions,
    #[command(flatten)]
    pub(super) cameras: CameraOptions,
    #[command(flatten)]
    pub(super) overrides: Overrides,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(super) enum View {
    Left,
    Right,
}

impl From<View> for Reference {
    fn from(view: View) -> Self {
        match view {
            View::Left => Self::Left,
            View::Right => Self::Right,
        }
    }
}

impl Options {
    /// The files that are read besides the images.
    pub(super) fn other_inputs(&self) -> Vec<&Path> {
        let config = self.overrides.config.as_deref().into_iter();
        config.chain(self.cameras.files()).collect()
    }

    /// Returns the disparities to search in lines of `width` px.
    pub(super) fn disparities(&self, width: u16) -> Result<DisparityRange> {
        let widest = i32::from(width) - 1;
        let d_max = match self.d_max {
            Some(d_max) => i32::from(d_max),
            None => i32::from(DEFAULT_D_MAX)
                .min(widest)
                .max(self.min_disparity.into()),
        };
        ensure!(
            d_max <= widest,
            "--d-max {d_max} is not smaller than the width of {width} px"
        );
        let minimum = i32::from(self.min_disparity);
        ensure!(
            minimum <= d_max,
            "--min-disparity {minimum} is larger than the largest disparity, {d_max}"
        );
        let range = DisparityRange {
            minimum_px: self.min_disparity,
            count: u16::try_from(d_max - minimum + 1)?,
        };
        ensure!(
            range.fits(width),
            "disparities from {minimum} to {d_max} do not fit a width of {width} px (2047 px at most)"
        );
        Ok(range)
    }
}
