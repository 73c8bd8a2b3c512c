//! Rays, the surfaces they meet and the camera they leave from.
//!
//! The world is in metres: `x` right, `y` up from the ground, `z` away from the camera.
//! Only operations that IEEE 754 rounds exactly, and `libm`: same bits on every platform.

use core::ops::{Add, Mul, Sub};

use super::texture::{self, Material};

/// A point or direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vec3 {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

pub const fn vec3(x: f64, y: f64, z: f64) -> Vec3 {
    Vec3 { x, y, z }
}

impl Add for Vec3 {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        vec3(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl Sub for Vec3 {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        vec3(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl Mul<f64> for Vec3 {
    type Output = Self;
    fn mul(self, scale: f64) -> Self {
        vec3(self.x * scale, self.y * scale, self.z * scale)
    }
}

impl Vec3 {
    pub fn dot(self, other: Self) -> f64 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    pub fn cross(self, other: Self) -> Self {
        vec3(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )
    }

    pub fn length(self) -> f64 {
        self.dot(self).sqrt()
    }

    pub fn unit(self) -> Self {
        self * (1.0 / self.length())
    }
}

/// A half line; `direction` need not have unit length.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
}

impl Ray {
    pub fn at(&self, t: f64) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// What a surface is made of geometrically. Vectors named `axis` and `normal` have unit length.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Infinite plane; `u` runs along `axis_u`, `v` along `axis_v`.
    Plane {
        origin: Vec3,
        axis_u: Vec3,
        axis_v: Vec3,
    },
    /// Rectangle about `centre` whose material may cut holes.
    Sheet {
        centre: Vec3,
        axis_u: Vec3,
        axis_v: Vec3,
        half_u: f64,
        half_v: f64,
    },
    /// Sphere.
    Sphere { centre: Vec3, radius: f64 },
    /// Cylinder with flat ends; `v` is the height above `base`.
    Tube {
        base: Vec3,
        axis: Vec3,
        length: f64,
        radius: f64,
    },
    /// Upright box, turned about `y`; `side` and `front` are its horizontal axes.
    Block {
        centre: Vec3,
        side: Vec3,
        front: Vec3,
        half: Vec3,
    },
}

/// Where a ray met a surface.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// Ray parameter. For a ray of [`Camera::ray`] this is the depth, m.
    pub t: f64,
    /// Surface coordinates, m.
    pub u: f64,
    pub v: f64,
    /// Unit normal, not turned towards the ray.
    pub normal: Vec3,
}

/// A surface with its material.
#[derive(Debug, Clone)]
pub struct Object {
    pub shape: Shape,
    pub material: Material,
    /// Makes objects of one material differ.
    pub tint: u32,
}

/// Directions across `axis`, for angles about a tube.
fn across(axis: Vec3) -> (Vec3, Vec3) {
    // Away from the camera, so that the seam of the angle is not seen.
    let away = vec3(0.05, 0.05, 1.0);
    let side = axis.cross(away).unit();
    (side, side.cross(axis))
}

impl Object {
    /// The nearest meeting with `t_min < t < t_max`.
    pub fn hit(&self, ray: &Ray, t_min: f64, t_max: f64) -> Option<Hit> {
        let inside = |t: f64| t > t_min && t < t_max;
        match self.shape {
            Shape::Plane {
                origin,
                axis_u,
                axis_v,
            } => {
                let normal = axis_u.cross(axis_v);
                let t = (origin - ray.origin).dot(normal) / ray.direction.dot(normal);
                if !inside(t) {
                    return None;
                }
                let offset = ray.at(t) - origin;
                Some(Hit {
                    t,
                    u: offset.dot(axis_u),
                    v: offset.dot(axis_v),
                    normal,
                })
            }
            Shape::Sheet {
                centre,
                axis_u,
                axis_v,
                half_u,
                half_v,
            } => {
                let normal = axis_u.cross(axis_v);
                let t = (centre - ray.origin).dot(normal) / ray.direction.dot(normal);
                if !inside(t) {
                    return None;
                }
                let offset = ray.at(t) - centre;
                let (u, v) = (offset.dot(axis_u), offset.dot(axis_v));
                let solid = u.abs() <= half_u
                    && v.abs() <= half_v
                    && texture::is_solid(self.material, u, v, half_u, half_v);
                solid.then_some(Hit { t, u, v, normal })
            }
            Shape::Sphere { centre, radius } => {
                let offset = ray.origin - centre;
                let a = ray.direction.dot(ray.direction);
                let b = offset.dot(ray.direction);
                let root = b * b - a * (offset.dot(offset) - radius * radius);
                if root < 0.0 {
                    return None;
                }
                let t = (-b - root.sqrt()) / a;
                if !inside(t) {
                    return None;
                }
                let normal = (ray.at(t) - centre) * (1.0 / radius);
                Some(Hit {
                    t,
                    u: normal.x * radius,
                    v: normal.y * radius,
                    normal,
                })
            }
            Shape::Tube {
                base,
                axis,
                length,
                radius,
            } => {
                let offset = ray.origin - base;
                let along_offset = offset.dot(axis);
                let along_ray = ray.direction.dot(axis);
                let flat_offset = offset - axis * along_offset;
                let flat_ray = ray.direction - axis * along_ray;
                let a = flat_ray.dot(flat_ray);
                let b = flat_offset.dot(flat_ray);
                let root = b * b - a * (flat_offset.dot(flat_offset) - radius * radius);
                if root < 0.0 {
                    return None;
                }
                let t = (-b - root.sqrt()) / a;
                let v = along_offset + t * along_ray;
                if (0.0..=length).contains(&v) {
                    if !inside(t) {
                        return None;
                    }
                    let normal = (flat_offset + flat_ray * t) * (1.0 / radius);
                    let (side, back) = across(axis);
                    let angle = libm::atan2(normal.dot(side), -normal.dot(back));
                    return Some(Hit {
                        t,
                        u: angle * radius,
                        v,
                        normal,
                    });
                }
                let (height, normal) = if along_ray < 0.0 {
                    (length, axis)
                } else {
                    (0.0, axis * -1.0)
                };
                let t = (height - along_offset) / along_ray;
                let flat = flat_offset + flat_ray * t;
                if !inside(t) || flat.dot(flat) > radius * radius {
                    return None;
                }
                let (side, back) = across(axis);
                Some(Hit {
                    t,
                    u: flat.dot(side),
                    // Past the end, so that materials can tell the lid.
                    v: length + radius + flat.dot(back),
                    normal,
                })
            }
            Shape::Block {
                centre,
                side,
                front,
                half,
            } => {
                let up = vec3(0.0, 1.0, 0.0);
                let offset = ray.origin - centre;
                let mut enter = (f64::NEG_INFINITY, 0);
                let mut leave = f64::INFINITY;
                let slabs = [(side, half.x), (up, half.y), (front, half.z)];
                for (index, &(axis, reach)) in slabs.iter().enumerate() {
                    let inverse = 1.0 / ray.direction.dot(axis);
                    let middle = -offset.dot(axis) * inverse;
                    let spread = (reach * inverse).abs();
                    if middle - spread > enter.0 {
                        enter = (middle - spread, index);
                    }
                    leave = leave.min(middle + spread);
                }
                let (t, index) = enter;
                if t > leave || !inside(t) {
                    return None;
                }
                let local = ray.at(t) - centre;
                let axis = slabs[index].0;
                let (u, v) = match index {
                    0 => (local.dot(front), local.y),
                    1 => (local.dot(side), local.dot(front)),
                    _ => (local.dot(side), local.y),
                };
                let sign = if ray.direction.dot(axis) < 0.0 {
                    1.0
                } else {
                    -1.0
                };
                Some(Hit {
                    t,
                    u,
                    v,
                    normal: axis * sign,
                })
            }
        }
    }

    /// A sphere around the object; `None` if it has no end.
    pub fn bound(&self) -> Option<(Vec3, f64)> {
        match self.shape {
            Shape::Plane { .. } => None,
            Shape::Sheet {
                centre,
                half_u,
                half_v,
                ..
            } => Some((centre, (half_u * half_u + half_v * half_v).sqrt())),
            Shape::Sphere { centre, radius } => Some((centre, radius)),
            Shape::Tube {
                base,
                axis,
                length,
                radius,
            } => {
                let half = length / 2.0;
                Some((base + axis * half, (half * half + radius * radius).sqrt()))
            }
            Shape::Block { centre, half, .. } => Some((centre, half.length())),
        }
    }
}

/// A pinhole camera whose image columns run along world `x`, pitched down.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    pub position: Vec3,
    down: Vec3,
    forward: Vec3,
    /// Focal length, px.
    pub focal_px: f64,
    centre_x_px: f64,
    centre_y_px: f64,
}

impl Camera {
    pub fn new(
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

    /// The ray through image point `(x, y)`; pixel centres are whole numbers. Its parameter
    /// is the depth.
    pub fn ray(&self, x_px: f64, y_px: f64) -> Ray {
        let u = (x_px - self.centre_x_px) / self.focal_px;
        let v = (y_px - self.centre_y_px) / self.focal_px;
        Ray {
            origin: self.position,
            direction: vec3(u, 0.0, 0.0) + self.down * v + self.forward,
        }
    }

    /// Distance along the optical axis, m.
    pub fn depth(&self, point: Vec3) -> f64 {
        (point - self.position).dot(self.forward)
    }

    /// Image columns and lines that can show a sphere: `[left, right, top, bottom]`, px;
    /// `None` if it reaches the camera.
    pub fn extent(&self, centre: Vec3, radius: f64) -> Option<[f64; 4]> {
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

/// A grid of cells over a plane that lists, per cell, the objects that can be met there.
///
/// Serves image tiles and, across the direction of the sun, shadows.
#[derive(Debug)]
pub struct Grid {
    left: f64,
    top: f64,
    cell: f64,
    columns: usize,
    rows: usize,
    cells: Vec<Vec<u16>>,
}

impl Grid {
    pub fn new(left: f64, top: f64, cell: f64, columns: usize, rows: usize) -> Self {
        Self {
            left,
            top,
            cell,
            columns,
            rows,
            cells: vec![Vec::new(); columns * rows],
        }
    }

    /// Lists an object in the cells that `[left, right, top, bottom]` touches.
    pub fn insert(&mut self, object: u16, [left, right, top, bottom]: [f64; 4]) {
        // Saturating casts: spans off the grid end at its border.
        let clip =
            |position: f64, cells: usize| (position / self.cell).clamp(0.0, cells as f64) as usize;
        let first_column = clip(left - self.left, self.columns);
        let last_column = clip(right - self.left + self.cell, self.columns);
        let first_row = clip(top - self.top, self.rows);
        let last_row = clip(bottom - self.top + self.cell, self.rows);
        for row in first_row..last_row {
            for column in first_column..last_column {
                self.cells[row * self.columns + column].push(object);
            }
        }
    }

    /// The objects to try at a position; none off the grid.
    pub fn at(&self, x: f64, y: f64) -> &[u16] {
        let column = (x - self.left) / self.cell;
        let row = (y - self.top) / self.cell;
        if column < 0.0 || row < 0.0 {
            return &[];
        }
        let (column, row) = (column as usize, row as usize);
        if column >= self.columns || row >= self.rows {
            return &[];
        }
        &self.cells[row * self.columns + column]
    }
}
