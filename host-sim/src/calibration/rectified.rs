//! Rectified views: two cameras of one focal length, turned so that a point is on the same line of
//! both.

use anyhow::{Result, ensure};
use glam::{DMat3, DQuat, DVec2, DVec3};

use super::camera::Camera;
use super::lens::TANGENT_MAX;
use super::stereo::StereoCalibration;

/// Tangent of the largest angle from the axis to a border that [`Keep::Valid`] gives, 60 degrees. A
/// plane view of a fisheye's whole field would have its pixels at the borders and hardly any in the
/// middle.
const VALID_TANGENT_MAX: f64 = 1.732;

/// Which part of the scene the rectified views show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// All that the cameras see, with pixels at the borders that no camera saw.
    All,
    /// No pixel, or hardly any, that a camera did not see, and at most 60 degrees from the axis to
    /// a border.
    Valid,
    /// The part of the views as they would be otherwise that begins at this column and line and has this
    /// width and height, px.
    Crop([u16; 4]),
}

/// The geometry of a rectified pair.
#[derive(Debug, Clone, PartialEq)]
pub struct RectifiedPair {
    /// The raw cameras, left and right.
    pub cameras: [Camera; 2],
    /// Rotations from each raw camera to its rectified view.
    pub rotations: [DMat3; 2],
    /// Focal length of both views, px.
    pub focal_px: f64,
    /// Principal points of the views, column and line, px. The line is the same.
    pub principal_px: [DVec2; 2],
    /// Distance between the cameras, in the unit of the calibration.
    pub baseline: f64,
    /// Width and height of the raw views, px.
    pub raw_size: [u16; 2],
    /// Width and height of the rectified views, px.
    pub size: [u16; 2],
}

impl RectifiedPair {
    /// Rectifies by rotation and translation alone, as OpenCV's `stereoRectify` does with zero
    /// disparity at infinity: Bouguet's method, in J.-Y. Bouguet, *Camera Calibration Toolbox for
    /// Matlab*, and G. Bradski and A. Kaehler, *Learning OpenCV*, 2008, chapter 12. Each camera
    /// turns by half the rotation between them, and both turn until the baseline lies along the lines.
    ///
    /// # Errors
    /// Fails with the reason when the lens model does not reach the borders of the picture.
    pub fn compute(
        calibration: &StereoCalibration,
        raw_size: [u16; 2],
        size: [u16; 2],
        all: bool,
    ) -> Result<Self> {
        let turn = DQuat::from_mat3(&calibration.rotation).to_scaled_axis();
        let half_back = DMat3::from_quat(DQuat::from_scaled_axis(turn * -0.5));
        let between = half_back * calibration.translation;
        // The right camera lies on the positive x-axis, so that the translation is negative.
        let aligned = DQuat::from_rotation_arc(between.normalize(), DVec3::NEG_X);
        let aligned = DMat3::from_quat(aligned);
        let mut pair = Self {
            cameras: calibration.cameras,
            rotations: [aligned * half_back.transpose(), aligned * half_back],
            focal_px: 0.0,
            principal_px: [DVec2::ZERO; 2],
            baseline: calibration.translation.length(),
            raw_size,
            size,
        };
        pair.frame(all)?;
        Ok(pair)
    }

    /// Rectifies by what the files have: their rotations and projections.
    ///
    /// # Errors
    /// Fails with the reason when they contradict the rotation and the translation between the
    /// cameras by more than 0.1 px or 1 % of the baseline, or do not put points on the same lines.
    pub fn from_stored(calibration: &StereoCalibration, size: [u16; 2]) -> Result<Option<Self>> {
        let Some(stored) = &calibration.stored else {
            return Ok(None);
        };
        let [left, right] = stored.rotations;
        let pair = Self::from_projections(calibration, [left, right], stored.projections, size)?;
        let expected = right * calibration.rotation * left.transpose();
        let turned = DQuat::from_mat3(&expected).to_scaled_axis().length();
        ensure!(
            turned * pair.focal_px < 0.1,
            "R1 and R2 leave the views turned against each other by {:.2} deg",
            turned.to_degrees()
        );
        let moved = right * calibration.translation;
        let off = (moved - DVec3::NEG_X * pair.baseline).length() / pair.baseline;
        ensure!(
            off < 0.01,
            "P2 and R2 contradict T by {:.0} % of the baseline",
            off * 100.0
        );
        Ok(Some(pair))
    }

    /// The pair with other projections, 3 by 4 and row-major, than the calibration's own.
    ///
    /// # Errors
    /// Fails with the reason when the projections are not those of a rectified pair.
    pub fn from_projections(
        calibration: &StereoCalibration,
        rotations: [DMat3; 2],
        projections: [[f64; 12]; 2],
        size: [u16; 2],
    ) -> Result<Self> {
        let [left, right] = projections;
        let focal_px = left[0];
        ensure!(
            (1.0..=1e5).contains(&focal_px),
            "P1 has a focal length of {focal_px} px"
        );
        let is_focal = |px: f64| (px - focal_px).abs() < 1e-4 * focal_px;
        ensure!(
            is_focal(left[5]) && is_focal(right[0]) && is_focal(right[5]),
            "P1 and P2 have different focal lengths"
        );
        ensure!(
            (left[6] - right[6]).abs() < 0.05,
            "P1 and P2 have principal points on different lines"
        );
        let offset = right[3] / right[0] - left[3] / left[0];
        ensure!(offset < 0.0, "P2 has no baseline to the right");
        let principal_px = [left, right].map(|p| DVec2::new(p[2], p[6]));
        ensure!(
            principal_px.iter().all(|p| p.abs().max_element() < 1e5),
            "P1 and P2 have principal points far outside the picture"
        );
        Ok(Self {
            cameras: calibration.cameras,
            rotations,
            focal_px,
            principal_px,
            baseline: -offset,
            raw_size: size,
            size,
        })
    }

    /// The part of the views that begins at a column and a line and has a width and a height, px.
    ///
    /// # Errors
    /// Fails with the reason when it is empty or does not lie within the views.
    pub fn cropped(mut self, [x, y, width, height]: [u16; 4]) -> Result<Self> {
        let [whole_width, whole_height] = self.size.map(u32::from);
        let is_within = width > 0
            && height > 0
            && u32::from(x) + u32::from(width) <= whole_width
            && u32::from(y) + u32::from(height) <= whole_height;
        ensure!(
            is_within,
            "{x},{y},{width}x{height} is no part of {whole_width}x{whole_height}"
        );
        let corner = DVec2::new(x.into(), y.into());
        self.principal_px = self.principal_px.map(|principal| principal - corner);
        self.size = [width, height];
        Ok(self)
    }

    /// Where the raw camera of a view, 0 or 1, saw what a pixel of the rectified view shows, px; and
    /// whether it saw it: within its picture and the reach of its lens.
    #[must_use]
    pub fn raw_position(&self, view: usize, pixel: DVec2) -> (DVec2, bool) {
        let tangents = (pixel - self.principal_px[view]) / self.focal_px;
        let ray = self.rotations[view].transpose() * tangents.extend(1.0);
        let (at, is_reached) = self.cameras[view].project(ray);
        let [width, height] = self.raw_size.map(f64::from);
        let is_inside = (0.0..=width - 1.0).contains(&at.x) && (0.0..=height - 1.0).contains(&at.y);
        (at, is_reached && is_inside)
    }

    /// Horizontal and vertical field of view of the left rectified view, degrees.
    #[must_use]
    pub fn field_of_view_deg(&self) -> [f64; 2] {
        [0, 1].map(|axis| {
            let [before, after] = [-0.5, f64::from(self.size[axis]) - 0.5]
                .map(|px| ((px - self.principal_px[0][axis]) / self.focal_px).atan());
            (after - before).to_degrees()
        })
    }

    /// Columns of the right principal point less the left one's, px.
    #[must_use]
    pub fn doffs_px(&self) -> f64 {
        self.principal_px[1].x - self.principal_px[0].x
    }

    /// The tangents, in the rectified view, of what the raw camera of a view, 0 or 1, sees at a
    /// pixel; `None` beyond 85 degrees from either axis.
    #[must_use]
    pub fn rectified_ray(&self, view: usize, pixel: DVec2) -> Option<DVec2> {
        let ray = self.cameras[view].ray(pixel)?;
        let turned = self.rotations[view] * ray.extend(1.0);
        let tangents = turned.truncate() / turned.z;
        (turned.z > 0.0 && tangents.length() <= TANGENT_MAX).then_some(tangents)
    }

    /// Chooses focal length and principal points. The middle of the corners of both raw views comes
    /// to the middle of the views, and the scale is the largest at which the views show all of 9 by
    /// 9 points of the raw views, or the smallest at which they show nothing beyond these.
    fn frame(&mut self, all: bool) -> Result<()> {
        let [raw_width, raw_height] = self.raw_size.map(f64::from);
        let [width, height] = self.size.map(f64::from);
        let last = DVec2::new(raw_width - 1.0, raw_height - 1.0);
        let shrink = DVec2::new(width / raw_width, height / raw_height);
        let [left, right] = self.cameras;
        let focal_px = 0.5 * (left.focal_px.y + right.focal_px.y);
        let middle = |view: usize| {
            let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
                .map(|(x, y)| self.rectified_ray(view, DVec2::new(x, y) * last));
            let sum = corners.iter().copied().sum::<Option<DVec2>>();
            // A fisheye may see too far at the corners for a plane.
            sum.map_or(0.5 * last, |sum| 0.5 * last - 0.25 * sum * focal_px)
        };
        let principal = 0.5 * (middle(0) + middle(1)) * shrink;
        // Distances from the principal point to the borders of the view: left, top, right, bottom, px.
        let room = [
            principal.x,
            principal.y,
            width - 1.0 - principal.x,
            height - 1.0 - principal.y,
        ];
        let mut focals: Vec<f64> = Vec::new();
        for view in [0, 1] {
            let mut extents: [Vec<f64>; 4] = Default::default();
            for step_y in 0..9 {
                for step_x in 0..9 {
                    let at = DVec2::new(step_x.into(), step_y.into()) / 8.0 * last;
                    let Some(ray) = self.rectified_ray(view, at) else {
                        continue;
                    };
                    let is_at = [step_x == 0, step_y == 0, step_x == 8, step_y == 8];
                    for (side, extent) in [-ray.x, -ray.y, ray.x, ray.y].into_iter().enumerate() {
                        if all || is_at[side] {
                            extents[side].push(extent);
                        }
                    }
                }
            }
            for (extents, room) in extents.iter().zip(room) {
                let extremes = extents.iter().copied();
                let extreme = if all {
                    extremes.reduce(f64::max)
                } else {
                    extremes.reduce(f64::min)
                };
                if let Some(extreme) = extreme {
                    focals.push(room / extreme);
                }
            }
        }
        let focal = if all {
            focals.iter().copied().reduce(f64::min)
        } else {
            let widest = room.iter().map(|room| room / VALID_TANGENT_MAX);
            focals.iter().copied().chain(widest).reduce(f64::max)
        };
        let is_usable = focals.iter().all(|&px| px.is_finite() && px > 0.0);
        let (Some(focal), true) = (focal, is_usable) else {
            anyhow::bail!(
                "no rectified view fits: the cameras are turned too far against each other or \
                 against the baseline, or their lens models do not reach the borders of the pictures"
            );
        };
        self.focal_px = focal;
        self.principal_px = [principal; 2];
        Ok(())
    }
}
