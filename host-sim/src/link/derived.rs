//! What follows from the disparities of a frame: depths and a laser scan, where the board sends none.

use vgstereo_core::DisparityLine;
use vgstereo_core::geometry::{LaserScan, RectifiedCamera, ScanConfig};

use super::board::{Frame, Scan};
use super::plane::Plane;

/// Bearings of a scan, at most.
const BEARINGS_MAX: u16 = 90;

/// The depths of a frame's disparities, mm; `None` where the board sent depths, or there are no
/// disparities.
#[must_use]
pub fn depths(frame: &Frame, camera: &RectifiedCamera) -> Option<Plane<u16>> {
    if frame.depths.is_some() {
        return None;
    }
    let disparities = frame.disparities.as_ref()?;
    let depths = disparities.converted(disparities.width, |disparities_q4, depths_mm| {
        camera.depth().line_mm(disparities_q4, depths_mm);
    });
    Some(depths)
}

/// The scan of a frame, as of `match --scan` without other options; `None` without disparities and
/// confidences, which tell what was found from what was filled in.
#[must_use]
pub fn scan(frame: &Frame, camera: &RectifiedCamera) -> Option<Scan> {
    let (disparities, confidences) = (frame.disparities.as_ref()?, frame.confidences.as_ref()?);
    let region = &frame.begun.region;
    let config = ScanConfig {
        camera: *camera,
        columns: region.x_px..region.x_px.checked_add(region.width_px)?,
        bearings: region.width_px.min(BEARINGS_MAX),
        pitch_rad: 0.0,
        heights_mm: -300..=300,
        range_max_mm: 20_000,
        lines_min: 3,
        confidence_min: 1,
    };
    let mut memory = vec![0; LaserScan::words(config.bearings, config.lines_min)];
    let mut scan = LaserScan::new(&config, &mut memory).ok()?;
    let width = disparities.width;
    let lines = disparities.values.chunks_exact(width);
    let lines = lines.zip(confidences.values.chunks_exact(width));
    for (line, (disparities_q4, confidences)) in (region.y_lines..).zip(lines) {
        scan.push(&DisparityLine {
            line,
            column: region.x_px,
            disparities_q4,
            confidences,
        });
    }
    let scan = scan.finish();
    Some(Scan {
        bearing_min_rad: scan.bearing_min_rad,
        bearing_step_rad: scan.bearing_step_rad,
        range_max_mm: scan.range_max_mm,
        ranges_mm: scan.ranges_mm.to_vec(),
    })
}
