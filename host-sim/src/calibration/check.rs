//! What is wrong with a calibration that could be read: refused, or mended with a warning.

use anyhow::{Result, bail, ensure};
use glam::{DMat3, DQuat, DVec2};

use super::stereo::StereoCalibration;

/// Baselines in mm that two cameras on one device have; beyond, the unit is another one.
const BASELINE_MM: std::ops::RangeInclusive<f64> = 2.0..=3000.0;

/// Checks a calibration against the size of the pictures, that of the files if `size` is `None`, and
/// returns it with warnings added, and the size.
///
/// Cameras whose views are exchanged are put into their order. A unit that makes the baseline
/// implausible is taken as unknown.
///
/// # Errors
/// Fails with all reasons when the sizes differ or are not known, a principal point lies outside the
/// picture, there is no baseline, or the cameras stand above each other.
pub fn checked(
    mut calibration: StereoCalibration,
    size: Option<[u16; 2]>,
) -> Result<(StereoCalibration, [u16; 2])> {
    let stated = calibration.cameras.map(|camera| camera.size);
    if let [Some(left), Some(right)] = stated {
        ensure!(
            left == right,
            "the left camera has {} pixels and the right one {}: they must be alike",
            text(left),
            text(right)
        );
    }
    let stated = stated[0].or(stated[1]);
    let Some(size) = size.or(stated) else {
        bail!("the files do not state the size of the pictures: give --size WIDTHxHEIGHT");
    };
    let mut reasons = Vec::new();
    if let Some(stated) = stated
        && stated != size
    {
        reasons.push(format!(
            "the files are of pictures of {}, and --size is {}: if the camera joins N by N pixels, give \
             --binned N",
            text(stated),
            text(size)
        ));
    } else {
        let whole = DVec2::new(size[0].into(), size[1].into());
        for (camera, side) in calibration.cameras.iter().zip(["left", "right"]) {
            let at = camera.principal_px;
            let place = format!(
                "the principal point of the {side} camera, {:.1}, {:.1},",
                at.x, at.y
            );
            if at.min_element() < 0.0 || at.x > whole.x || at.y > whole.y {
                reasons.push(format!(
                    "{place} lies outside pictures of {}: the calibration is of another resolution",
                    text(size)
                ));
            } else if ((at - 0.5 * whole) / whole).abs().max_element() > 0.2 {
                calibration.warnings.push(format!(
                    "{place} is far from the middle of pictures of {}: is the calibration of this \
                     resolution?",
                    text(size)
                ));
            }
        }
    }
    let baseline = calibration.translation.length();
    if baseline < 1e-9 {
        reasons.push(
            "the baseline is 0: the files are placeholders, the cameras were not calibrated as a pair"
                .to_owned(),
        );
    }
    ensure!(reasons.is_empty(), "{}", reasons.join("; "));
    let turn = DQuat::from_mat3(&calibration.rotation).to_scaled_axis();
    let between = DMat3::from_quat(DQuat::from_scaled_axis(turn * -0.5)) * calibration.translation;
    ensure!(
        between.x.abs() > between.y.abs() && between.x.abs() > between.z.abs(),
        "the cameras do not stand side by side: from the left to the right one it is {:.4}, {:.4}, {:.4} to \
         the right, down and ahead, in the unit of the files",
        -between.x,
        -between.y,
        -between.z
    );
    if between.x > 0.0 {
        calibration = calibration.exchanged();
        calibration.warnings.push(
            "left and right are exchanged: the files' right camera stands to the left of the other. Here \
             it is the left one; exchange the views as well"
                .to_owned(),
        );
    }
    if let Some(unit_mm) = calibration.unit_mm
        && !BASELINE_MM.contains(&(baseline * unit_mm))
    {
        calibration.warnings.push(format!(
            "a baseline of {baseline:.4} in units of {unit_mm} mm, as {} has them, is implausible: the unit is \
             taken as unknown; give it with --unit",
            calibration.format
        ));
        calibration.unit_mm = None;
    }
    Ok((calibration, size))
}

fn text([width, height]: [u16; 2]) -> String {
    format!("{width}x{height}")
}
