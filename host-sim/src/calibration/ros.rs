//! Pairs of ROS's `camera_info` files: a camera each, rectified rather than related to the other.

use anyhow::{Result, anyhow, ensure};

use super::camera::Camera;
use super::document::{Document, Entry};
use super::lens::Lens;
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
