//! Laser scans as files.

use std::path::Path;

use anyhow::{Result, bail};
use image::{ImageFormat, Rgb, RgbImage};
use serde::Serialize;
use vgstereo_core::DisparityRange;
use vgstereo_core::disparity::px_to_q4;
use vgstereo_core::geometry::{Depth, Scan};

use crate::escapes::shown;
use crate::files::encode;

/// Side of the plan view, px.
const PLAN_PX: u32 = 512;

/// How scans are stored in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScanFormat {
    /// YAML with the fields of ROS's `sensor_msgs/LaserScan`: rad and m, NaN where nothing was seen.
    Yaml,
    /// A PNG of the plan view: the camera in the middle of the lower edge, what is free before it, and
    /// what stands there.
    Png,
}

impl ScanFormat {
    /// Chooses the format by the ending of a file's name.
    ///
    /// # Errors
    /// Fails with one line that names the file when it is neither `.yaml` nor `.png`.
    pub fn choose(path: &Path) -> Result<Self> {
        match path.extension().map(|ending| ending.to_ascii_lowercase()) {
            Some(ending) if ending == "yaml" || ending == "yml" => Ok(Self::Yaml),
            Some(ending) if ending == "png" => Ok(Self::Png),
            _ => bail!(
                "{}: the name of a scan ends in .yaml (as ROS's LaserScan) or .png (plan view)",
                shown(path)
            ),
        }
    }

    /// Returns the bytes of a file with a scan, made of disparities in this range by this conversion:
    /// the smallest range that could have been seen is the depth of the largest, straight ahead.
    ///
    /// # Errors
    /// Fails when the file cannot be encoded.
    pub fn encode(
        self,
        scan: &Scan<'_>,
        depth: &Depth,
        disparities: DisparityRange,
    ) -> Result<Vec<u8>> {
        match self {
            Self::Yaml => {
                let last_px = i16::try_from(disparities.range_px().end - 1)?;
                let message = LaserScanMessage::new(scan, depth.mm(px_to_q4(last_px)));
                Ok(serde_saphyr::to_string(&message)?.into_bytes())
            }
            Self::Png => encode(&plan(scan).into(), ImageFormat::Png),
        }
    }
}

/// The fields of `sensor_msgs/LaserScan`, in their order. Times are those of a single image.
#[derive(Debug, Serialize)]
struct LaserScanMessage {
    header: Header,
    angle_min: f32,
    angle_max: f32,
    angle_increment: f32,
    time_increment: f32,
    scan_time: f32,
    range_min: f32,
    range_max: f32,
    ranges: Vec<f32>,
    intensities: Vec<f32>,
}

#[derive(Debug, Serialize)]
struct Header {
    stamp: Stamp,
    frame_id: &'static str,
}

#[derive(Debug, Serialize)]
struct Stamp {
    sec: i32,
    nanosec: u32,
}

impl LaserScanMessage {
    fn new(scan: &Scan<'_>, range_min_mm: u16) -> Self {
        let metres = |mm: u16| f32::from(mm) / 1000.0;
        let last = scan.ranges_mm.len().saturating_sub(1) as f32;
        let range = |&mm: &u16| if mm == 0 { f32::NAN } else { metres(mm) };
        Self {
            header: Header {
                stamp: Stamp { sec: 0, nanosec: 0 },
                frame_id: "left_camera",
            },
            angle_min: scan.bearing_min_rad,
            angle_max: scan.bearing_min_rad + last * scan.bearing_step_rad,
            angle_increment: scan.bearing_step_rad,
            time_increment: 0.0,
            scan_time: 0.0,
            range_min: metres(range_min_mm),
            range_max: metres(scan.range_max_mm),
            ranges: scan.ranges_mm.iter().map(range).collect(),
            intensities: Vec::new(),
        }
    }
}

/// Draws the plan view. Its height is the largest range seen and a tenth more.
fn plan(scan: &Scan<'_>) -> RgbImage {
    const OUTSIDE: Rgb<u8> = Rgb([255, 255, 255]);
    const UNKNOWN: Rgb<u8> = Rgb([205, 205, 205]);
    const FREE: Rgb<u8> = Rgb([236, 246, 236]);
    const OBSTACLE: Rgb<u8> = Rgb([200, 30, 30]);
    let furthest_mm = scan.ranges_mm.iter().copied().max().unwrap_or(0).max(100);
    let mm_per_px = f64::from(furthest_mm) * 1.1 / f64::from(PLAN_PX);
    let right_rad = f64::from(scan.bearing_min_rad) - 0.5 * f64::from(scan.bearing_step_rad);
    RgbImage::from_fn(PLAN_PX, PLAN_PX, |x, y| {
        let ahead_px = f64::from(PLAN_PX - y) - 0.5;
        let left_px = f64::from(PLAN_PX) / 2.0 - f64::from(x) - 0.5;
        let place = (libm::atan2(left_px, ahead_px) - right_rad) / f64::from(scan.bearing_step_rad);
        if place < 0.0 {
            return OUTSIDE;
        }
        // Not negative, and the cast saturates.
        match scan.ranges_mm.get(place as usize) {
            None => OUTSIDE,
            Some(0) => UNKNOWN,
            Some(&range_mm) => {
                let range_px = f64::from(range_mm) / mm_per_px;
                let here_px = libm::hypot(left_px, ahead_px);
                if here_px < range_px - 1.0 {
                    FREE
                } else if here_px < range_px + 3.0 {
                    OBSTACLE
                } else {
                    UNKNOWN
                }
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCAN: Scan<'_> = Scan {
        ranges_mm: &[2000, 0, 1000],
        bearing_min_rad: -0.5,
        bearing_step_rad: 0.5,
        range_max_mm: 9000,
    };

    /// 6 m at a disparity of 1 px, and 250 mm at 24 px.
    fn encoded(format: ScanFormat) -> Vec<u8> {
        let depth = Depth::new(100 * 60 * 256, 0).unwrap();
        let disparities = DisparityRange::up_to(24);
        format.encode(&SCAN, &depth, disparities).unwrap()
    }

    #[derive(serde::Deserialize)]
    struct Fields {
        angle_min: f32,
        angle_max: f32,
        angle_increment: f32,
        range_min: f32,
        range_max: f32,
        ranges: Vec<f32>,
    }

    #[test]
    fn yaml_has_the_fields_of_a_laser_scan() {
        let yaml = encoded(ScanFormat::Yaml);
        let yaml = String::from_utf8(yaml).unwrap();
        let fields: Fields = serde_saphyr::from_str(&yaml).unwrap();
        assert_eq!((fields.angle_min, fields.angle_max), (-0.5, 0.5));
        assert_eq!(fields.angle_increment, 0.5);
        assert_eq!((fields.range_min, fields.range_max), (0.25, 9.0));
        assert_eq!((fields.ranges[0], fields.ranges[2]), (2.0, 1.0));
        assert!(fields.ranges[1].is_nan() && fields.ranges.len() == 3);
        assert!(yaml.contains("frame_id: left_camera"), "{yaml}");
    }

    #[test]
    fn the_plan_view_has_the_camera_at_the_bottom_and_left_on_the_left() {
        let png = encoded(ScanFormat::Png);
        let image = image::load_from_memory(&png).unwrap().into_rgb8();
        assert_eq!(image.dimensions(), (PLAN_PX, PLAN_PX));
        // 2 m to the right at -0.5 rad and 1 m to the left at 0.5 rad, at 2200 mm for 512 px.
        let at = |range_mm: f64, bearing: f64| {
            let px = range_mm * 512.0 / 2200.0;
            let (sin, cos) = bearing.sin_cos();
            *image.get_pixel((256.0 - px * sin) as u32, (512.0 - px * cos) as u32)
        };
        let red = Rgb([200, 30, 30]);
        assert_eq!(at(2003.0, -0.5), red);
        assert_eq!(at(1003.0, 0.5), red);
        assert_ne!(at(1003.0, -0.5), red);
        assert_eq!(at(1500.0, 0.0), Rgb([205, 205, 205]));
        assert_eq!(at(1500.0, 1.2), Rgb([255, 255, 255]));
        assert!(ScanFormat::choose(Path::new("a.txt")).is_err());
    }
}
