//! The calibration of a pair of cameras, in one form for all files.

use anyhow::{Result, ensure};
use glam::{DMat3, DQuat, DVec3};

use super::camera::Camera;

/// Two cameras and how they stand to each other.
#[derive(Debug, Clone, PartialEq)]
pub struct StereoCalibration {
    /// What kind of files it was read from.
    pub format: &'static str,
    /// The left and the right camera.
    pub cameras: [Camera; 2],
    /// Rotation from the left camera's coordinates to the right one's: `x_right = R x_left + T`.
    pub rotation: DMat3,
    /// Translation of the same, in the unit of the files.
    pub translation: DVec3,
    /// Millimetres in that unit, where the format fixes it.
    pub unit_mm: Option<f64>,
    /// A rectification that the files have as well.
    pub stored: Option<StoredRectification>,
    /// What may be wrong though it could be read.
    pub warnings: Vec<String>,
}

/// A rectification as files have it: `R1 R2 P1 P2` in OpenCV's names.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StoredRectification {
    /// Rotations from the left and the right camera to the rectified views.
    pub rotations: [DMat3; 2],
    /// Projections of the left and the right rectified view, 3 by 4, row-major.
    pub projections: [[f64; 12]; 2],
}

/// A rotation from its matrix, row-major.
///
/// # Errors
/// Fails with the reason when the matrix is further from a rotation than rounding explains.
pub(super) fn rotation(row_major: [f64; 9]) -> Result<DMat3> {
    let matrix = DMat3::from_cols_array(&row_major).transpose();
    let excess = matrix * matrix.transpose() - DMat3::IDENTITY;
    let largest = excess
        .to_cols_array()
        .iter()
        .fold(0.0, |a: f64, b| a.max(b.abs()));
    ensure!(
        largest < 1e-3 && matrix.determinant() > 0.0,
        "the matrix is not a rotation"
    );
    // Printed digits are not quite orthogonal.
    Ok(DMat3::from_quat(DQuat::from_mat3(&matrix).normalize()))
}

/// A rotation and a translation, from the 16 numbers of a transformation or the 12 of its upper rows.
///
/// # Errors
/// Fails as [`rotation`] does.
pub(super) fn transformation(rows: &[f64]) -> Result<(DMat3, DVec3)> {
    let row = |y: usize| rows.get(4 * y..4 * y + 4);
    let (Some([a, b, c, x]), Some([d, e, f, y]), Some([g, h, i, z])) = (row(0), row(1), row(2))
    else {
        anyhow::bail!("a transformation has 16 numbers");
    };
    Ok((
        rotation([*a, *b, *c, *d, *e, *f, *g, *h, *i])?,
        DVec3::new(*x, *y, *z),
    ))
}

/// The motion between the cameras whose rotations and translations into a common body, or from it
/// for `from_body`, are given.
pub(super) fn between(
    [(left_rotation, left), (right_rotation, right)]: [(DMat3, DVec3); 2],
    from_body: bool,
) -> (DMat3, DVec3) {
    if from_body {
        let rotation = right_rotation * left_rotation.transpose();
        (rotation, right - rotation * left)
    } else {
        let back = right_rotation.transpose();
        (back * left_rotation, back * (left - right))
    }
}

/// Returns the millimetres in a unit that a text states.
///
/// # Errors
/// Fails with one line that shows how a unit is written.
pub fn parse_unit(text: &str) -> Result<f64, String> {
    match text {
        "mm" => Ok(1.0),
        "cm" => Ok(10.0),
        "m" => Ok(1000.0),
        _ => text
            .parse()
            .ok()
            .filter(|&mm: &f64| (1e-3..=1e6).contains(&mm))
            .ok_or_else(|| "a unit is mm, cm, m, or a number of millimetres above 0".to_owned()),
    }
}

impl StoredRectification {
    /// The motion between the cameras that the rectification implies: `R2^T R1`, and `R2^T` of the offset
    /// that the projections state.
    #[must_use]
    pub fn motion(&self) -> (DMat3, DVec3) {
        let [left, right] = self.rotations;
        let [left_offset, right_offset] = self.projections.map(|p| p[3] / p[0]);
        let back = right.transpose();
        (
            back * left,
            back * DVec3::new(right_offset - left_offset, 0.0, 0.0),
        )
    }
}

impl StereoCalibration {
    /// The calibration of cameras that bin `factor` by `factor` pixels into one. A stored rectification
    /// is binned alike.
    ///
    /// # Errors
    /// Fails as [`Camera::binned`] does.
    pub fn binned(mut self, factor: u16) -> Result<Self> {
        let [left, right] = self.cameras;
        self.cameras = [left.binned(factor)?, right.binned(factor)?];
        let by = f64::from(factor);
        for projection in self.stored.iter_mut().flat_map(|s| &mut s.projections) {
            for row in [0, 4] {
                projection[row] /= by;
                projection[row + 1] /= by;
                projection[row + 2] = (projection[row + 2] + 0.5) / by - 0.5;
                projection[row + 3] /= by;
            }
        }
        Ok(self)
    }

    /// The calibration of cameras that deliver a window of their pictures, from this column and line
    /// on. A stored rectification is not kept: its views are those of whole pictures.
    #[must_use]
    pub fn cropped(mut self, corner: [u16; 2]) -> Self {
        self.cameras = self.cameras.map(|camera| camera.cropped(corner));
        self.stored = None;
        self
    }

    /// The calibration with the cameras exchanged.
    #[must_use]
    pub fn exchanged(mut self) -> Self {
        self.cameras.reverse();
        self.rotation = self.rotation.transpose();
        self.translation = -(self.rotation * self.translation);
        if let Some(stored) = &mut self.stored {
            // Offsets count from the left view, which is the other one now.
            let offset = stored.projections[1][3] - stored.projections[0][3];
            stored.rotations.reverse();
            stored.projections.reverse();
            stored.projections[0][3] = 0.0;
            stored.projections[1][3] = -offset;
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_between_cameras_agree_for_both_directions_of_a_body() {
        let turn = |angle: f64| DMat3::from_rotation_y(angle) * DMat3::from_rotation_x(0.3 * angle);
        let into = [
            (turn(0.2), DVec3::new(1.0, 2.0, 3.0)),
            (turn(-0.4), DVec3::new(4.0, -1.0, 0.5)),
        ];
        let from = into.map(|(rotation, offset)| {
            let back = rotation.transpose();
            (back, -(back * offset))
        });
        let (rotation_a, offset_a) = between(into, false);
        let (rotation_b, offset_b) = between(from, true);
        assert!(rotation_a.abs_diff_eq(rotation_b, 1e-12));
        assert!(offset_a.abs_diff_eq(offset_b, 1e-12));
        // A point of the body, in the coordinates of both.
        let point = DVec3::new(0.3, 0.7, 9.0);
        let [left, right] = from.map(|(rotation, offset)| rotation * point + offset);
        assert!((rotation_a * left + offset_a).abs_diff_eq(right, 1e-12));
    }

    #[test]
    fn units_are_understood_or_refused() {
        assert_eq!(parse_unit("cm"), Ok(10.0));
        assert_eq!(parse_unit("25.4"), Ok(25.4));
        for text in ["0", "inf", "ft"] {
            assert!(parse_unit(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_matrix_that_is_no_rotation_is_refused() {
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        assert!(rotation(identity).is_ok());
        assert!(rotation(identity.map(|v| 2.0 * v)).is_err());
        assert!(rotation(identity.map(|v| -v)).is_err());
    }
}
