//! A built-in stereo scene with exact ground truth.
//!
//! A ray caster looks into a small courtyard with two rectified pinhole cameras. Geometry
//! is analytic and textures are functions of the surface point, so both views show the
//! same surfaces and the disparity of every pixel is known to sub-pixel accuracy. The
//! scene holds what makes stereo hard: slanted planes, curved surfaces, thin occluders, a
//! nearly blank wall, repeated patterns, shadows.
//!
//! The same options give the same bits on every platform and any number of threads.

mod courtyard;
mod geometry;
mod texture;

use core::f64::consts::TAU;

use image::RgbImage;
use rand_core::Rng;
use rand_pcg::Pcg32;
use rayon::prelude::*;

use crate::exposure::Exposure;
use crate::line_offset::LINE_OFFSET_MAX_PX;
use crate::scene::{GroundTruth, Mask, Scene};
use courtyard::{Courtyard, Side};

/// Shortest side of a rendered image, px; shorter ones are widened to it.
pub const SIDE_MIN_PX: u32 = 16;
/// Longest side of a rendered image, px; longer ones are cut to it.
pub const SIDE_MAX_PX: u32 = 4096;

/// A jump of disparity between neighbours that makes a discontinuity, px.
const JUMP_PX: f32 = 1.5;
/// A discontinuity reaches this far, px: windows of 9 x 9.
const JUMP_REACH_PX: usize = 4;

/// What to render and how the two cameras see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderOptions {
    /// Width of each view, px, [`SIDE_MIN_PX`] to [`SIDE_MAX_PX`].
    pub width: u32,
    /// Height of each view, px, same range.
    pub height: u32,
    /// Largest disparity, px, 1 to half the width. The scene uses the range from about a
    /// sixth of it.
    pub d_max: u16,
    /// Varies textures, plants and noise; objects keep their places.
    pub seed: u64,
    /// Contrast of the surfaces' textures, 0 to 1: at 1 as they are, at 0 bare paint under
    /// light and shadow.
    pub texture: f32,
    /// Standard deviation of the noise of each channel, grey levels of 255, not negative.
    pub noise: f32,
    /// Exposure of the right camera; the left one's is [`Exposure::EQUAL`].
    pub exposure: Exposure,
    /// By how much the right camera's lines lie too low, px, at most
    /// [`LINE_OFFSET_MAX_PX`] either way; the truth is that of aligned cameras.
    pub line_offset_px: f32,
}

impl Default for RenderOptions {
    /// 480 x 360 px, disparities up to 47 px, slight noise, equal exposure.
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

/// How one camera turns light into grey levels.
struct Sensor {
    exposure: Exposure,
    noise: f64,
    seed: u64,
    stream: u64,
    line_offset_px: f64,
}

/// Renders the scene with ground truth for both views and all masks.
///
/// Sizes and `d_max` outside their ranges are clamped; numbers that are not finite count
/// as their default.
#[must_use]
pub fn render(options: &RenderOptions) -> Scene {
    let width = options.width.clamp(SIDE_MIN_PX, SIDE_MAX_PX);
    let height = options.height.clamp(SIDE_MIN_PX, SIDE_MAX_PX);
    // Half of SIDE_MAX_PX fits.
    let d_max = options.d_max.clamp(1, (width / 2) as u16);
    let finite = |value: f32, otherwise: f32| {
        if value.is_finite() { value } else { otherwise }
    };
    let texture = finite(options.texture, RenderOptions::default().texture).clamp(0.0, 1.0);
    let yard = Courtyard::new(width, height, d_max, options.seed, texture.into());
    let noise = finite(options.noise, RenderOptions::default().noise).max(0.0);
    let left = Sensor {
        exposure: Exposure::EQUAL,
        noise: f64::from(noise),
        seed: options.seed,
        stream: 0,
        line_offset_px: 0.0,
    };
    let right = Sensor {
        exposure: Exposure {
            gain: finite(options.exposure.gain, 1.0),
            gain_gradient: finite(options.exposure.gain_gradient, 0.0),
            offset: finite(options.exposure.offset, 0.0),
            offset_gradient: finite(options.exposure.offset_gradient, 0.0),
        },
        stream: 1,
        line_offset_px: finite(options.line_offset_px, 0.0)
            .clamp(-LINE_OFFSET_MAX_PX, LINE_OFFSET_MAX_PX)
            .into(),
        ..left
    };
    Scene {
        name: "courtyard".to_owned(),
        left: view(&yard, Side::Left, &left, width, height),
        right: view(&yard, Side::Right, &right, width, height),
        d_max,
        truth: Some(ground_truth(&yard, width, height)),
    }
}

/// Fills an image's lines in parallel.
fn view(yard: &Courtyard, side: Side, sensor: &Sensor, width: u32, height: u32) -> RgbImage {
    let mut image = RgbImage::new(width, height);
    let line_bytes = width as usize * 3;
    image
        .par_chunks_exact_mut(line_bytes)
        .enumerate()
        .for_each(|(y, line)| {
            let y_px = y as f64 - sensor.line_offset_px;
            // Images have at most SIDE_MAX_PX lines.
            let (gain, offset) = sensor.exposure.of_line(y as u32, height);
            // Each line has its own generator: the order of lines does not matter.
            let stream = (y as u64) << 1 | sensor.stream;
            let mut random = Pcg32::new(sensor.seed, stream);
            for (x, pixel) in line.chunks_exact_mut(3).enumerate() {
                let light = exposed(yard, side, x as f64, y_px);
                for (channel, light) in pixel.iter_mut().zip(light) {
                    let mut grey = 255.0 * light.min(1.0).sqrt() * gain + offset;
                    if sensor.noise > 0.0 {
                        grey += sensor.noise * gaussian(&mut random);
                    }
                    // The cast saturates.
                    *channel = (grey + 0.5) as u8;
                }
            }
        });
    image
}

/// A number with mean 0 and standard deviation 1 (Box-Muller).
fn gaussian(random: &mut Pcg32) -> f64 {
    // The first of 0 < x <= 1, where the logarithm is finite.
    let radius = (f64::from(random.next_u32()) + 1.0) / 4_294_967_296.0;
    let angle = f64::from(random.next_u32()) / 4_294_967_296.0 * TAU;
    (-2.0 * libm::log(radius)).sqrt() * libm::cos(angle)
}

/// The mean light over a pixel: 4 samples, 16 more where they meet several objects.
fn exposed(yard: &Courtyard, side: Side, x_px: f64, y_px: f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    let mut sample = |dx: f64, dy: f64| {
        let seen = yard.look(side, x_px + dx, y_px + dy)?;
        for (sum, light) in sum.iter_mut().zip(yard.light(&seen)) {
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

/// Casts one ray per pixel centre.
fn ground_truth(yard: &Courtyard, width: u32, height: u32) -> GroundTruth {
    let columns = width as usize;
    let pixels = columns * height as usize;
    let disparity = |side: Side, x: usize, y: usize| {
        yard.look(side, x as f64, y as f64)
            .map_or(f32::NAN, |seen| yard.disparity_px(seen.depth) as f32)
    };
    let mut left_px = vec![f32::NAN; pixels];
    let mut right_px = vec![f32::NAN; pixels];
    let mut nonocc = vec![false; pixels];
    left_px
        .par_chunks_exact_mut(columns)
        .zip(right_px.par_chunks_exact_mut(columns))
        .zip(nonocc.par_chunks_exact_mut(columns))
        .enumerate()
        .for_each(|(y, ((left, right), nonocc))| {
            for (x, ((left, right), nonocc)) in left.iter_mut().zip(right).zip(nonocc).enumerate() {
                *right = disparity(Side::Right, x, y);
                let Some(seen) = yard.look(Side::Left, x as f64, y as f64) else {
                    continue;
                };
                let d_px = yard.disparity_px(seen.depth);
                *left = d_px as f32;
                let x_right_px = x as f64 - d_px;
                // The right camera's ray to the same point must not end before it.
                *nonocc = x_right_px >= 0.0
                    && yard
                        .look(Side::Right, x_right_px, y as f64)
                        .is_some_and(|other| other.depth >= seen.depth * (1.0 - 1e-6));
            }
        });
    let all: Vec<bool> = left_px.iter().map(|d| d.is_finite()).collect();
    let near = near_jumps(&left_px, columns);
    let disc: Vec<bool> = nonocc.iter().zip(near).map(|(&a, b)| a && b).collect();
    GroundTruth {
        left_px,
        right_px: Some(right_px),
        nonocc: Some(Mask::from(nonocc)),
        all: Some(Mask::from(all)),
        disc: Some(Mask::from(disc)),
    }
}

/// The pixels within [`JUMP_REACH_PX`] columns and lines of a jump between neighbours.
fn near_jumps(disparity_px: &[f32], columns: usize) -> Vec<bool> {
    let jump = |a: f32, b: f32| (a - b).abs() > JUMP_PX;
    let mut jumps = vec![false; disparity_px.len()];
    for (index, &here) in disparity_px.iter().enumerate() {
        let right = index + 1;
        if right % columns != 0 && jump(here, disparity_px[right]) {
            jumps[index] = true;
            jumps[right] = true;
        }
        let below = index + columns;
        if below < disparity_px.len() && jump(here, disparity_px[below]) {
            jumps[index] = true;
            jumps[below] = true;
        }
    }
    // A square window is a window along lines, then one along columns.
    let mut wide = vec![false; jumps.len()];
    for (line, wide) in jumps
        .chunks_exact(columns)
        .zip(wide.chunks_exact_mut(columns))
    {
        for (x, wide) in wide.iter_mut().enumerate() {
            let from = x.saturating_sub(JUMP_REACH_PX);
            let to = (x + JUMP_REACH_PX + 1).min(columns);
            *wide = line[from..to].contains(&true);
        }
    }
    let lines = wide.len() / columns;
    let mut near = vec![false; wide.len()];
    for (y, near) in near.chunks_exact_mut(columns).enumerate() {
        let from = y.saturating_sub(JUMP_REACH_PX);
        let to = (y + JUMP_REACH_PX + 1).min(lines);
        for line in wide[from * columns..to * columns].chunks_exact(columns) {
            for (near, &wide) in near.iter_mut().zip(line) {
                *near |= wide;
            }
        }
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Small, and free of noise so that colours can be compared.
    const CLEAN: RenderOptions = RenderOptions {
        width: 240,
        height: 180,
        d_max: 31,
        seed: 7,
        texture: 1.0,
        noise: 0.0,
        exposure: Exposure::EQUAL,
        line_offset_px: 0.0,
    };

    struct Parts {
        left_px: Vec<f32>,
        right_px: Vec<f32>,
        nonocc: Mask,
        all: Mask,
        disc: Mask,
    }

    fn parts(scene: &Scene) -> Parts {
        let truth = scene.truth.clone().unwrap();
        Parts {
            left_px: truth.left_px,
            right_px: truth.right_px.unwrap(),
            nonocc: truth.nonocc.unwrap(),
            all: truth.all.unwrap(),
            disc: truth.disc.unwrap(),
        }
    }

    /// Everything rendered, as bits: NaN equals NaN.
    #[derive(PartialEq)]
    struct Bits {
        left: Vec<u8>,
        right: Vec<u8>,
        left_px: Vec<u32>,
        right_px: Vec<u32>,
        masks: [Mask; 3],
    }

    fn bits(scene: &Scene) -> Bits {
        let parts = parts(scene);
        let bits = |map: Vec<f32>| map.into_iter().map(f32::to_bits).collect();
        Bits {
            left: scene.left.as_raw().clone(),
            right: scene.right.as_raw().clone(),
            left_px: bits(parts.left_px),
            right_px: bits(parts.right_px),
            masks: [parts.nonocc, parts.all, parts.disc],
        }
    }

    fn mean(image: &RgbImage, lines: core::ops::Range<u32>) -> f64 {
        let bytes = image.width() as usize * 3;
        let raw = &image.as_raw()[lines.start as usize * bytes..lines.end as usize * bytes];
        raw.iter().map(|&grey| f64::from(grey)).sum::<f64>() / raw.len() as f64
    }

    #[test]
    fn same_options_same_bits_on_any_number_of_threads() {
        let options = RenderOptions {
            noise: 2.0,
            ..CLEAN
        };
        let expected = bits(&render(&options));
        assert!(bits(&render(&options)) == expected);
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            assert!(bits(&pool.install(|| render(&options))) == expected);
        }
        let other = render(&RenderOptions { seed: 8, ..options });
        assert!(bits(&other).left != expected.left);
    }

    /// Fails where a platform or a change of the renderer moves a bit. The sums come from
    /// this renderer on x86-64 Linux.
    #[test]
    fn bits_are_those_recorded() {
        let scene = render(&RenderOptions {
            noise: 2.0,
            ..RenderOptions::default()
        });
        let Bits {
            left,
            right,
            left_px,
            right_px,
            ..
        } = bits(&scene);
        // FNV-1a, 32 bits.
        let sum = |bytes: &mut dyn Iterator<Item = u8>| {
            bytes.fold(0x811C_9DC5_u32, |sum, byte| {
                (sum ^ u32::from(byte)).wrapping_mul(0x0100_0193)
            })
        };
        let sums = [
            sum(&mut left.into_iter()),
            sum(&mut right.into_iter()),
            sum(&mut left_px.into_iter().flat_map(u32::to_le_bytes)),
            sum(&mut right_px.into_iter().flat_map(u32::to_le_bytes)),
        ];
        assert_eq!(
            sums,
            [0xEE83_4EB5, 0xE03E_4D0A, 0xDA55_1550, 0x7428_2DB1],
            "{sums:#010X?}"
        );
    }

    #[test]
    fn disparities_fill_the_range() {
        for seed in 0..6 {
            for (width, height, d_max) in [(160, 120, 31), (240, 180, 47), (120, 200, 20)] {
                let scene = render(&RenderOptions {
                    width,
                    height,
                    d_max,
                    seed,
                    ..CLEAN
                });
                let Parts {
                    left_px, right_px, ..
                } = parts(&scene);
                let (mut low, mut high) = (f32::INFINITY, 0.0_f32);
                for &d in left_px.iter().chain(&right_px) {
                    assert!(d.is_finite(), "seed {seed}");
                    low = low.min(d);
                    high = high.max(d);
                }
                let limit = f32::from(d_max);
                assert!(low >= 1.0 && high <= limit, "seed {seed}: {low}..{high}");
                assert!(low < 0.25 * limit && high > 0.85 * limit, "{low}..{high}");
            }
        }
    }

    #[test]
    fn masks_are_nested_and_not_trivial() {
        let scene = render(&CLEAN);
        let Parts {
            left_px,
            nonocc,
            all,
            disc,
            ..
        } = parts(&scene);
        for (index, d) in left_px.iter().enumerate() {
            assert!(nonocc[index] || !disc[index]);
            assert!(all[index] || !nonocc[index]);
            assert_eq!(all[index], d.is_finite());
            // Points left of the right image are not visible in it.
            let x = index % 240;
            assert!(x as f32 >= *d - 1e-3 || !nonocc[index]);
        }
        assert!(disc.count() > all.count() / 20);
        assert!(nonocc.count() > disc.count() * 2);
        // Occluded inside the image, beyond the columns the right view lacks.
        let hidden = (0..left_px.len())
            .filter(|&index| !nonocc[index] && index % 240 > 31)
            .count();
        assert!(hidden > all.count() / 100, "{hidden}");
    }

    #[test]
    fn views_agree_on_visible_points() {
        let scene = render(&CLEAN);
        let Parts {
            left_px,
            right_px,
            nonocc,
            disc,
            ..
        } = parts(&scene);
        let (mut checked, mut agreed, mut smooth, mut smooth_agreed) = (0, 0, 0, 0);
        for (index, &d) in left_px.iter().enumerate().filter(|&(i, _)| nonocc[i]) {
            let x_right = (index % 240) as f32 - d;
            let base = index - index % 240 + x_right as usize;
            let next = if x_right.fract() > 0.0 {
                base + 1
            } else {
                base
            };
            let share = x_right.fract();
            let seen = right_px[base] * (1.0 - share) + right_px[next] * share;
            let agrees = (seen - d).abs() < 0.05;
            checked += 1;
            agreed += usize::from(agrees);
            if !disc[index] {
                smooth += 1;
                smooth_agreed += usize::from(agrees);
            }
        }
        // Next to an edge of the right view its neighbours lie on two surfaces. The far side
        // of an occluded stretch is such an edge, and no discontinuity of the left view.
        assert!(
            agreed * 100 > checked * 93,
            "{agreed} of {checked} visible pixels"
        );
        assert!(
            smooth_agreed * 100 > smooth * 98,
            "{smooth_agreed} of {smooth} pixels off discontinuities"
        );
    }

    #[test]
    fn truth_warps_the_right_view_to_the_left() {
        let scene = render(&CLEAN);
        let Parts {
            left_px, nonocc, ..
        } = parts(&scene);
        let error = |shift: f32| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (index, &d) in left_px.iter().enumerate().filter(|&(i, _)| nonocc[i]) {
                let (x, y) = (index % 240, (index / 240) as u32);
                let x_right = x as f32 - d - shift;
                if !(2.0..=236.0).contains(&x_right) {
                    continue;
                }
                let share = x_right.fract();
                let base = x_right as u32;
                for channel in 0..3 {
                    let at = |x: u32| f32::from(scene.right.get_pixel(x, y).0[channel]);
                    let warped = at(base) * (1.0 - share) + at(base + 1) * share;
                    let left = scene.left.get_pixel(x as u32, y).0[channel];
                    sum += (warped - f32::from(left)).abs();
                    count += 1.0;
                }
            }
            sum / count
        };
        let (exact, nearer, farther) = (error(0.0), error(2.0), error(-2.0));
        assert!(exact < 8.0, "{exact}");
        assert!(nearer > exact * 2.0, "{nearer} against {exact}");
        assert!(farther > exact * 2.0, "{farther} against {exact}");
    }

    #[test]
    fn exposure_changes_the_right_view_alone() {
        let clean = render(&CLEAN);
        let exposed = render(&RenderOptions {
            exposure: Exposure {
                gain: 0.8,
                offset: 10.0,
                ..Exposure::EQUAL
            },
            ..CLEAN
        });
        assert_eq!(exposed.left, clean.left);
        for (&after, &before) in exposed.right.as_raw().iter().zip(clean.right.as_raw()) {
            let expected = f32::from(before) * 0.8 + 10.0;
            assert!((f32::from(after) - expected).abs() <= 1.0);
        }
        let graded = render(&RenderOptions {
            exposure: Exposure {
                gain_gradient: 0.4,
                ..Exposure::EQUAL
            },
            ..CLEAN
        });
        assert_eq!(graded.left, clean.left);
        let ratio = |lines: core::ops::Range<u32>| {
            mean(&graded.right, lines.clone()) / mean(&clean.right, lines)
        };
        assert!((ratio(0..4) - 0.8).abs() < 0.02, "{}", ratio(0..4));
        assert!((ratio(88..92) - 1.0).abs() < 0.02, "{}", ratio(88..92));
        assert!(ratio(176..180) > 1.1, "{}", ratio(176..180));
    }

    #[test]
    fn without_texture_edges_and_shadows_are_left() {
        let steps = |texture: f32| -> Vec<u8> {
            let scene = render(&RenderOptions { texture, ..CLEAN });
            let grey = image::DynamicImage::from(scene.left).into_luma8();
            let lines = grey
                .rows()
                .map(|line| line.map(|p| p.0[0]).collect::<Vec<u8>>());
            let lines = lines.flat_map(|line| {
                line.windows(2)
                    .map(|w| w[0].abs_diff(w[1]))
                    .collect::<Vec<_>>()
            });
            let mut steps: Vec<u8> = lines.collect();
            steps.sort_unstable();
            steps
        };
        let [whole, half, bare] = [1.0, 0.5, 0.0].map(steps);
        let median = |steps: &[u8]| steps[steps.len() / 2];
        assert!(median(&whole) >= 4, "{}", median(&whole));
        let halved = median(&whole).div_ceil(2);
        assert!(median(&half).abs_diff(halved) <= 1, "{}", median(&half));
        assert_eq!(median(&bare), 0);
        assert!(*bare.last().unwrap() > 50);
    }

    #[test]
    fn noise_has_its_deviation_and_differs_between_views() {
        let clean = render(&CLEAN);
        let noisy = render(&RenderOptions {
            noise: 4.0,
            ..CLEAN
        });
        let residuals = |noisy: &RgbImage, clean: &RgbImage| -> Vec<f64> {
            noisy
                .as_raw()
                .iter()
                .zip(clean.as_raw())
                // Grey levels near the ends saturate.
                .map(|(&after, &before)| {
                    if (30..225).contains(&before) {
                        f64::from(after) - f64::from(before)
                    } else {
                        0.0
                    }
                })
                .collect()
        };
        let left = residuals(&noisy.left, &clean.left);
        let right = residuals(&noisy.right, &clean.right);
        for view in [&left, &right] {
            let used: Vec<f64> = view.iter().copied().filter(|&r| r != 0.0).collect();
            let square = used.iter().map(|r| r * r).sum::<f64>() / used.len() as f64;
            // Without the zeros, which a deviation of 4 rounds to in a tenth of the cases.
            assert!((square.sqrt() - 4.2).abs() < 0.2, "{}", square.sqrt());
        }
        let product: f64 = left.iter().zip(&right).map(|(a, b)| a * b).sum();
        let covariance = product / left.len() as f64;
        assert!(covariance.abs() < 0.3, "{covariance}");
    }

    #[test]
    fn odd_and_extreme_options_render() {
        let odd = render(&RenderOptions {
            width: 161,
            height: 123,
            ..CLEAN
        });
        assert_eq!(odd.left.dimensions(), (161, 123));
        assert_eq!(odd.right.dimensions(), (161, 123));
        assert_eq!(parts(&odd).left_px.len(), 161 * 123);
        let nothing = render(&RenderOptions {
            width: 0,
            height: 0,
            d_max: 0,
            noise: f32::NAN,
            exposure: Exposure {
                gain: f32::INFINITY,
                gain_gradient: f32::NAN,
                offset: f32::NEG_INFINITY,
                offset_gradient: f32::NAN,
            },
            ..CLEAN
        });
        assert_eq!(nothing.left.dimensions(), (SIDE_MIN_PX, SIDE_MIN_PX));
        assert_eq!(nothing.d_max, 1);
        let much = render(&RenderOptions {
            width: 33,
            height: 200,
            d_max: u16::MAX,
            noise: f32::MAX,
            exposure: Exposure {
                gain: f32::MAX,
                offset: f32::MIN,
                ..Exposure::EQUAL
            },
            ..CLEAN
        });
        assert_eq!(much.d_max, 16);
    }
}
