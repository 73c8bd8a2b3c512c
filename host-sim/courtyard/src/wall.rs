//! A flat textured wall before the two cameras, at a distance that is known exactly.

use crate::camera::Camera;
use crate::geometry::{Object, Shape};
use crate::texture::Material;

/// How far the wall reaches to each side, distances of its own.
const REACH: f64 = 2.0;

/// Returns a wall whose plane is `distance` m from the camera, turned by these angles, rad, about the
/// columns and the lines; at 0 it is square to the optical axis.
pub(crate) fn wall(
    camera: &Camera,
    distance: f64,
    [about_columns, about_lines]: [f64; 2],
) -> Object {
    let (sin_c, cos_c) = (libm::sin(about_columns), libm::cos(about_columns));
    let (sin_l, cos_l) = (libm::sin(about_lines), libm::cos(about_lines));
    // The normal is across both axes.
    let along = [cos_c, 0.0, -sin_c];
    let across = [-sin_c * sin_l, cos_l, -cos_c * sin_l];
    let normal = [sin_c * cos_l, sin_l, cos_c * cos_l];
    Object {
        shape: Shape::Sheet {
            centre: camera.position + camera.direction(normal.map(|part| part * distance)),
            axis_u: camera.direction(along),
            axis_v: camera.direction(across),
            half_u: REACH * distance,
            half_v: REACH * distance,
        },
        material: Material::Marble,
        tint: 7,
    }
}
