//! The figures that makers of depth cameras state, measured on a flat wall.
//!
//! As in Intel's *Depth Quality Testing Methodology*: fill rate, accuracy along the distance, spatial
//! noise as the RMS distance from the fitted plane, its sub-pixel equivalent, and temporal noise.

use anyhow::{Context, Result, ensure};
use glam::{DMat3, DVec3};
use vgstereo_core::INVALID;
use vgstereo_core::geometry::RectifiedCamera;

/// The part of a view that is judged, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// The first column and line.
    pub corner: [usize; 2],
    /// The number of columns and lines.
    pub size: [usize; 2],
}

impl Part {
    /// The middle of a view of this size, of this share of its width and its height.
    #[must_use]
    pub fn middle(size: [usize; 2], share: f64) -> Self {
        let part = size.map(|side| ((side as f64 * share).round() as usize).clamp(1, side.max(1)));
        let corner = [0, 1].map(|axis| (size[axis] - part[axis].min(size[axis])) / 2);
        Self { corner, size: part }
    }

    fn pixels(self, width: usize) -> impl Iterator<Item = (usize, DVec3)> {
        let ([left, top], [columns, lines]) = (self.corner, self.size);
        (top..top + lines).flat_map(move |y| {
            (left..left + columns)
                .map(move |x| (y * width + x, DVec3::new(x as f64, y as f64, 1.0)))
        })
    }
}

/// The plane that fits the wall best, and how far the points are from it, over all frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// The distance of the plane from the camera, mm.
    pub distance_mm: f64,
    /// The angle between the plane's normal and the optical axis, degrees.
    pub tilt_degrees: f64,
    /// Spatial noise: the RMS distance of the points from the plane, mm.
    pub rms_mm: f64,
    /// The RMS difference between the disparities and those of the plane, px.
    pub subpixel_rms_px: f64,
}

/// What was measured of a wall.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// The share of the pixels that have a disparity, percent.
    pub fill_percent: f64,
    /// The plane of each frame on its own, the figures averaged: distances and angle by their mean, RMS
    /// by their squares.
    pub plane: Plane,
    /// The median of the points' distances from the camera along the plane's normal, less the true
    /// distance, mm; `None` if that is not known.
    pub z_accuracy_mm: Option<f64>,
    /// The median over the pixels of the standard deviation of the depth from frame to frame, mm; `None`
    /// for a single frame.
    pub temporal_noise_mm: Option<f64>,
    /// The distance of each point of the first frame from its plane, mm, row-major in the part, away from
    /// the camera above 0; `None` where there is no disparity.
    pub residuals_mm: Vec<Option<f64>>,
}

/// Measures frames of disparities, 1/16 px, row-major in lines of `width` px, of one camera.
///
/// # Errors
/// Fails when there is no frame, or one of them has too few disparities in the part for a plane.
pub fn measure(
    frames: &[Vec<i16>],
    width: usize,
    part: Part,
    camera: &RectifiedCamera,
    distance_mm: Option<f64>,
) -> Result<Figures> {
    ensure!(!frames.is_empty(), "there is no frame");
    let optics = Optics::of(camera);
    let pixels = part.size[0] * part.size[1];
    let (mut filled, mut tilts, mut distances) = (0, 0.0, 0.0);
    let (mut squares_mm, mut squares_px) = (0.0, 0.0);
    let mut along_normal_mm = Vec::new();
    let mut residuals_mm = Vec::new();
    for (number, frame) in frames.iter().enumerate() {
        let seen = |(at, pixel): (usize, DVec3)| {
            let q4 = frame.get(at).copied().filter(|&q4| q4 != INVALID)?;
            let px = f64::from(q4) / 16.0;
            // A point has to be in front of the camera.
            (px + optics.offset_px > 0.0).then_some((pixel, px))
        };
        let points: Vec<Option<(DVec3, f64)>> = part.pixels(width).map(seen).collect();
        let plane = fit(points.iter().flatten()).with_context(|| {
            format!(
                "frame {}: there are too few disparities for a plane",
                number + 1
            )
        })?;
        let (normal, plane_mm) = optics.plane(plane);
        tilts += normal.z.clamp(-1.0, 1.0).acos().to_degrees();
        distances += plane_mm;
        for point in &points {
            let residual = point.map(|(pixel, px)| {
                let along_mm = optics.point(pixel, px).dot(normal);
                filled += 1;
                squares_mm += (along_mm - plane_mm).powi(2);
                squares_px += (px - plane.dot(pixel)).powi(2);
                along_normal_mm.push(along_mm);
                along_mm - plane_mm
            });
            if number == 0 {
                residuals_mm.push(residual);
            }
        }
    }
    let (count, each) = (frames.len() as f64, f64::from(filled));
    let z_accuracy_mm = match distance_mm {
        Some(distance_mm) => median(&mut along_normal_mm).map(|middle| middle - distance_mm),
        None => None,
    };
    Ok(Figures {
        fill_percent: 100.0 * each / (count * pixels as f64),
        plane: Plane {
            distance_mm: distances / count,
            tilt_degrees: tilts / count,
            rms_mm: (squares_mm / each).sqrt(),
            subpixel_rms_px: (squares_px / each).sqrt(),
        },
        z_accuracy_mm,
        temporal_noise_mm: temporal_noise_mm(frames, width, part, &optics),
        residuals_mm,
    })
}

/// The numbers of a camera, in px and mm.
struct Optics {
    focal_px: f64,
    principal_px: [f64; 2],
    /// Focal length times baseline, px mm.
    numerator: f64,
    offset_px: f64,
}

impl Optics {
    fn of(camera: &RectifiedCamera) -> Self {
        let q8 = |value: f64| value / 256.0;
        Self {
            focal_px: q8(camera.focal_q8().into()),
            principal_px: camera.principal_q8().map(|value| q8(value.into())),
            numerator: q8(camera.depth().numerator_q8().into()),
            offset_px: q8(camera.depth().offset_q8().into()),
        }
    }

    fn depth_mm(&self, px: f64) -> f64 {
        self.numerator / (px + self.offset_px)
    }

    /// The point of a pixel with this disparity, mm: right, down, forward.
    fn point(&self, pixel: DVec3, px: f64) -> DVec3 {
        let [column, line] = self.principal_px;
        let tangents = DVec3::new(pixel.x - column, pixel.y - line, self.focal_px) / self.focal_px;
        tangents * self.depth_mm(px)
    }

    /// The normal, away from the camera, and the distance, mm, of the plane on which a pixel `(x, y, 1)`
    /// has the disparity `plane . pixel`. From `a x + b y + c + offset = f B / Z`, times `Z`.
    fn plane(&self, plane: DVec3) -> (DVec3, f64) {
        let [column, line] = self.principal_px;
        let at_principal = plane.x * column + plane.y * line + plane.z + self.offset_px;
        let normal = DVec3::new(
            plane.x * self.focal_px,
            plane.y * self.focal_px,
            at_principal,
        );
        let length = normal.length();
        (normal / length, self.numerator / length)
    }
}

/// The plane that fits these disparities best, by least squares: `plane . (x, y, 1)`, px. A plane in space
/// has disparities that are a plane over the pixels. `None` if they do not tell one.
fn fit<'a>(points: impl Iterator<Item = &'a (DVec3, f64)> + Clone) -> Option<DVec3> {
    let count = points.clone().count() as f64;
    // About their middle, so that no digits are lost.
    let sum: DVec3 = points.clone().map(|(pixel, _)| *pixel).sum();
    let middle = DVec3::new(sum.x, sum.y, 0.0) / count;
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (pixel, px) in points {
        let from_middle = *pixel - middle;
        matrix += DMat3::from_cols(
            from_middle * from_middle.x,
            from_middle * from_middle.y,
            from_middle * from_middle.z,
        );
        right += from_middle * *px;
    }
    // Points on one line have no plane.
    if count < 3.0 || matrix.determinant() < 0.5 {
        return None;
    }
    let plane = matrix.inverse() * right;
    Some(plane - DVec3::new(0.0, 0.0, plane.x * middle.x + plane.y * middle.y))
}

/// The median over the pixels of the standard deviation of the depth, of those that have one in at least
/// two frames.
fn temporal_noise_mm(
    frames: &[Vec<i16>],
    width: usize,
    part: Part,
    optics: &Optics,
) -> Option<f64> {
    let mut deviations_mm: Vec<f64> = part
        .pixels(width)
        .filter_map(|(at, _)| {
            let depths = frames.iter().filter_map(|frame| {
                let q4 = frame.get(at).copied().filter(|&q4| q4 != INVALID)?;
                let px = f64::from(q4) / 16.0;
                (px + optics.offset_px > 0.0).then(|| optics.depth_mm(px))
            });
            let depths_mm: Vec<f64> = depths.collect();
            let count = depths_mm.len() as f64;
            if count < 2.0 {
                return None;
            }
            let mean = depths_mm.iter().sum::<f64>() / count;
            let squares: f64 = depths_mm.iter().map(|depth| (depth - mean).powi(2)).sum();
            Some((squares / (count - 1.0)).sqrt())
        })
        .collect();
    median(&mut deviations_mm)
}

fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let (_, median, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*median)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vgstereo_core::geometry::Depth;

    /// 400 px, 60 mm, an offset of 2 px.
    fn camera() -> RectifiedCamera {
        let depth = Depth::new(400 * 60 * 256, 2 * 256).unwrap();
        RectifiedCamera::new(depth, 400 * 256, [80 * 256, 60 * 256]).unwrap()
    }

    const WIDTH: usize = 160;
    const WHOLE: Part = Part {
        corner: [0, 0],
        size: [WIDTH, 120],
    };

    /// The disparities of points on the plane `normal . point = distance`, moved along the rays by
    /// `error_px`, as they are before rounding.
    fn disparities_px(
        normal: DVec3,
        distance_mm: f64,
        error_px: impl Fn(usize) -> f64,
    ) -> Vec<f64> {
        let of = |at: usize| {
            let (x, y) = ((at % WIDTH) as f64, (at / WIDTH) as f64);
            let ray = DVec3::new((x - 80.0) / 400.0, (y - 60.0) / 400.0, 1.0);
            let depth = distance_mm / normal.dot(ray);
            400.0 * 60.0 / depth - 2.0 + error_px(at)
        };
        (0..WIDTH * 120).map(of).collect()
    }

    fn q4(disparities_px: &[f64]) -> Vec<i16> {
        disparities_px
            .iter()
            .map(|px| (px * 16.0).round() as i16)
            .collect()
    }

    #[test]
    fn a_plane_is_found_as_it_was_made() {
        for (turned, distance_mm) in [(0.0_f64, 900.0), (0.2, 1200.0), (-0.4, 700.0)] {
            let normal = DVec3::new(turned.sin() * 0.8, turned.sin() * 0.6, turned.cos());
            let frame = q4(&disparities_px(normal, distance_mm, |_| 0.0));
            let figures = measure(&[frame], WIDTH, WHOLE, &camera(), Some(distance_mm)).unwrap();
            let plane = figures.plane;
            assert!(
                (plane.distance_mm / distance_mm - 1.0).abs() < 1e-3,
                "{plane:?}"
            );
            assert!(
                (plane.tilt_degrees - turned.abs().to_degrees()).abs() < 0.1,
                "{plane:?}"
            );
            // Rounded to a sixteenth: 1/16 / sqrt(12) px, or less where the plane is level.
            assert!(plane.subpixel_rms_px < 0.019, "{plane:?}");
            assert!(figures.z_accuracy_mm.unwrap().abs() < 0.002 * distance_mm);
            assert_eq!(figures.fill_percent, 100.0);
            assert_eq!(figures.temporal_noise_mm, None);
        }
    }

    #[test]
    fn errors_that_were_made_are_those_that_are_told() {
        // Half a pixel to and fro, in a pattern that no plane takes up; every fifth pixel missing.
        let sign = |at: usize| {
            if (at + at / WIDTH).is_multiple_of(2) {
                0.5
            } else {
                -0.5
            }
        };
        let exact = disparities_px(DVec3::Z, 1000.0, sign);
        let mut frame = q4(&exact);
        for q4 in frame.iter_mut().step_by(5) {
            *q4 = INVALID;
        }
        let figures = measure(&[frame], WIDTH, WHOLE, &camera(), Some(990.0)).unwrap();
        assert_eq!(figures.fill_percent, 80.0);
        assert!((figures.plane.subpixel_rms_px - 0.5).abs() < 0.01);
        // 24 px and 0.5 px: 1000 mm are 979.6 and 1021.3 mm.
        let expected_mm = ((20.41_f64.powi(2) + 21.28_f64.powi(2)) / 2.0).sqrt();
        assert!(
            (figures.plane.rms_mm / expected_mm - 1.0).abs() < 0.02,
            "{figures:?}"
        );
        let missing = figures.residuals_mm.iter().filter(|r| r.is_none()).count();
        assert_eq!(missing, WIDTH * 120 / 5);
    }

    #[test]
    fn a_wrong_scale_shows_in_the_accuracy_alone() {
        let frame = q4(&disparities_px(DVec3::Z, 1000.0, |_| 0.0));
        let figures = measure(&[frame], WIDTH, WHOLE, &camera(), Some(960.0)).unwrap();
        assert!((figures.z_accuracy_mm.unwrap() - 40.0).abs() < 2.0);
    }

    #[test]
    fn noise_from_frame_to_frame_is_that_of_the_depth() {
        // Depths of two frames that are 20 px and 20.5 px away: 24000 / 22 and 24000 / 22.5 mm.
        let frames = [vec![20 * 16; WIDTH * 120], vec![20 * 16 + 8; WIDTH * 120]];
        let figures = measure(&frames, WIDTH, WHOLE, &camera(), None).unwrap();
        let apart = 24000.0 / 22.0 - 24000.0 / 22.5;
        let expected = apart / 2.0_f64.sqrt();
        assert!((figures.temporal_noise_mm.unwrap() - expected).abs() < 1e-6);
        assert!(figures.plane.rms_mm < 1e-6, "each frame has its own plane");
        assert_eq!(figures.z_accuracy_mm, None);
    }

    #[test]
    fn what_tells_no_plane_is_refused() {
        let mut frame = vec![INVALID; WIDTH * 120];
        assert!(measure(&[], WIDTH, WHOLE, &camera(), None).is_err());
        frame[..40].fill(160);
        // One line of pixels, and points behind the camera.
        assert!(measure(&[frame.clone()], WIDTH, WHOLE, &camera(), None).is_err());
        frame.fill(-40);
        assert!(measure(&[frame], WIDTH, WHOLE, &camera(), None).is_err());
    }

    #[test]
    fn the_middle_is_within_the_view() {
        for size in [[160, 120], [1, 1], [3, 7]] {
            for share in [0.0, 0.4, 1.0] {
                let part = Part::middle(size, share);
                for axis in [0, 1] {
                    assert!(part.size[axis] >= 1);
                    assert!(part.corner[axis] + part.size[axis] <= size[axis]);
                }
            }
        }
        let part = Part::middle([100, 50], 0.4);
        assert_eq!((part.corner, part.size), ([30, 15], [40, 20]));
    }
}
