//! The objects of the courtyard and where they stand.

use crate::geometry::{Object, Shape};
use crate::noise::{fraction, hash};
use crate::texture::Material;
use crate::vector::{Vec3, vec3};

/// Returns a tube between two points.
fn tube(from: Vec3, to: Vec3, radius: f64, material: Material, tint: u32) -> Object {
    let axis = to - from;
    Object {
        shape: Shape::Tube {
            base: from,
            axis: axis.unit(),
            length: axis.length(),
            radius,
        },
        material,
        tint,
    }
}

/// A sequence of numbers from -1 to 1 that depends only on the seed.
struct Chance {
    seed: u32,
    drawn: i32,
}

impl Chance {
    fn draw(&mut self) -> f64 {
        self.drawn = self.drawn.wrapping_add(1);
        fraction(hash(self.drawn, 0, 11, self.seed)) * 2.0 - 1.0
    }

    fn direction(&mut self) -> Vec3 {
        vec3(self.draw(), self.draw(), self.draw())
    }
}

/// Adds a branch from `root` to `tip` with `twigs` twigs, which have leaves. Lengths are in
/// metres.
fn grow(
    objects: &mut Vec<Object>,
    chance: &mut Chance,
    root: Vec3,
    tip: Vec3,
    radius: f64,
    leaf_half: f64,
    twigs: u32,
) {
    let axis = tip - root;
    let length = axis.length();
    // Two straight parts with a knee look less like a rod.
    let knee = root + axis * 0.5 + chance.direction() * (length * 0.06);
    objects.push(tube(root, knee, radius, Material::Stick, 1));
    objects.push(tube(knee, tip, radius * 0.75, Material::Stick, 2));
    for twig in 0..twigs {
        let share = (f64::from(twig) + 1.0) / f64::from(twigs);
        let start = if share < 0.5 {
            root + (knee - root) * (share * 2.0)
        } else {
            knee + (tip - knee) * (share * 2.0 - 1.0)
        };
        let reach = length * (0.30 + 0.08 * chance.draw());
        let side = (axis.unit() * 0.6 + chance.direction()).unit();
        let end = start + side * reach;
        objects.push(tube(start, end, radius * 0.45, Material::Stick, 3));
        for place in [0.45, 0.75, 1.0] {
            let along = (side + chance.direction() * 0.9).unit();
            let across = along.cross(vec3(0.3 * chance.draw(), 0.5, -1.0)).unit();
            let half_u = leaf_half * (1.0 + 0.25 * chance.draw());
            objects.push(Object {
                shape: Shape::Sheet {
                    centre: start + (end - start) * place + along * half_u,
                    axis_u: along,
                    axis_v: across,
                    half_u,
                    half_v: half_u * 0.5,
                },
                material: Material::Leaf,
                tint: hash(objects.len() as i32, 0, 12, chance.seed),
            });
        }
    }
}

/// Returns all objects of the courtyard. The plants depend on the seed.
pub(crate) fn furnish(seed: u32) -> Vec<Object> {
    let up = vec3(0.0, 1.0, 0.0);
    let level = |x: f64, z: f64| vec3(x, 0.0, z).unit();
    let mut chance = Chance { seed, drawn: 0 };
    let mut objects = vec![
        Object {
            shape: Shape::Plane {
                origin: vec3(0.0, 0.0, 0.0),
                axis_u: vec3(1.0, 0.0, 0.0),
                axis_v: vec3(0.0, 0.0, 1.0),
            },
            material: Material::Ground,
            tint: 0,
        },
        Object {
            shape: Shape::Plane {
                origin: vec3(0.0, 0.0, 6.0),
                axis_u: level(1.0, 0.35),
                axis_v: up,
            },
            material: Material::Wall,
            tint: 0,
        },
        tube(
            vec3(-1.42, -0.1, 3.45),
            vec3(-1.30, 3.0, 3.50),
            0.21,
            Material::Bark,
            0,
        ),
        // A crate and what lies on it.
        Object {
            shape: Shape::Block {
                centre: vec3(0.72, 0.25, 2.55),
                side: level(0.86, 0.5),
                front: level(-0.5, 0.86),
                half: vec3(0.30, 0.25, 0.26),
            },
            material: Material::Crate,
            tint: 0,
        },
        Object {
            shape: Shape::Sphere {
                centre: vec3(0.70, 0.66, 2.52),
                radius: 0.16,
            },
            material: Material::Glaze,
            tint: 0,
        },
        Object {
            shape: Shape::Sphere {
                centre: vec3(-0.28, 0.29, 2.75),
                radius: 0.29,
            },
            material: Material::Marble,
            tint: 0,
        },
        tube(
            vec3(-0.56, 0.0, 2.0),
            vec3(-0.56, 0.34, 2.0),
            0.12,
            Material::Tin,
            0,
        ),
    ];
    // A printed board on two legs.
    let along = level(-0.96, 0.28);
    let middle = vec3(0.12, 0.80, 4.5);
    objects.push(Object {
        shape: Shape::Sheet {
            centre: middle,
            axis_u: along,
            axis_v: up,
            half_u: 0.46,
            half_v: 0.32,
        },
        material: Material::Board,
        tint: 0,
    });
    for side in [-0.36, 0.36] {
        let foot = middle + along * side + vec3(0.0, -0.80, 0.05);
        let head = foot + vec3(0.0, 1.2, 0.0);
        objects.push(tube(foot, head, 0.022, Material::Stick, 4));
    }
    // A lattice fence with posts.
    let along = level(0.9, 0.42);
    let middle = vec3(1.75, 0.44, 4.2);
    objects.push(Object {
        shape: Shape::Sheet {
            centre: middle,
            axis_u: along,
            axis_v: up,
            half_u: 0.80,
            half_v: 0.44,
        },
        material: Material::Lattice,
        tint: 0,
    });
    for side in [-0.82, 0.82] {
        let foot = middle + along * side + vec3(0.0, -0.44, 0.0);
        let head = foot + vec3(0.0, 1.0, 0.0);
        objects.push(tube(foot, head, 0.035, Material::Stick, 5));
    }
    // A cane close to the cameras.
    objects.push(tube(
        vec3(-0.43, -0.1, 1.22),
        vec3(-0.36, 1.5, 1.40),
        0.013,
        Material::Bamboo,
        0,
    ));
    // Branches of the tree.
    for (root, tip) in [
        (vec3(-1.32, 1.02, 3.45), vec3(-0.62, 1.26, 3.25)),
        (vec3(-1.34, 1.16, 3.45), vec3(-1.02, 1.48, 2.95)),
        (vec3(-1.40, 0.95, 3.45), vec3(-1.75, 1.30, 3.20)),
    ] {
        grow(&mut objects, &mut chance, root, tip, 0.022, 0.065, 6);
    }
    // A young plant close to the cameras.
    for (root, tip) in [
        (vec3(0.50, 0.0, 1.35), vec3(0.44, 0.52, 1.38)),
        (vec3(0.52, 0.0, 1.37), vec3(0.60, 0.44, 1.45)),
        (vec3(0.49, 0.0, 1.35), vec3(0.33, 0.36, 1.42)),
    ] {
        grow(&mut objects, &mut chance, root, tip, 0.0045, 0.026, 4);
    }
    objects
}
