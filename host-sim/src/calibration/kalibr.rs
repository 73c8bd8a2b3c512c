//! Camera chains of Kalibr, and those of `OpenVINS`, which have the motions to the inertial sensor instead.

use anyhow::{Result, ensure};

use super::camera::Camera;
use super::document::{Document, Entry};
use super::stereo::{StereoCalibration, between, transformation};

/// Whether a file is a chain.
pub(super) fn is_known(document: &Document) -> bool {
    document.root().get("cam0").is_some()
}

/// Reads a chain of two cameras.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub(super) fn read(document: &Document) -> Result<StereoCalibration> {
    let root = document.root();
    let cameras = [root.require("cam0")?, root.require("cam1")?];
    ensure!(
        root.get("cam2").is_none(),
        root.error("is of more than two cameras")
    );
    let [left, right] = &cameras;
    let (rotation, translation) = if let Some(motion) = right.get("T_cn_cnm1") {
        motion.within(transformation(&motion.numbers::<16>()?))?
    } else {
        let from_body = left.get("T_cam_imu").is_some();
        let key = if from_body { "T_cam_imu" } else { "T_imu_cam" };
        let motion = |camera: &Entry<'_>| {
            let motion = camera
                .get(key)
                .ok_or_else(|| camera.error("has neither T_cn_cnm1 nor T_cam_imu nor T_imu_cam"))?;
            motion.within(transformation(&motion.numbers::<16>()?))
        };
        between([motion(left)?, motion(right)?], from_body)
    };
    let camera = |entry| Camera::from_entry(entry, "distortion_coeffs");
    Ok(StereoCalibration {
        format: "Kalibr",
        cameras: [camera(left)?, camera(right)?],
        rotation,
        translation,
        unit_mm: Some(1000.0),
        stored: None,
        warnings: Vec::new(),
    })
}
