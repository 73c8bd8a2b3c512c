//! Rectified cameras: points in space from disparities.

use bytemuck::{Pod, Zeroable};

use super::depth::Depth;

/// A point in space, seen from a rectified camera: right, down and forward along its optical axis,
/// as ROS's optical frames have them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Point {
    /// Distance to the right of the optical axis, mm.
    pub x_mm: i16,
    /// Distance below the optical axis, mm.
    pub y_mm: i16,
    /// Depth, mm.
    pub z_mm: u16,
}

impl Point {
    /// No point: its depth is 0, which no point has.
    pub const NONE: Self = Self {
        x_mm: 0,
        y_mm: 0,
        z_mm: 0,
    };
}

/// The camera of a rectified pair whose pixels have the disparities: a pinhole with square pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RectifiedCamera {
    depth: Depth,
    focal_q8: u32,
    /// Column and line.
    principal_q8: [i32; 2],
    /// `2^48 / focal_q8`, so that pixels are not divided by it.
    inverse_focal: i64,
}

impl RectifiedCamera {
    const FOCAL_MIN_Q8: u32 = 1 << 12;
    const LARGEST_Q8: u32 = 1 << 24;

    /// The camera with this conversion of its disparities to depths, this focal length and this
    /// principal point, column and line, all in 1/256 px. `None` when the focal length is not from 16
    /// to 65,536 px or the principal point is further than that from the first pixel.
    #[must_use]
    pub const fn new(depth: Depth, focal_q8: u32, principal_q8: [i32; 2]) -> Option<Self> {
        let [column_q8, line_q8] = principal_q8;
        let is_valid = focal_q8 >= Self::FOCAL_MIN_Q8
            && focal_q8 <= Self::LARGEST_Q8
            && column_q8.unsigned_abs() <= Self::LARGEST_Q8
            && line_q8.unsigned_abs() <= Self::LARGEST_Q8;
        if !is_valid {
            return None;
        }
        Some(Self {
            depth,
            focal_q8,
            principal_q8,
            inverse_focal: (1 << 48) / focal_q8 as i64,
        })
    }

    /// The conversion of disparities to depths.
    #[must_use]
    pub const fn depth(&self) -> Depth {
        self.depth
    }

    /// Focal length, 1/256 px.
    #[must_use]
    pub const fn focal_q8(&self) -> u32 {
        self.focal_q8
    }

    /// Principal point, column and line, 1/256 px.
    #[must_use]
    pub const fn principal_q8(&self) -> [i32; 2] {
        self.principal_q8
    }

    /// Writes the points of pixels that follow each other in line `line` from column `column` on, by
    /// their disparities in 1/16 px; if the lengths differ, those of the common pixels. It is
    /// [`Point::NONE`] where [`Depth::mm`] gives no depth, and beyond 32,767 mm to any side. Right and
    /// down are `(column - cx) Z / f` and `(line - cy) Z / f` with the depth `Z` in whole mm, rounded
    /// to nearest. One division a pixel.
    pub fn line_points(
        &self,
        line: u32,
        column: u16,
        disparities_q4: &[i16],
        points: &mut [Point],
    ) {
        let [cx_q8, cy_q8] = self.principal_q8.map(i64::from);
        // No view has more lines; tangents are below 2^14.
        let line = i64::from(line.min(u16::MAX.into()));
        let down_q28 = ((line * 256 - cy_q8) * self.inverse_focal) >> 20;
        let mut right_q48 = (i64::from(column) * 256 - cx_q8) * self.inverse_focal;
        let side = |tangent_q28: i64, z_mm: u16| {
            i16::try_from((tangent_q28 * i64::from(z_mm) + (1 << 27)) >> 28).ok()
        };
        for (point, &disparity_q4) in points.iter_mut().zip(disparities_q4) {
            let z_mm = self.depth.mm(disparity_q4);
            let sides = (side(right_q48 >> 20, z_mm), side(down_q28, z_mm));
            *point = match sides {
                (Some(x_mm), Some(y_mm)) if z_mm > 0 => Point { x_mm, y_mm, z_mm },
                _ => Point::NONE,
            };
            right_q48 += self.inverse_focal * 256;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disparity::INVALID;

    #[test]
    fn points_are_within_a_millimetre_of_the_pinhole() {
        for (focal_px, cx_px, cy_px) in [
            (16.0, 3.25, -7.5),
            (381.0, 160.0, 120.0),
            (1733.74, 792.27, 541.9),
        ] {
            let q8 = |px: f64| (px * 256.0).round() as i32;
            let numerator_q8 = (focal_px * 54.0 * 256.0) as u32;
            let depth = Depth::new(numerator_q8, 300).unwrap();
            let camera =
                RectifiedCamera::new(depth, q8(focal_px) as u32, [q8(cx_px), q8(cy_px)]).unwrap();
            let [focal_px, cx_px, cy_px] =
                [focal_px, cx_px, cy_px].map(|px| f64::from(q8(px)) / 256.0);
            let disparities_q4: [i16; 700] = core::array::from_fn(|x| (x as i16 - 40) * 5);
            let mut points = [Point::NONE; 700];
            let (line, first) = (77, 9);
            camera.line_points(line, first, &disparities_q4, &mut points);
            let mut found = 0;
            for (x, (point, &disparity_q4)) in points.iter().zip(&disparities_q4).enumerate() {
                let z_mm = depth.mm(disparity_q4);
                let z = f64::from(z_mm);
                let right = (x as f64 + f64::from(first) - cx_px) * z / focal_px;
                let down = (f64::from(line) - cy_px) * z / focal_px;
                if z_mm == 0 || right.abs() > 32_768.5 || down.abs() > 32_768.5 {
                    assert_eq!(*point, Point::NONE);
                } else if right.abs() < 32_766.5 && down.abs() < 32_766.5 {
                    assert_eq!(point.z_mm, z_mm);
                    assert!(
                        (f64::from(point.x_mm) - right).abs() < 0.51,
                        "{right} {point:?}"
                    );
                    assert!(
                        (f64::from(point.y_mm) - down).abs() < 0.51,
                        "{down} {point:?}"
                    );
                    found += 1;
                }
            }
            assert!(found > 300, "{found}");
        }
    }

    #[test]
    fn far_to_the_side_and_unknown_there_is_no_point() {
        let depth = Depth::new(16 * 40_000 * 256, 0).unwrap();
        let camera = RectifiedCamera::new(depth, 16 * 256, [0, 0]).unwrap();
        let mut points = [Point {
            x_mm: 1,
            y_mm: 1,
            z_mm: 1,
        }; 4];
        // 40 m away, where 14 px are 35 m.
        camera.line_points(0, 12, &[256, 256, 256, INVALID], &mut points);
        assert_eq!(points.map(|point| point.x_mm), [30_000, 32_500, 0, 0]);
        assert_eq!(points[2..], [Point::NONE; 2]);
        // Lines that no view has do not overflow.
        camera.line_points(u32::MAX, u16::MAX, &[256; 4], &mut points);
        assert_eq!(points, [Point::NONE; 4]);
    }

    #[test]
    fn numbers_out_of_their_range_are_refused() {
        let depth = Depth::new(1, 0).unwrap();
        let (least, most) = (RectifiedCamera::FOCAL_MIN_Q8, RectifiedCamera::LARGEST_Q8);
        let beyond = most as i32 + 1;
        assert!(RectifiedCamera::new(depth, least, [-(most as i32), most as i32]).is_some());
        assert!(RectifiedCamera::new(depth, least - 1, [0, 0]).is_none());
        assert!(RectifiedCamera::new(depth, most + 1, [0, 0]).is_none());
        assert!(RectifiedCamera::new(depth, least, [beyond, 0]).is_none());
        assert!(RectifiedCamera::new(depth, least, [0, i32::MIN]).is_none());
    }
}
