//! `vgstereo demo --board`: pictures of a board of squares, to calibrate cameras by.

use std::path::Path;

use anyhow::{Context, Result};
use image::ImageFormat;

use crate::calibration::camera_infos;
use crate::escapes::shown;
use crate::files::{encode, make_folder, write_files};
use crate::render::{BoardPictures, RenderOptions, SQUARE_MM, SQUARES};
use crate::terminal::progress_bar;

/// Writes this number of pairs, and the calibration that is true, to a folder. Returns what to print.
///
/// # Errors
/// Fails with one line that names the option or file and the reason.
pub(super) fn write_board(folder: &Path, options: &RenderOptions, poses: u32) -> Result<String> {
    let pictures = BoardPictures::new(options)?;
    make_folder(folder)?;
    let [left, right] = camera_infos(&pictures.calibration)?;
    write_files(&[
        (folder.join("left.yaml"), left.into_bytes()),
        (folder.join("right.yaml"), right.into_bytes()),
    ])?;
    let bar = progress_bar(poses.into(), "pictures of the board");
    for pose in 0..poses {
        let views = pictures.render(pose);
        let views = views.context("--board: try a larger --width or a smaller --d-max")?;
        let mut files = Vec::new();
        for (side, view) in ["left", "right"].into_iter().zip(views) {
            let path = folder.join(format!("{side}_{:02}.png", pose + 1));
            files.push((path, encode(&view.into(), ImageFormat::Png)?));
        }
        write_files(&files)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let [columns, rows] = SQUARES.map(|squares| squares - 1);
    Ok(format!(
        "wrote {poses} pairs of a board with {columns} by {rows} inner corners and squares of {SQUARE_MM} mm \
         to {folder}, left_01.png and right_01.png first, and the true calibration, left.yaml and right.yaml\n",
        folder = shown(folder)
    ))
}
