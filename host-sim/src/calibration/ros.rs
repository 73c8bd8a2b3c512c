//! Pairs of ROS's `camera_info` files: a camera each, rectified rather than related to the other.

use anyhow::{Context, Result, anyhow, ensure};
use glam::DMat3;
use serde::Serialize;

use super::camera::Camera;
use super::document::{Document, Entry};
use super::lens::{Lens, Model};
use super::stereo::{StereoCalibration, StoredRectification, rotation};

/// Whether a file is one of ROS.
pub(super) fn is_known(document: &Document) -> bool {
    let root = document.root();
    root.get("distortion_model").is_some()
        && (root.get("projection_matrix").is_some() || root.get("P").is_some())
}

/// Reads the files of the left and the right camera.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub(super) fn read(documents: [&Document; 2]) -> Result<StereoCalibration> {
    let [left, right] = documents;
    let (left_camera, left_rotation, left_projection) = camera(left)?;
    let (right_camera, right_rotation, right_projection) = camera(right)?;
    let stored = StoredRectification {
        rotations: [left_rotation, right_rotation],
        projections: [left_projection, right_projection],
    };
    let (rotation, translation) = stored.motion();
    Ok(StereoCalibration {
        format: "ROS camera_info",
        cameras: [left_camera, right_camera],
        rotation,
        translation,
        unit_mm: Some(1000.0),
        stored: Some(stored),
        warnings: Vec::new(),
    })
}

/// Reads a camera, its rotation to the rectified view, and the projection of that.
fn camera(document: &Document) -> Result<(Camera, glam::DMat3, [f64; 12])> {
    let root = document.root();
    // In files, and in messages that were recorded.
    let entry = |long: &str, short: &str| -> Result<Entry<'_>> {
        root.get(long)
            .or_else(|| root.get(short))
            .ok_or_else(|| anyhow!("{}: the file has no {long}", document.name))
    };
    let model = root.require("distortion_model")?;
    let coefficients = entry("distortion_coefficients", "D")?;
    let name = model.text().unwrap_or_default();
    let lens = coefficients.within(Lens::named(name, &coefficients.list()?))?;
    let size = match root.size_of("image_width", "image_height")? {
        Some(size) => Some(size),
        None => root.size_of("width", "height")?,
    };
    let matrix = entry("camera_matrix", "K")?;
    let camera = matrix.within(Camera::from_matrix(matrix.numbers()?, lens, size))?;
    let turned = entry("rectification_matrix", "R")?;
    let turned = turned.within(rotation(turned.numbers()?))?;
    let projection = entry("projection_matrix", "P")?;
    let numbers: [f64; 12] = projection.numbers()?;
    ensure!(
        numbers[0] > 0.0,
        projection.error("has no focal length: the cameras are not calibrated")
    );
    for key in ["binning_x", "binning_y"] {
        if let Some(entry) = root.get(key) {
            let [binning] = entry.numbers()?;
            ensure!(
                binning <= 1.0,
                "{}: {key} is {binning}: the file is of binned pictures: calibrate the size that is used",
                document.name
            );
        }
    }
    Ok((camera, turned, numbers))
}

/// A `camera_info` file.
#[derive(Debug, Serialize)]
struct CameraInfo {
    image_width: u16,
    image_height: u16,
    camera_name: &'static str,
    camera_matrix: Matrix,
    distortion_model: &'static str,
    distortion_coefficients: Matrix,
    rectification_matrix: Matrix,
    projection_matrix: Matrix,
}

#[derive(Debug, Serialize)]
struct Matrix {
    rows: usize,
    cols: usize,
    data: Vec<f64>,
}

impl Matrix {
    fn new(rows: usize, data: Vec<f64>) -> Self {
        let cols = data.len() / rows;
        Self { rows, cols, data }
    }
}

/// Returns the `camera_info` files, YAML, of the left and the right camera.
///
/// # Errors
/// Fails with the reason when the calibration has no rectification, no unit or no size.
pub fn camera_infos(calibration: &StereoCalibration) -> Result<[String; 2]> {
    let stored = calibration.stored.context("there is no rectification")?;
    let unit_mm = calibration.unit_mm.context("the unit is not known")?;
    let info = |view: usize| -> Result<String> {
        let camera = &calibration.cameras[view];
        let [image_width, image_height] = camera.size.context("the size is not known")?;
        let (distortion_model, coefficients) = match camera.lens.model() {
            Model::RadialTangential(k) if k[5..].iter().all(|&k| k == 0.0) => {
                ("plumb_bob", k[..5].to_vec())
            }
            Model::RadialTangential(k) => ("rational_polynomial", k.to_vec()),
            Model::Equidistant(k) => ("equidistant", k.to_vec()),
        };
        let (focal, principal) = (camera.focal_px, camera.principal_px);
        let matrix = vec![
            focal.x,
            0.0,
            principal.x,
            0.0,
            focal.y,
            principal.y,
            0.0,
            0.0,
            1.0,
        ];
        let mut projection = stored.projections[view].to_vec();
        // The offset is in m.
        for column in [3, 7, 11] {
            projection[column] *= unit_mm / 1000.0;
        }
        Ok(serde_saphyr::to_string(&CameraInfo {
            image_width,
            image_height,
            camera_name: ["left", "right"][view],
            camera_matrix: Matrix::new(3, matrix),
            distortion_model,
            distortion_coefficients: Matrix::new(1, coefficients),
            rectification_matrix: Matrix::new(3, row_major(stored.rotations[view])),
            projection_matrix: Matrix::new(3, projection),
        })?)
    };
    Ok([info(0)?, info(1)?])
}

fn row_major(matrix: DMat3) -> Vec<f64> {
    matrix.transpose().to_cols_array().to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::read::read as read_files;
    use crate::render::{RenderOptions, render_distorted};

    #[test]
    fn what_is_written_is_read() {
        let (_, written) = render_distorted(&RenderOptions {
            width: 64,
            height: 48,
            d_max: 8,
            ..RenderOptions::default()
        })
        .unwrap();
        let [left, right] = camera_infos(&written).unwrap();
        let files = [("right.yaml", right), ("left.yaml", left)];
        let files = files.map(|(name, text)| (name.to_owned(), text.into_bytes()));
        let read = read_files(&files).unwrap();
        assert_eq!(read.cameras, written.cameras);
        assert_eq!(read.unit_mm, Some(1000.0));
        assert!(read.rotation.abs_diff_eq(written.rotation, 1e-9));
        let translation_mm = read.translation * 1000.0;
        assert!(translation_mm.abs_diff_eq(written.translation, 1e-6));
        let without = StereoCalibration {
            unit_mm: None,
            ..written
        };
        assert!(camera_infos(&without).is_err());
    }
}
