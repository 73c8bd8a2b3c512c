//! A pinhole camera: rays through its pixels, and what part of the image an object can be in.

use crate::vector::{Ray, Vec3, vec3};

/// A pinhole camera that looks along `z` and is tilted down. Its scanlines run along world `x`,
/// and so does the baseline between two of them: the views are rectified.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Camera {
    /// The optical centre, m.
    pub position: Vec3,
    /// The direction of the image columns.
    down: Vec3,
    /// The direction of the optical axis.
    forward: Vec3,
    /// The focal length, px.
    pub focal_px: f64,
    /// The principal point, px.
    centre_x_px: f64,
    centre_y_px: f64,
}

impl Camera {
    /// Returns a camera at `position` that looks down by `pitch_rad`.
    pub(crate) fn new(
        position: Vec3,
        pitch_rad: f64,
        focal_px: f64,
        width_px: u32,
        height_px: u32,
    ) -> Self {
        let (sin, cos) = (libm::sin(pitch_rad), libm::cos(pitch_rad));
        Self {
            position,
            down: vec3(0.0, -cos, -sin),
            forward: vec3(0.0, -sin, cos),
            focal_px,
            centre_x_px: (f64::from(width_px) - 1.0) / 2.0,
            centre_y_px: (f64::from(height_px) - 1.0) / 2.0,
        }
    }

    /// Returns the ray through the image point `(x_px, y_px)`; pixel centres are at whole
    /// numbers. The ray parameter is the depth, m.
    pub(crate) fn ray(&self, x_px: f64, y_px: f64) -> Ray {
        let u = (x_px - self.centre_x_px) / self.focal_px;
        let v = (y_px - self.centre_y_px) / self.focal_px;
        Ray {
            origin: self.position,
            direction: self.direction([u, v, 1.0]),
        }
    }

    /// Returns a direction that runs along the columns, the lines and the optical axis by these lengths.
    pub(crate) fn direction(&self, [x, y, z]: [f64; 3]) -> Vec3 {
        vec3(x, 0.0, 0.0) + self.down * y + self.forward * z
    }

    /// Returns the principal point, column and line, px.
    pub(crate) fn principal_px(&self) -> [f64; 2] {
        [self.centre_x_px, self.centre_y_px]
    }

    /// Returns the depth of a point: its distance along the optical axis, m.
    pub(crate) fn depth(&self, point: Vec3) -> f64 {
        (point - self.position).dot(self.forward)
    }

    /// Returns the range of image columns and lines that can show a sphere, as
    /// `[left, right, top, bottom]`, px; `None` if the sphere reaches the camera.
    pub(crate) fn extent(&self, centre: Vec3, radius: f64) -> Option<[f64; 4]> {
        let offset = centre - self.position;
        let depth = self.depth(centre);
        if depth <= radius * 1.01 {
            return None;
        }
        let (near, far) = (depth - radius, depth + radius);
        let span = |middle: f64, centre_px: f64| {
            let (low, high) = (middle - radius, middle + radius);
            [
                centre_px + self.focal_px * (low / near).min(low / far),
                centre_px + self.focal_px * (high / near).max(high / far),
            ]
        };
        let [left, right] = span(offset.x, self.centre_x_px);
        let [top, bottom] = span(offset.dot(self.down), self.centre_y_px);
        Some([left, right, top, bottom])
    }
}

/// The two cameras of the built-in scene: rectified pinholes side by side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderedCameras {
    /// The focal length of both, px.
    pub focal_px: f64,
    /// The principal point of both, column and line, px.
    pub principal_px: [f64; 2],
    /// The distance between them, mm.
    pub baseline_mm: f64,
    /// The angle of their optical axes below the horizon, rad.
    pub pitch_rad: f64,
}
