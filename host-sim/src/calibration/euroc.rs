//! Pairs of `sensor.yaml` files, as the `EuRoC` data set has them: a camera each, placed on a common body.

use anyhow::Result;

use super::camera::Camera;
use super::document::Document;
use super::lens::Lens;
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

fn camera(document: &Document) -> Result<Camera> {
    let root = document.root();
    let model = root.require("camera_model")?;
    model.within(Lens::ensure_pinhole(model.text().unwrap_or_default()))?;
    let distortion = root.require("distortion_model")?;
    let coefficients = root.require("distortion_coefficients")?.list()?;
    let lens = distortion.within(Lens::named(
        distortion.text().unwrap_or_default(),
        &coefficients,
    ))?;
    let intrinsics = root.require("intrinsics")?;
    let size = root.require("resolution")?.size()?;
    intrinsics.within(Camera::new(intrinsics.numbers()?, lens, Some(size)))
}
