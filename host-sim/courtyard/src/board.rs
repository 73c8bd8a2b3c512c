//! A board of black and white squares, as cameras are calibrated with.

use crate::camera::Camera;
use crate::geometry::{Object, Shape};
use crate::texture::{Material, SQUARE, SQUARES};

/// The width of the white border, in squares.
const BORDER: f64 = 0.5;

/// Returns half the long and half the short side of the board with its border, m.
#[must_use]
pub fn half_sides_m() -> [f64; 2] {
    SQUARES.map(|squares| (0.5 * f64::from(squares) + BORDER) * SQUARE)
}

/// Returns a board about `middle`, m, whose long and short side run in these directions, all as the camera sees them:
/// along its columns, its lines and its optical axis.
pub(crate) fn board(camera: &Camera, middle: [f64; 3], [along, across]: [[f64; 3]; 2]) -> Object {
    let [half_u, half_v] = half_sides_m();
    Object {
        shape: Shape::Sheet {
            centre: camera.position + camera.direction(middle),
            axis_u: camera.direction(along),
            axis_v: camera.direction(across),
            half_u,
            half_v,
        },
        material: Material::Squares,
        tint: 0,
    }
}
