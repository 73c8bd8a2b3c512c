//! A camera: from rays to the pixels of its picture, and back.

use anyhow::{Result, ensure};
use glam::{DVec2, DVec3};

use super::document::Entry;
use super::lens::Lens;

/// A calibrated camera. Pixel centres have whole numbers, the first is 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Focal lengths along columns and lines, px.
    pub focal_px: DVec2,
    /// Principal point, column and line, px.
    pub principal_px: DVec2,
    /// The lens.
    pub lens: Lens,
    /// Width and height of the picture, px, where the file states them.
    pub size: Option<[u16; 2]>,
}

impl Camera {
    /// A camera from `fx fy cx cy`, px.
    ///
    /// # Errors
    /// Fails with the reason when a focal length is not from 1 to 100,000 px, or a principal point
    /// lies 100,000 px away.
    pub fn new([fx, fy, cx, cy]: [f64; 4], lens: Lens, size: Option<[u16; 2]>) -> Result<Self> {
        let is_focal = |px: f64| (1.0..=1e5).contains(&px);
        ensure!(
            is_focal(fx) && is_focal(fy),
            "focal lengths of {fx} and {fy} px"
        );
        ensure!(
            cx.abs() < 1e5 && cy.abs() < 1e5,
            "a principal point of {cx}, {cy} px"
        );
        Ok(Self {
            focal_px: DVec2::new(fx, fy),
            principal_px: DVec2::new(cx, cy),
            lens,
            size,
        })
    }

    /// A camera from its matrix, row-major, px.
    ///
    /// # Errors
    /// Fails with the reason when the matrix is not that of a camera without skew, and as
    /// [`Camera::new`] does.
    pub fn from_matrix(matrix: [f64; 9], lens: Lens, size: Option<[u16; 2]>) -> Result<Self> {
        let [fx, skew, cx, zero_1, fy, cy, zero_2, zero_3, one] = matrix;
        let is_camera = skew.abs() < 1e-3
            && [zero_1, zero_2, zero_3, one - 1.0]
                .iter()
                .all(|v| v.abs() < 1e-9);
        ensure!(
            is_camera,
            "the camera matrix is not fx 0 cx, 0 fy cy, 0 0 1"
        );
        Self::new([fx, fy, cx, cy], lens, size)
    }

    /// A camera as Kalibr and EuRoC state it, whose distortion coefficients have this key.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason.
    pub(super) fn from_entry(entry: &Entry<'_>, coefficients: &str) -> Result<Self> {
        let model = entry.require("camera_model")?;
        model.within(Lens::ensure_pinhole(model.text().unwrap_or_default()))?;
        let distortion = entry.require("distortion_model")?;
        let coefficients = entry.require(coefficients)?.list()?;
        let lens = distortion.within(Lens::named(
            distortion.text().unwrap_or_default(),
            &coefficients,
        ))?;
        let intrinsics = entry.require("intrinsics")?;
        let size = entry.require("resolution")?.size()?;
        intrinsics.within(Self::new(intrinsics.numbers()?, lens, Some(size)))
    }

    /// Where a camera sees a point of its coordinates (x to the right, y down, z ahead), px, and
    /// whether it sees it at all: a point that its lens does not reach is at the outermost place of its
    /// direction.
    #[must_use]
    pub fn project(&self, point: DVec3) -> (DVec2, bool) {
        let is_ahead = point.z > 1e-9;
        // What is behind goes to the far end of its direction.
        let tangents = point.truncate() / if is_ahead { point.z } else { 1e-9 };
        let at = self.lens.distort(tangents) * self.focal_px + self.principal_px;
        (at, is_ahead && self.lens.reaches(tangents))
    }

    /// The tangents of the ray that the camera sees at a pixel; `None` where its lens model does not reach.
    #[must_use]
    pub fn ray(&self, pixel: DVec2) -> Option<DVec2> {
        self.lens
            .undistort((pixel - self.principal_px) / self.focal_px)
    }

    /// The camera whose pixels are the means of `factor` by `factor` of this one's.
    ///
    /// # Errors
    /// Fails with the reason when the factor is 0 or does not divide a size that the file states.
    pub fn binned(&self, factor: u16) -> Result<Self> {
        ensure!(factor > 0, "a factor of 0");
        let by = f64::from(factor);
        let size = match self.size {
            Some([width, height]) => {
                ensure!(
                    width.is_multiple_of(factor) && height.is_multiple_of(factor),
                    "{factor} does not divide {width}x{height}"
                );
                Some([width / factor, height / factor])
            }
            None => None,
        };
        Ok(Self {
            focal_px: self.focal_px / by,
            principal_px: (self.principal_px + 0.5) / by - 0.5,
            size,
            ..*self
        })
    }

    /// The camera that delivers a window of its picture, from this column and line on. The size of the
    /// window is not known.
    #[must_use]
    pub fn cropped(&self, [x, y]: [u16; 2]) -> Self {
        Self {
            principal_px: self.principal_px - DVec2::new(x.into(), y.into()),
            size: None,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_binned_camera_sees_the_middle_of_the_pixels_that_it_joins() {
        let lens = Lens::radial_tangential(&[-0.2, 0.1, 0.0, 0.0]).unwrap();
        let camera = Camera::new([500.0, 510.0, 317.0, 240.0], lens, Some([640, 480])).unwrap();
        let binned = camera.binned(2).unwrap();
        assert_eq!(binned.size, Some([320, 240]));
        let point = DVec3::new(0.3, -0.2, 1.1);
        let (fine, _) = camera.project(point);
        let (coarse, _) = binned.project(point);
        // The pixels 10 and 11 become pixel 5, whose middle was at 10.5.
        assert!((coarse * 2.0 + 0.5 - fine).length() < 1e-9);
        assert!(camera.binned(7).is_err());
        let ray = camera.ray(fine).unwrap();
        assert!((ray - point.truncate() / point.z).length() < 1e-9);
    }

    #[test]
    fn matrices_that_are_not_those_of_cameras_are_refused() {
        let lens = Lens::radial_tangential(&[]).unwrap();
        let camera = |matrix| Camera::from_matrix(matrix, lens, None);
        assert!(camera([500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]).is_ok());
        assert!(camera([500.0, 2.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]).is_err());
        assert!(camera([500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0]).is_err());
        assert!(camera([-500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]).is_err());
    }
}
