//! The surfaces of objects and where rays meet them.

use crate::texture::{self, Material};
use crate::vector::{Ray, Vec3, vec3};

/// The shape of a surface. Lengths are in metres; vectors whose names begin with `axis`, and
/// `side` and `front`, have unit length. `u` and `v` are coordinates on the surface, m.
#[derive(Debug, Clone)]
pub(crate) enum Shape {
    /// An infinite plane. `u` runs along `axis_u`, `v` along `axis_v`.
    Plane {
        origin: Vec3,
        axis_u: Vec3,
        axis_v: Vec3,
    },
    /// A rectangle about `centre`, in which the material may leave holes.
    Sheet {
        centre: Vec3,
        axis_u: Vec3,
        axis_v: Vec3,
        half_u: f64,
        half_v: f64,
    },
    /// A sphere.
    Sphere { centre: Vec3, radius: f64 },
    /// A cylinder with flat ends. `v` is the height above `base`.
    Tube {
        base: Vec3,
        axis: Vec3,
        length: f64,
        radius: f64,
    },
    /// An upright box that is turned about `y`. `side` and `front` are its horizontal axes,
    /// `half` has half its extents along `side`, `y` and `front`.
    Block {
        centre: Vec3,
        side: Vec3,
        front: Vec3,
        half: Vec3,
    },
}

/// The point where a ray meets a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hit {
    /// The ray parameter. For a ray from a camera this is the depth, m.
    pub t: f64,
    /// The coordinates on the surface, m.
    pub u: f64,
    pub v: f64,
    /// The unit normal of the surface. It may point away from the origin of the ray.
    pub normal: Vec3,
}

/// A surface with its shape and material.
#[derive(Debug, Clone)]
pub(crate) struct Object {
    pub shape: Shape,
    pub material: Material,
    /// A number that makes the textures of objects of one material differ.
    pub tint: u32,
}

/// Returns two unit vectors across `axis` and each other, from which angles about a tube are
/// measured.
fn across(axis: Vec3) -> (Vec3, Vec3) {
    // The seam, where the angle jumps, lies on the far side of the tube: no camera sees it.
    let away = vec3(0.05, 0.05, 1.0);
    let side = axis.cross(away).unit();
    (side, side.cross(axis))
}

/// Returns where the ray meets the plane through `origin`, if its parameter is `inside`.
#[inline]
fn hit_plane(
    ray: &Ray,
    origin: Vec3,
    axis_u: Vec3,
    axis_v: Vec3,
    inside: impl Fn(f64) -> bool,
) -> Option<Hit> {
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

impl Object {
    /// Returns where the ray meets the surface first, if that is at `t_min < t < t_max`.
    pub(crate) fn hit(&self, ray: &Ray, t_min: f64, t_max: f64) -> Option<Hit> {
        let inside = |t: f64| t > t_min && t < t_max;
        match self.shape {
            Shape::Plane {
                origin,
                axis_u,
                axis_v,
            } => hit_plane(ray, origin, axis_u, axis_v, inside),
            Shape::Sheet {
                centre,
                axis_u,
                axis_v,
                half_u,
                half_v,
            } => {
                let hit = hit_plane(ray, centre, axis_u, axis_v, inside)?;
                let is_solid = hit.u.abs() <= half_u
                    && hit.v.abs() <= half_v
                    && texture::is_solid(self.material, hit.u, hit.v, half_u, half_v);
                is_solid.then_some(hit)
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
                    // Above the length, so that materials can tell the ends from the side.
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

    /// Returns the centre and the radius of a sphere around the object, m; `None` for a plane,
    /// which is infinite.
    pub(crate) fn bound(&self) -> Option<(Vec3, f64)> {
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
