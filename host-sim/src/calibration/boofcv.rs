//! Stereo calibrations of `BoofCV`.

use anyhow::{Result, ensure};
use glam::DVec3;

use super::camera::Camera;
use super::document::{Document, Entry};
use super::lens::Lens;
use super::stereo::{StereoCalibration, rotation};

/// Whether a file is one of `BoofCV`.
pub(super) fn is_known(document: &Document) -> bool {
    document.root().get("rightToLeft").is_some()
}

/// Reads a pair of cameras.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub(super) fn read(document: &Document) -> Result<StereoCalibration> {
    let root = document.root();
    let motion = root.require("rightToLeft")?;
    let turned = motion.require("rotation")?;
    let back = turned.within(rotation(turned.numbers()?))?.transpose();
    let moved = DVec3::new(
        number(&motion, "x")?,
        number(&motion, "y")?,
        number(&motion, "z")?,
    );
    Ok(StereoCalibration {
        format: "BoofCV",
        cameras: [
            camera(&root.require("left")?)?,
            camera(&root.require("right")?)?,
        ],
        // The file has the inverse: from the right camera to the left.
        rotation: back,
        translation: -(back * moved),
        unit_mm: None,
        stored: None,
        warnings: Vec::new(),
    })
}

fn camera(entry: &Entry<'_>) -> Result<Camera> {
    let model = entry.require("model")?;
    let name = model.text().unwrap_or_default();
    let pinhole = entry.require("pinhole")?;
    let lens = if name == "pinhole_radial_tangential" {
        let distortion = entry.require("radial_tangential")?;
        let radial = distortion.require("radial")?;
        let coefficients = radial.list()?;
        ensure!(
            coefficients.len() <= 3,
            radial.error("has more than 3 coefficients")
        );
        let k = |index: usize| coefficients.get(index).copied().unwrap_or(0.0);
        let tangential = [number(&distortion, "t1")?, number(&distortion, "t2")?];
        Lens::radial_tangential(&[k(0), k(1), tangential[0], tangential[1], k(2)])?
    } else {
        model.within(Lens::named(name, &[]))?
    };
    ensure!(
        number(&pinhole, "skew")? == 0.0,
        pinhole.error("has a skew, which is not supported")
    );
    let intrinsics = [
        number(&pinhole, "fx")?,
        number(&pinhole, "fy")?,
        number(&pinhole, "cx")?,
        number(&pinhole, "cy")?,
    ];
    let size = pinhole.size_of("width", "height")?;
    pinhole.within(Camera::new(intrinsics, lens, size))
}

/// The one number of the entry of this name below another.
fn number(entry: &Entry<'_>, key: &str) -> Result<f64> {
    let [number] = entry.require(key)?.numbers()?;
    Ok(number)
}
