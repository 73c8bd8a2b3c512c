//! A built-in stereo scene with exact ground truth.
//!
//! A ray caster looks into a small courtyard with two rectified pinhole cameras. Geometry
//! is analytic and textures are functions of the surface point, so both views show the
//! same surfaces and the disparity of every pixel is known to sub-pixel accuracy. The
//! scene holds what makes stereo hard: slanted planes, curved surfaces, thin occluders, a
//! nearly blank wall, repeated patterns, shadows.
//!
//! Equal options give identical bits on every platform and with any number of threads.

mod distorted;
mod squares;
mod truth;

use core::f64::consts::TAU;

use anyhow::Result;
use image::RgbImage;
use rand_core::Rng;
use rand_pcg::Pcg32;
use rayon::prelude::*;
use vgstereo_core::geometry::{Depth, RectifiedCamera};
use vgstereo_courtyard::{Courtyard, Side};
pub use vgstereo_courtyard::{RenderedCameras, SQUARE_MM, SQUARES};

use crate::calibration::StereoCalibration;
use crate::exposure::Exposure;
use crate::line_offset::LINE_OFFSET_MAX_PX;
use crate::scene::{GroundTruth, Scene};
use distorted::Lookup;
use truth::ground_truth;

/// The smallest width and height of a rendered image, px; smaller ones are raised to it.
pub const SIDE_MIN_PX: u32 = 16;
/// The largest width and height of a rendered image, px; larger ones are lowered to it.
pub const SIDE_MAX_PX: u32 = 4096;

/// The options of [`render`]: the size of the views, the scene, and the two cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderOptions {
    /// The width of each view, px, [`SIDE_MIN_PX`] to [`SIDE_MAX_PX`].
    pub width: u32,
    /// The height of each view, px, [`SIDE_MIN_PX`] to [`SIDE_MAX_PX`].
    pub height: u32,
    /// The largest disparity, px, 1 to half the width. Disparities in the scene range from
    /// about a sixth of it to nearly all of it.
    pub d_max: u16,
    /// The seed of textures, plants and noise; the other objects keep their places.
    pub seed: u64,
    /// The contrast of the surfaces' textures, 0 to 1. At 1 textures are shown whole; at 0
    /// surfaces are evenly painted, under light and shadow.
    pub texture: f32,
    /// The standard deviation of the sensors' noise in each channel, grey levels, at least 0.
    pub noise: f32,
    /// The exposure of the right camera relative to the left one.
    pub exposure: Exposure,
    /// How far the right view is shifted down, px, from -[`LINE_OFFSET_MAX_PX`] to
    /// [`LINE_OFFSET_MAX_PX`]. Other than at 0, epipolar lines are not scanlines. The ground
    /// truth remains that of aligned cameras.
    pub line_offset_px: f32,
}

impl Default for RenderOptions {
    /// Returns 480 x 360 px, disparities up to 47 px, slight noise and equal exposure.
    fn default() -> Self {
        Self {
            width: 480,
            height: 360,
            d_max: 47,
            seed: 1,
            texture: 1.0,
            noise: 1.5,
            exposure: Exposure::EQUAL,
            line_offset_px: 0.0,
        }
    }
}

/// Returns the two rectified cameras of a scene that is rendered with these options.
#[must_use]
pub fn rendered_cameras(options: &RenderOptions) -> RenderedCameras {
    let (yard, ..) = bare_courtyard(options, 0.0);
    yard.rig()
}

/// Returns the left or the right of two cameras, which are alike, in the core's whole numbers; `None` where one of these
/// is out of its range.
#[must_use]
pub fn rectified_camera(cameras: &RenderedCameras) -> Option<RectifiedCamera> {
    // Casts saturate, and what is out of range gives no camera.
    let q8 = |px: f64| (px * 256.0).round();
    let depth = Depth::new(q8(cameras.focal_px * cameras.baseline_mm) as u32, 0)?;
    let principal_q8 = cameras.principal_px.map(|px| q8(px) as i32);
    RectifiedCamera::new(depth, q8(cameras.focal_px) as u32, principal_q8)
}

/// Returns where the point of each left pixel is, row-major, seen from the left camera as if it were
/// level: to the right, up and forward, m. `None` where a pixel shows nothing.
#[must_use]
pub fn surface_points(options: &RenderOptions) -> Vec<Option<[f64; 3]>> {
    let (yard, width, height, _) = courtyard(options, 0.0);
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels.map(|(x, y)| yard.point(x, y)).collect()
}

/// Returns the scene, which can be looked at beyond its views by a part of their width, and its width,
/// height and largest disparity, px, in their ranges.
fn courtyard(options: &RenderOptions, margin_widths: f64) -> (Courtyard, u32, u32, u16) {
    let (mut yard, width, height, d_max) = bare_courtyard(options, margin_widths);
    yard.furnish();
    (yard, width, height, d_max)
}

/// As [`courtyard()`], with nothing in it.
fn bare_courtyard(options: &RenderOptions, margin_widths: f64) -> (Courtyard, u32, u32, u16) {
    let width = options.width.clamp(SIDE_MIN_PX, SIDE_MAX_PX);
    let height = options.height.clamp(SIDE_MIN_PX, SIDE_MAX_PX);
    // Half of SIDE_MAX_PX fits.
    let d_max = options.d_max.clamp(1, (width / 2) as u16);
    let texture = finite(options.texture, RenderOptions::default().texture).clamp(0.0, 1.0);
    let margin = (margin_widths * f64::from(width)) as u32;
    let yard = Courtyard::new(width, height, margin, d_max, options.seed, texture.into());
    (yard, width, height, d_max)
}

fn finite(value: f32, otherwise: f32) -> f32 {
    if value.is_finite() { value } else { otherwise }
}

/// How one camera turns light into grey levels.
struct Sensor {
    exposure: Exposure,
    /// The standard deviation of the noise, grey levels.
    noise: f64,
    seed: u64,
    /// A number, 0 or 1, that makes the noise of the two cameras differ.
    stream: u64,
}

impl Sensor {
    /// The sensor of the left camera, which is exposed as the scene is.
    fn left(options: &RenderOptions) -> Self {
        let noise = finite(options.noise, RenderOptions::default().noise).max(0.0);
        Self {
            exposure: Exposure::EQUAL,
            noise: noise.into(),
            seed: options.seed,
            stream: 0,
        }
    }

    /// The sensor of the right camera.
    fn right(options: &RenderOptions) -> Self {
        let exposure = options.exposure;
        Self {
            exposure: Exposure {
                gain: finite(exposure.gain, 1.0),
                gain_gradient: finite(exposure.gain_gradient, 0.0),
                offset: finite(exposure.offset, 0.0),
                offset_gradient: finite(exposure.offset_gradient, 0.0),
            },
            stream: 1,
            ..Self::left(options)
        }
    }

    /// Returns the picture of what has this light at each column and line. Its lines are made in parallel.
    fn picture(
        &self,
        width: u32,
        height: u32,
        light: impl Fn(usize, usize) -> [f64; 3] + Sync,
    ) -> RgbImage {
        let mut image = RgbImage::new(width, height);
        let line_bytes = width as usize * 3;
        image
            .par_chunks_exact_mut(line_bytes)
            .enumerate()
            .for_each(|(y, line)| {
                // Images have at most SIDE_MAX_PX lines.
                let (gain, offset) = self.exposure.of_line(y as u32, height);
                // Each line has its own generator: the order of lines does not matter.
                let stream = (y as u64) << 1 | self.stream;
                let mut random = Pcg32::new(self.seed, stream);
                for (x, pixel) in line.chunks_exact_mut(3).enumerate() {
                    for (channel, light) in pixel.iter_mut().zip(light(x, y)) {
                        let mut grey = 255.0 * light.min(1.0).sqrt() * gain + offset;
                        if self.noise > 0.0 {
                            grey += self.noise * gaussian(&mut random);
                        }
                        // The cast saturates.
                        *channel = (grey + 0.5) as u8;
                    }
                }
            });
        image
    }
}

/// Renders the built-in scene and returns it with the ground truth of both views and all masks.
///
/// Sizes and `d_max` outside their ranges are clamped. Numbers that are not finite are replaced
/// by their defaults.
#[must_use]
pub fn render(options: &RenderOptions) -> Scene {
    let (yard, width, height, d_max) = courtyard(options, 0.0);
    let views = views(&yard, options, [None, None], width, height);
    scene(views, ground_truth(&yard, width, height), d_max)
}

/// The built-in scene with the light of its right view, of which pictures with any exposure are made. Light takes most of
/// the time that it takes to render.
#[derive(Debug)]
pub struct Exposures {
    options: RenderOptions,
    left: RgbImage,
    /// The light of each channel at each pixel of the right view, row-major.
    right: Vec<[f64; 3]>,
    truth: GroundTruth,
    d_max: u16,
}

impl Exposures {
    /// Renders the scene of these options, but for the exposure.
    #[must_use]
    pub fn new(options: &RenderOptions) -> Self {
        let (yard, width, height, d_max) = courtyard(options, 0.0);
        let left = light(&yard, Side::Left, None, 0.0);
        let left = Sensor::left(options).picture(width, height, left);
        let of_pixel = light(&yard, Side::Right, None, options.line_offset_px);
        let columns = width as usize;
        let pixels = (0..columns * height as usize).into_par_iter();
        Self {
            options: *options,
            left,
            right: pixels
                .map(|at| of_pixel(at % columns, at / columns))
                .collect(),
            truth: ground_truth(&yard, width, height),
            d_max,
        }
    }

    /// Returns the scene that [`render`] makes with this exposure of the right camera.
    #[must_use]
    pub fn scene(&self, exposure: Exposure) -> Scene {
        let (width, height) = self.left.dimensions();
        let options = RenderOptions {
            exposure,
            ..self.options
        };
        let columns = width as usize;
        let right = Sensor::right(&options);
        let right = right.picture(width, height, |x, y| self.right[y * columns + x]);
        scene([self.left.clone(), right], self.truth.clone(), self.d_max)
    }
}

/// Renders the built-in scene as [`render`] does, but through two real cameras, and returns it with their
/// calibration, whose unit is mm and whose stored rectification leads to the views of [`render`]. The
/// truth and the masks are those of the rectified views.
///
/// # Errors
/// Fails when the cameras of such views are out of the range of a calibration.
pub fn render_distorted(options: &RenderOptions) -> Result<(Scene, StereoCalibration)> {
    let (yard, width, height, d_max) = courtyard(options, distorted::MARGIN_WIDTHS);
    let size = [u16::try_from(width)?, u16::try_from(height)?];
    let calibration = distorted::calibration(&yard.rig(), size)?;
    let left = Lookup::new(&calibration, size, 0)?;
    let right = Lookup::new(&calibration, size, 1)?;
    let lookups = [Some(&left), Some(&right)];
    let views = views(&yard, options, lookups, width, height);
    let scene = scene(views, ground_truth(&yard, width, height), d_max);
    Ok((scene, calibration))
}

/// The pictures by which the cameras of [`render_distorted`] are calibrated: a board of [`SQUARES`] squares
/// in many poses before the built-in scene, and the calibration that is true.
#[derive(Debug)]
pub struct BoardPictures {
    options: RenderOptions,
    /// The calibration of [`render_distorted`] with the same options.
    pub calibration: StereoCalibration,
}

impl BoardPictures {
    /// Returns the pictures for cameras of these options.
    ///
    /// # Errors
    /// Fails as [`render_distorted`] does.
    pub fn new(options: &RenderOptions) -> Result<Self> {
        let (yard, width, height, _) = bare_courtyard(options, 0.0);
        let size = [u16::try_from(width)?, u16::try_from(height)?];
        Ok(Self {
            options: *options,
            calibration: distorted::calibration(&yard.rig(), size)?,
        })
    }

    /// Renders the left and the right picture of a pose, whose board is whole in both.
    ///
    /// # Errors
    /// Fails when the cameras see no pose whole.
    pub fn render(&self, pose: u32) -> Result<[RgbImage; 2]> {
        let options = &self.options;
        let (mut yard, width, height, _) = courtyard(options, distorted::MARGIN_WIDTHS);
        let size = [u16::try_from(width)?, u16::try_from(height)?];
        let left = Lookup::new(&self.calibration, size, 0)?;
        let right = Lookup::new(&self.calibration, size, 1)?;
        let baseline = yard.rig().baseline_mm / 1000.0;
        let (middle, sides) = squares::pose(left.pair(), baseline, options.seed, pose)?;
        yard.add_board(middle, sides);
        Ok(views(
            &yard,
            options,
            [Some(&left), Some(&right)],
            width,
            height,
        ))
    }
}

/// Renders a flat textured wall whose plane is `distance_mm` from the left camera, turned about the columns
/// and the lines by these angles, degrees, as the two cameras of [`rendered_cameras`] see it. `frame`
/// makes another sensor noise.
#[must_use]
pub fn render_wall(
    options: &RenderOptions,
    distance_mm: f64,
    turned_degrees: [f64; 2],
    frame: u32,
) -> [RgbImage; 2] {
    let (mut yard, width, height, _) = bare_courtyard(options, 0.0);
    let turned = turned_degrees.map(f64::to_radians);
    yard.add_wall(distance_mm / 1000.0, turned);
    let noisy = RenderOptions {
        seed: options.seed ^ u64::from(frame) << 32,
        ..*options
    };
    views(&yard, &noisy, [None, None], width, height)
}

/// Returns the scene of these views.
fn scene([left, right]: [RgbImage; 2], truth: GroundTruth, d_max: u16) -> Scene {
    Scene {
        name: "courtyard".to_owned(),
        left,
        right,
        bits: None,
        d_max,
        truth: Some(truth),
    }
}

/// Returns the left and the right view.
fn views(
    yard: &Courtyard,
    options: &RenderOptions,
    [left_lookup, right_lookup]: [Option<&Lookup>; 2],
    width: u32,
    height: u32,
) -> [RgbImage; 2] {
    let left = light(yard, Side::Left, left_lookup, 0.0);
    let right = light(yard, Side::Right, right_lookup, options.line_offset_px);
    [
        Sensor::left(options).picture(width, height, left),
        Sensor::right(options).picture(width, height, right),
    ]
}

/// Returns the light of each channel at a column and line of a picture that is shifted down by so many px. `lookup`
/// says where its pixels look; without, it is rectified.
fn light<'a>(
    yard: &'a Courtyard,
    side: Side,
    lookup: Option<&'a Lookup>,
    line_offset_px: f32,
) -> impl Fn(usize, usize) -> [f64; 3] + Sync + 'a {
    let line_offset_px = finite(line_offset_px, 0.0).clamp(-LINE_OFFSET_MAX_PX, LINE_OFFSET_MAX_PX);
    let line_offset_px = f64::from(line_offset_px);
    let rectified_px = move |x_px, y_px| match lookup {
        Some(lookup) => lookup.rectified_px(x_px, y_px),
        None => Some([x_px, y_px]),
    };
    move |x, y| yard.exposed(side, x as f64, y as f64 - line_offset_px, &rectified_px)
}

/// Returns a normally distributed number with mean 0 and standard deviation 1 (Box-Muller).
fn gaussian(random: &mut Pcg32) -> f64 {
    // The number under the logarithm is above 0, so that the logarithm is finite.
    let radius = (f64::from(random.next_u32()) + 1.0) / 4_294_967_296.0;
    let angle = f64::from(random.next_u32()) / 4_294_967_296.0 * TAU;
    (-2.0 * libm::log(radius)).sqrt() * libm::cos(angle)
}

#[cfg(test)]
mod tests;
