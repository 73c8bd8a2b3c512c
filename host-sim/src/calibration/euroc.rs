//! Pairs of `sensor.yaml` files, as the `EuRoC` data set has them: a camera each, placed on a common body.

use anyhow::Result;

use super::camera::Camera;
use super::document::Document;
use super::stereo::{StereoCalibration, between, transformation};

/// Whether a file is one of a sensor.
pub(super) fn is_known(document: &Document) -> bool {
    document.root().get("T_BS").is_some()
}

/// Reads the files of the left and the right camera.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub(super) fn read(documents: [&Document; 2]) -> Result<StereoCalibration> {
    let [left, right] = documents;
    let placed = |document: &Document| {
        let place = document.root().require("T_BS")?;
        place.within(transformation(&place.numbers::<16>()?))
    };
    let camera =
        |document: &Document| Camera::from_entry(&document.root(), "distortion_coefficients");
    let (rotation, translation) = between([placed(left)?, placed(right)?], false);
    Ok(StereoCalibration {
        format: "EuRoC sensors",
        cameras: [camera(left)?, camera(right)?],
        rotation,
        translation,
        unit_mm: Some(1000.0),
        stored: None,
        warnings: Vec::new(),
    })
}
