//! Two real cameras in front of the built-in scene: with lenses that distort, turned against each
//! other and rolled.

use anyhow::{Context, Result};
use glam::{DMat3, DVec2};

use vgstereo_courtyard::RenderedCameras;

use crate::calibration::{Camera, Lens, RectifiedPair, StereoCalibration, StoredRectification};

/// How far beyond the rectified view, in parts of its width, the raw views may reach.
pub(super) const MARGIN_WIDTHS: f64 = 0.4;

/// Returns the calibration of two cameras whose rectified views are those of `cameras`, `size` px large:
/// their pictures are of the same size and see somewhat more. Lengths are in mm.
///
/// # Errors
/// Fails when a focal length or a principal point is out of range.
pub(super) fn calibration(cameras: &RenderedCameras, size: [u16; 2]) -> Result<StereoCalibration> {
    let [cx, cy] = cameras.principal_px;
    let camera = |scale: f64, shift: [f64; 2], distortion: [f64; 4]| {
        let focal_px = scale * cameras.focal_px;
        // Parts of the width, so that a larger picture is the same picture.
        let [x, y] = shift.map(|part| part * f64::from(size[0]));
        let lens = Lens::radial_tangential(&distortion)?;
        Camera::new([focal_px, focal_px, cx + x, cy + y], lens, Some(size))
    };
    // By libm, which is the same on every platform.
    let turned = |x_deg: f64, y_deg: f64, z_deg: f64| {
        let [(sx, cx), (sy, cy), (sz, cz)] = [x_deg, y_deg, z_deg].map(|deg| {
            let angle_rad = deg.to_radians();
            (libm::sin(angle_rad), libm::cos(angle_rad))
        });
        let about_x = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, cx, sx, 0.0, -sx, cx]);
        let about_y = DMat3::from_cols_array(&[cy, 0.0, -sy, 0.0, 1.0, 0.0, sy, 0.0, cy]);
        let about_z = DMat3::from_cols_array(&[cz, sz, 0.0, -sz, cz, 0.0, 0.0, 0.0, 1.0]);
        about_z * about_y * about_x
    };
    let rotations = [turned(0.5, -0.6, 1.0), turned(-0.4, 0.5, -0.8)];
    let projection = |offset: f64| {
        let focal_px = cameras.focal_px;
        let (row_x, row_y) = ([focal_px, 0.0, cx, offset], [0.0, focal_px, cy, 0.0]);
        let mut projection = [0.0; 12];
        projection[..4].copy_from_slice(&row_x);
        projection[4..8].copy_from_slice(&row_y);
        projection[10] = 1.0;
        projection
    };
    let offset = -cameras.focal_px * cameras.baseline_mm;
    let stored = StoredRectification {
        rotations,
        projections: [projection(0.0), projection(offset)],
    };
    let (rotation, translation) = stored.motion();
    Ok(StereoCalibration {
        format: "built-in",
        cameras: [
            camera(0.95, [0.006, -0.004], [-0.28, 0.09, 0.0004, -0.0003])?,
            camera(0.94, [-0.005, 0.003], [-0.26, 0.08, -0.0003, 0.0005])?,
        ],
        rotation,
        translation,
        unit_mm: Some(1.0),
        stored: Some(stored),
        warnings: Vec::new(),
    })
}

/// Where in the rectified view of a camera, px, its pixels look.
pub(super) struct Lookup {
    pair: RectifiedPair,
    view: usize,
}

impl Lookup {
    /// The lookup of the left view, 0, or the right one, 1.
    pub(super) fn new(
        calibration: &StereoCalibration,
        size: [u16; 2],
        view: usize,
    ) -> Result<Self> {
        let pair = RectifiedPair::from_stored(calibration, size)?;
        let pair = pair.context("the calibration has its rectification")?;
        Ok(Self { pair, view })
    }

    /// The raw cameras and the rectified ones.
    pub(super) const fn pair(&self) -> &RectifiedPair {
        &self.pair
    }

    /// The point of the rectified view that a point of the raw view shows; `None` where the lens does not
    /// reach.
    pub(super) fn rectified_px(&self, x_px: f64, y_px: f64) -> Option<[f64; 2]> {
        let tangents = self.pair.rectified_ray(self.view, DVec2::new(x_px, y_px))?;
        let at = tangents * self.pair.focal_px + self.pair.principal_px[self.view];
        Some(at.to_array())
    }
}
