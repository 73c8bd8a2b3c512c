//! `vgstereo demo --board` and `--wall`: pictures of a board of squares, to calibrate cameras by, and of a wall,
//! to judge them by.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use image::{ImageFormat, RgbImage};

use crate::calibration::camera_infos;
use crate::escapes::shown;
use crate::files::{encode, make_folder, write_files};
use crate::render::{
    BoardPictures, RenderOptions, RenderedCameras, SQUARE_MM, SQUARES, render_wall,
    rendered_cameras,
};
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
        write_files(&pictures_of(folder, views, pose + 1)?)?;
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

/// Writes this number of pairs of a wall at this distance to a folder. Returns what to print.
///
/// # Errors
/// Fails with one line that names the option or file and the reason.
pub(super) fn write_wall(
    folder: &Path,
    options: &RenderOptions,
    distance_mm: f64,
    frames: u32,
) -> Result<String> {
    let cameras = rendered_cameras(options);
    let disparity_px = cameras.focal_px * cameras.baseline_mm / distance_mm;
    ensure!(
        disparity_px >= 1.0 && disparity_px <= options.d_max.into(),
        "--wall {distance_mm}: its disparity must be from 1 px to --d-max, {}",
        options.d_max
    );
    make_folder(folder)?;
    let bar = progress_bar(frames.into(), "pictures of the wall");
    for frame in 0..frames {
        let views = render_wall(options, distance_mm, [0.0, 0.0], frame);
        write_files(&pictures_of(folder, views, frame + 1)?)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let RenderedCameras {
        focal_px,
        baseline_mm,
        ..
    } = cameras;
    Ok(format!(
        "wrote {frames} pairs to {}, left_01.png and right_01.png first: --distance {distance_mm} --focal {focal_px} \
         --baseline {baseline_mm:.4}\n",
        shown(folder)
    ))
}

/// The files of a pair of pictures with this number.
fn pictures_of(
    folder: &Path,
    views: [RgbImage; 2],
    number: u32,
) -> Result<Vec<(std::path::PathBuf, Vec<u8>)>> {
    let sides = ["left", "right"].into_iter().zip(views);
    let files = sides.map(|(side, view)| {
        let path = folder.join(format!("{side}_{number:02}.png"));
        Ok((path, encode(&view.into(), ImageFormat::Png)?))
    });
    files.collect()
}
