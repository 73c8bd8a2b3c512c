//! The built-in scene: a small courtyard before two rectified pinhole cameras.
//!
//! A ray caster looks into it. Geometry is analytic and textures are functions of the surface point, so both views show
//! the same surfaces and every depth is exact. Equal seeds give identical bits on every platform.
//!
//! [`Courtyard`] holds the objects and the cameras. [`Courtyard::look`] tells what a camera sees at a point of its image,
//! [`Courtyard::exposed`] how much light a pixel gets. What makes pictures and ground truth of that is the simulator's.
//!
//! Positions in an image are px, column and line, pixel centres at whole numbers. Lengths in the world are m.

mod board;
mod camera;
mod furniture;
mod geometry;
mod grid;
mod noise;
mod texture;
mod vector;
mod wall;

pub use board::half_sides_m;
pub use camera::RenderedCameras;
pub use texture::{SQUARE_MM, SQUARES};

use camera::Camera;
use furniture::furnish;
use geometry::{Hit, Object, Shape};
use grid::Grid;
use texture::{Colour, Material, Place};
use vector::{Ray, Vec3, vec3};

/// The height of the cameras above the ground, m.
const CAMERA_HEIGHT: f64 = 0.75;
/// The angle by which the cameras look down, rad.
const PITCH_RAD: f64 = 0.15;
/// The focal length in widths of an image with aspect ratio 4:3.
const FOCAL_WIDTHS: f64 = 1.05;
/// The smallest depth of any surface in view, m. The baseline is chosen so that a point at
/// this depth has the disparity `d_max`.
const NEAREST: f64 = 1.22;
/// The side of an image tile, px.
const TILE_PX: u32 = 16;
/// The distance from a surface at which its shadow rays start, m.
const CLEARANCE: f64 = 1e-4;

/// A surface point that a camera sees.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// The index of the object. It differs between the two sides of an edge.
    pub object: u16,
    /// The depth, m.
    pub depth: f64,
    hit: Hit,
    point: Vec3,
}

impl Seen {
    /// Where the point is, seen from a camera at `origin` that is level: to the right, up and
    /// forward, m.
    fn from(&self, origin: Vec3) -> [f64; 3] {
        let offset = self.point - origin;
        [offset.x, offset.y, offset.z]
    }
}

/// One of the two cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

/// The objects, the two cameras, and grids that tell which objects a ray can meet.
#[derive(Debug)]
pub struct Courtyard {
    objects: Vec<Object>,
    cameras: [Camera; 2],
    tiles: [Grid; 2],
    /// Focal length times baseline, px m. A disparity is this divided by the depth.
    disparity_metres: f64,
    /// The direction towards the sun.
    sun: Vec3,
    /// The axes of a plane across the direction of the sun.
    sun_across: [Vec3; 2],
    /// The objects that can cast a shadow at a place in that plane.
    shadows: Grid,
    seed: u32,
    /// The contrast of the textures, 0 to 1.
    texture: f64,
}

impl Courtyard {
    /// Returns the courtyard without its furniture, for views of this size, with disparities up to `d_max`
    /// px. It can be looked at from both cameras up to `margin_px` beyond their views.
    #[must_use]
    pub fn new(
        width_px: u32,
        height_px: u32,
        margin_px: u32,
        d_max: u16,
        seed: u64,
        texture: f64,
    ) -> Self {
        // Both halves of the seed count.
        let seed = (seed ^ (seed >> 32)) as u32;
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
        let side = f64::from(TILE_PX);
        // At least a tile: rays of anti-aliasing leave the image by less than 1 px.
        let margin = margin_px.div_ceil(TILE_PX).max(1);
        let tiles = |px: u32| (px.div_ceil(TILE_PX) + 2 * margin) as usize;
        let start = -f64::from(margin) * side;
        let tiles = || Grid::new(start, start, side, tiles(width_px), tiles(height_px));
        let sun = vec3(-0.55, 0.95, -0.80).unit();
        let across = sun.cross(vec3(0.0, 1.0, 0.0)).unit();
        Self {
            objects: Vec::new(),
            cameras,
            tiles: [tiles(), tiles()],
            disparity_metres,
            sun,
            sun_across: [across, across.cross(sun)],
            shadows: Grid::new(-8.0, -8.0, 0.125, 128, 128),
            seed,
            texture,
        }
    }

    /// Adds the furniture.
    pub fn furnish(&mut self) {
        let mut objects = furnish(self.seed);
        // Chance may let a leaf or twig grow out of the range of disparities.
        let camera = self.cameras[0];
        objects.retain(|object| {
            !matches!(object.material, Material::Leaf | Material::Stick)
                || object
                    .bound()
                    .is_some_and(|(centre, radius)| camera.depth(centre) - radius >= NEAREST)
        });
        for object in objects {
            self.add(object);
        }
    }

    /// Adds a flat textured wall whose plane is `distance` m from the left camera, turned by these angles, rad, about
    /// the columns and the lines; at 0 it is square to the optical axis.
    pub fn add_wall(&mut self, distance: f64, turned: [f64; 2]) {
        self.add(wall::wall(&self.cameras[0], distance, turned));
    }

    /// Adds a board of [`SQUARES`] with a white border, half of whose sides are [`half_sides_m`]. Its middle, m, and the
    /// directions of its long and its short side, of length 1, run along the columns, the lines and the optical axis of
    /// the left camera.
    pub fn add_board(&mut self, middle: [f64; 3], sides: [[f64; 3]; 2]) {
        self.add(board::board(&self.cameras[0], middle, sides));
    }

    /// Adds an object.
    fn add(&mut self, object: Object) {
        // There are some thousand objects.
        let index = self.objects.len() as u16;
        let bound = object.bound();
        for (tiles, camera) in self.tiles.iter_mut().zip(&self.cameras) {
            let extent = bound.and_then(|(centre, radius)| camera.extent(centre, radius));
            tiles.insert(
                index,
                extent.unwrap_or([f64::MIN, f64::MAX, f64::MIN, f64::MAX]),
            );
        }
        if let Some((centre, radius)) = bound {
            let [x, y] = self.sun_across.map(|axis| centre.dot(axis));
            let extent = [x - radius, x + radius, y - radius, y + radius];
            self.shadows.insert(index, extent);
        }
        self.objects.push(object);
    }

    /// Returns where the point of a left pixel is, seen from the left camera as if it were level: to the
    /// right, up and forward, m; `None` where the pixel shows nothing.
    #[must_use]
    pub fn point(&self, x: u32, y: u32) -> Option<[f64; 3]> {
        let seen = self.look(Side::Left, x.into(), y.into())?;
        Some(seen.from(self.cameras[0].position))
    }

    /// Returns the two cameras as a pair.
    #[must_use]
    pub fn rig(&self) -> RenderedCameras {
        let [left, right] = self.cameras;
        RenderedCameras {
            focal_px: left.focal_px,
            principal_px: left.principal_px(),
            baseline_mm: (right.position.x - left.position.x) * 1000.0,
            pitch_rad: PITCH_RAD,
        }
    }

    /// Returns the disparity of a point at this depth, px.
    #[must_use]
    pub fn disparity_px(&self, depth: f64) -> f64 {
        self.disparity_metres / depth
    }

    /// Returns what a camera sees at an image point; `None` where it sees nothing. The point may
    /// be outside the image by at most the margin, or a tile.
    #[must_use]
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

    /// Returns the mean linear light of each channel, not negative, over the pixel at `(x_px, y_px)`. It takes 4
    /// samples, and 16 more when the first ones meet different objects.
    ///
    /// `rectified_px` tells where in the rectified view of the camera a point of its picture is, px, or `None` where its
    /// lens does not reach; for a rectified picture it is `Some([x, y])`.
    #[must_use]
    pub fn exposed(
        &self,
        side: Side,
        x_px: f64,
        y_px: f64,
        rectified_px: &dyn Fn(f64, f64) -> Option<[f64; 2]>,
    ) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let mut count = 0.0;
        let mut sample = |dx: f64, dy: f64| {
            let [x_px, y_px] = rectified_px(x_px + dx, y_px + dy)?;
            let seen = self.look(side, x_px, y_px)?;
            for (sum, light) in sum.iter_mut().zip(self.light(&seen)) {
                *sum += light;
            }
            count += 1.0;
            Some(seen.object)
        };
        // A rotated square: no two samples share a column or a line.
        let objects = [
            sample(-0.125, -0.375),
            sample(0.375, -0.125),
            sample(0.125, 0.375),
            sample(-0.375, 0.125),
        ];
        if objects.iter().any(|&object| object != objects[0]) {
            for row in 0..4 {
                for column in 0..4 {
                    let place = |index: i32| (f64::from(index) - 1.5) * 0.25;
                    sample(place(column), place(row));
                }
            }
        }
        let scale = if count > 0.0 { 1.0 / count } else { 0.0 };
        sum.map(|light| light * scale)
    }

    /// Returns the linear light of each channel that a seen point sends to the cameras. It is
    /// equal for both cameras.
    fn light(&self, seen: &Seen) -> Colour {
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

    /// Returns whether an object is between a point and the sun.
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
