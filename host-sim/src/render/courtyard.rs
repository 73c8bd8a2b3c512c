//! The courtyard: what stands where, and the light it stands in.

use super::geometry::{Camera, Grid, Object, Ray, Shape, Vec3, vec3};
use super::texture::{self, Colour, Material, Place, fraction, hash};

/// Camera height above the ground, m.
const CAMERA_HEIGHT: f64 = 0.75;
/// How far the cameras look down, rad.
const PITCH_RAD: f64 = 0.15;
/// Focal length in image widths of a 4:3 image.
const FOCAL_WIDTHS: f64 = 1.05;
/// No surface in view is nearer, m; the baseline puts this depth at `d_max`.
const NEAREST: f64 = 1.22;
/// Side of an image tile, px.
const TILE_PX: u32 = 16;
/// A shadow ray starts this far off its surface, m.
const CLEARANCE: f64 = 1e-4;

/// A surface point a camera sees.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Index of the object, for telling edges.
    pub object: u16,
    /// Depth, m.
    pub depth: f64,
    hit: super::geometry::Hit,
    point: Vec3,
}

/// Which of the two cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    Left,
    Right,
}

/// The objects, the two cameras and the lists that make rays cheap.
#[derive(Debug)]
pub struct Courtyard {
    objects: Vec<Object>,
    cameras: [Camera; 2],
    tiles: [Grid; 2],
    /// Focal length times baseline, px m: disparity = this / depth.
    disparity_metres: f64,
    sun: Vec3,
    sun_across: [Vec3; 2],
    shadows: Grid,
    seed: u32,
    /// Contrast of the textures, 0 to 1.
    texture: f64,
}

impl Courtyard {
    pub fn new(width_px: u32, height_px: u32, d_max: u16, seed: u64, texture: f64) -> Self {
        // Both halves of the seed count.
        let seed = (seed ^ (seed >> 32)) as u32;
        let mut objects = furnish(seed);
        let widths = f64::from(width_px).max(f64::from(height_px) * 4.0 / 3.0);
        let focal_px = FOCAL_WIDTHS * widths;
        let disparity_metres = f64::from(d_max) * NEAREST;
        let baseline = disparity_metres / focal_px;
        let camera = |x: f64| {
            Camera::new(
                vec3(x, CAMERA_HEIGHT, 0.0),
                PITCH_RAD,
                focal_px,
                width_px,
                height_px,
            )
        };
        let cameras = [camera(0.0), camera(baseline)];
        // Chance may let a leaf or twig grow out of the range of disparities.
        objects.retain(|object| {
            !matches!(object.material, Material::Leaf | Material::Stick)
                || object
                    .bound()
                    .is_some_and(|(centre, radius)| cameras[0].depth(centre) - radius >= NEAREST)
        });
        let tiles = cameras.map(|camera| {
            let side = f64::from(TILE_PX);
            let columns = width_px.div_ceil(TILE_PX) as usize + 2;
            let rows = height_px.div_ceil(TILE_PX) as usize + 2;
            // A tile of margin: rays of anti-aliasing leave the image by less than 1 px.
            let mut grid = Grid::new(-side, -side, side, columns, rows);
            let everywhere = [-side, f64::MAX, -side, f64::MAX];
            for (index, object) in (0u16..).zip(&objects) {
                let extent = object
                    .bound()
                    .and_then(|(centre, radius)| camera.extent(centre, radius))
                    .unwrap_or(everywhere);
                grid.insert(index, extent);
            }
            grid
        });
        let sun = vec3(-0.55, 0.95, -0.80).unit();
        let side = sun.cross(vec3(0.0, 1.0, 0.0)).unit();
        let sun_across = [side, side.cross(sun)];
        let mut shadows = Grid::new(-8.0, -8.0, 0.125, 128, 128);
        for (index, object) in (0u16..).zip(&objects) {
            if let Some((centre, radius)) = object.bound() {
                let [x, y] = sun_across.map(|axis| centre.dot(axis));
                shadows.insert(index, [x - radius, x + radius, y - radius, y + radius]);
            }
        }
        Self {
            objects,
            cameras,
            tiles,
            disparity_metres,
            sun,
            sun_across,
            shadows,
            seed,
            texture,
        }
    }

    /// The disparity of a depth, px.
    pub fn disparity_px(&self, depth: f64) -> f64 {
        self.disparity_metres / depth
    }

    /// What the camera sees at an image point, which is at most a tile off the image.
    pub fn look(&self, side: Side, x_px: f64, y_px: f64) -> Option<Seen> {
        let ray = self.cameras[side as usize].ray(x_px, y_px);
        let mut nearest: Option<Seen> = None;
        for &index in self.tiles[side as usize].at(x_px, y_px) {
            let limit = nearest.map_or(f64::INFINITY, |seen| seen.depth);
            if let Some(hit) = self.objects[usize::from(index)].hit(&ray, 0.0, limit) {
                nearest = Some(Seen {
                    object: index,
                    depth: hit.t,
                    hit,
                    point: ray.at(hit.t),
                });
            }
        }
        nearest
    }

    /// The linear light that leaves a seen point, the same towards both cameras.
    pub fn light(&self, seen: &Seen) -> Colour {
        let object = &self.objects[usize::from(seen.object)];
        let point = seen.point;
        // One viewpoint for both cameras, so that level of detail and lit side agree.
        let middle = (self.cameras[0].position + self.cameras[1].position) * 0.5;
        let view = (middle - point).unit();
        let facing = seen.hit.normal.dot(view);
        let normal = if facing < 0.0 {
            seen.hit.normal * -1.0
        } else {
            seen.hit.normal
        };
        // Between the short and the long side of the pixel's slanted outline.
        let pixel = seen.depth / self.cameras[0].focal_px / facing.abs().max(0.04).sqrt();
        let (half_u, half_v) = match object.shape {
            Shape::Sheet { half_u, half_v, .. } => (half_u, half_v),
            Shape::Tube { length, .. } => (length / 2.0, length / 2.0),
            Shape::Block { half, .. } if seen.hit.normal.y.abs() > 0.5 => (half.x, half.z),
            Shape::Block { half, .. } => (half.x, half.y),
            Shape::Plane { .. } | Shape::Sphere { .. } => (0.0, 0.0),
        };
        let place = Place {
            point,
            u: seen.hit.u,
            v: seen.hit.v,
            half_u,
            half_v,
            pixel,
            tint: object.tint,
        };
        let mut shown = texture::colour(object.material, &place, self.seed);
        if self.texture < 1.0 {
            shown = texture::blend(texture::paint(object.material), shown, self.texture);
        }
        let slope = normal.dot(self.sun);
        let sun = if slope > 0.0 && !self.shaded(point + normal * CLEARANCE) {
            slope
        } else {
            0.0
        };
        let sky = 0.75 + 0.25 * normal.y;
        // Ground and wall meet in a darker corner.
        let open = 0.62 + 0.38 * (point.y / 0.22).clamp(0.0, 1.0);
        let open = if normal.y > 0.9 { 1.0 } else { open };
        let [red, green, blue] = shown.map(|channel| channel * channel);
        let ambient = sky * open;
        [
            red * (0.36 * ambient + 1.30 * sun),
            green * (0.39 * ambient + 1.22 * sun),
            blue * (0.46 * ambient + 1.08 * sun),
        ]
    }

    fn shaded(&self, point: Vec3) -> bool {
        let ray = Ray {
            origin: point,
            direction: self.sun,
        };
        let [x, y] = self.sun_across.map(|axis| point.dot(axis));
        self.shadows.at(x, y).iter().any(|&index| {
            self.objects[usize::from(index)]
                .hit(&ray, 0.0, f64::INFINITY)
                .is_some()
        })
    }
}

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

/// Numbers -1 to 1 that follow from the seed alone.
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

/// Adds a branch with side twigs and leaves.
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

fn furnish(seed: u32) -> Vec<Object> {
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
