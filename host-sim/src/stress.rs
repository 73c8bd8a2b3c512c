//! Disturbances of a scene, as cameras, lamps, transport and the world make them, each of a kind and an
//! amount.
//!
//! They change the pictures and leave the truth as it is, but for what is painted onto surfaces: there
//! the truth is cut to the painted part, which is then what figures are of.

use std::f32::consts::TAU;
use std::io::Cursor;

use anyhow::{Context, Result};
use image::codecs::jpeg::JpegEncoder;
use image::{ImageFormat, Rgb, RgbImage, imageops};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg32;

use crate::exposure::Exposure;
use crate::line_offset::{LINE_OFFSET_MAX_PX, lowered};
use crate::scene::{Mask, Scene};

/// A kind of disturbance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Both views lose contrast: the amount is what is left of it, about a level of 128.
    Texture,
    /// Noise of both sensors: its standard deviation, grey levels.
    Noise,
    /// The right view is out of focus: the standard deviation of the blur, px.
    Blur,
    /// The right view's levels have another gamma.
    Gamma,
    /// Both views are darker in the corners: by this share.
    Vignetting,
    /// The right view's red has this gain, and its blue the inverse one.
    WhiteBalance,
    /// The right view has this gain.
    Gain,
    /// The right view has this black level, grey levels.
    BlackLevel,
    /// The right view's lines lie lower, px.
    LineOffset,
    /// The right camera is turned about its axis, degrees.
    Roll,
    /// The right view is larger, percent.
    Scale,
    /// Mains light that flickers at 16 lines, in another phase in either view: its amplitude, percent.
    Bands,
    /// Noise of whole rows, in either view: its standard deviation, grey levels.
    RowNoise,
    /// Both views were stored as JPEG of this quality.
    Jpeg,
    /// Both views are overexposed: their gain.
    Clipped,
    /// Surfaces in the middle have stripes of this period, px, that are the same in both views.
    Periodic,
    /// Surfaces in the middle have one level, this one.
    Plain,
    /// The right view, or with an amount below 0 the left one, has no colour.
    OneGrey,
}

/// A disturbance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stress {
    /// Its kind.
    pub kind: Kind,
    /// How much of it, as the kind says.
    pub amount: f32,
}

impl Kind {
    /// All kinds, each with its name and the amounts that a battery has of it.
    pub const ALL: [(Self, &'static str, &'static [f32]); 18] = [
        (Self::Texture, "texture", &[0.5, 0.25, 0.1]),
        (Self::Noise, "noise", &[5.0, 10.0, 25.0]),
        (Self::Blur, "blur", &[0.7, 1.5]),
        (Self::Gamma, "gamma", &[0.7, 1.4]),
        (Self::Vignetting, "vignetting", &[0.3, 0.6]),
        (Self::WhiteBalance, "white-balance", &[0.8, 1.25]),
        (Self::Gain, "gain", &[0.6, 1.6]),
        (Self::BlackLevel, "black-level", &[-30.0, 30.0]),
        (Self::LineOffset, "line-offset", &[0.5, 1.0]),
        (Self::Roll, "roll", &[0.25, 0.5]),
        (Self::Scale, "scale", &[1.0, 2.0]),
        (Self::Bands, "bands", &[10.0, 20.0]),
        (Self::RowNoise, "row-noise", &[3.0, 8.0]),
        (Self::Jpeg, "jpeg", &[50.0, 30.0, 15.0]),
        (Self::Clipped, "clipped", &[1.5, 2.5]),
        (Self::Periodic, "periodic", &[8.0]),
        (Self::Plain, "plain", &[128.0]),
        (Self::OneGrey, "one-grey", &[1.0]),
    ];

    /// The name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.listed().0
    }

    /// The amounts that a battery has of it.
    #[must_use]
    pub fn amounts(self) -> &'static [f32] {
        self.listed().1
    }

    /// Its name and amounts in the list of all.
    fn listed(self) -> (&'static str, &'static [f32]) {
        let mut all = Self::ALL.into_iter();
        let listed = all.find(|(kind, ..)| *kind == self);
        listed.map_or(("", &[]), |(_, name, amounts)| (name, amounts))
    }

    /// Whether there can be so much of it.
    #[must_use]
    pub fn takes(self, amount: f32) -> bool {
        let bounds = match self {
            Self::Texture | Self::Vignetting => 0.0..=1.0,
            Self::Noise | Self::RowNoise | Self::Plain => 0.0..=255.0,
            Self::Blur => 0.1..=20.0,
            Self::Gamma | Self::WhiteBalance | Self::Gain | Self::Clipped => 0.05..=20.0,
            Self::BlackLevel => -255.0..=255.0,
            Self::LineOffset => -LINE_OFFSET_MAX_PX..=LINE_OFFSET_MAX_PX,
            Self::Roll => -45.0..=45.0,
            Self::Scale => -50.0..=100.0,
            Self::Bands => 0.0..=100.0,
            Self::Jpeg => 1.0..=100.0,
            Self::Periodic => 2.0..=1000.0,
            Self::OneGrey => -1.0..=1.0,
        };
        bounds.contains(&amount)
    }
}

/// Lines of a period of [`Kind::Bands`].
const BAND_LINES: f32 = 16.0;
/// Standard deviation of the noise that painted surfaces get, so that they are not the same to the bit.
const PAINT_NOISE: f32 = 1.0;

impl Stress {
    /// Disturbs a scene that has ground truth where something is painted onto surfaces. Noise depends on
    /// the seed alone.
    ///
    /// # Errors
    /// Fails with one line when the truth is missing or a picture cannot be stored.
    pub fn apply(&self, scene: &mut Scene, seed: u64) -> Result<()> {
        let amount = self.amount;
        match self.kind {
            Kind::Texture => both(scene, |_, _, level| 128.0 + amount * (level - 128.0)),
            Kind::Noise => {
                for (stream, view) in (0..).zip([&mut scene.left, &mut scene.right]) {
                    add_noise(view, amount, seed, stream)?;
                }
            }
            Kind::Blur => scene.right = imageops::blur(&scene.right, amount),
            Kind::Gamma => map(&mut scene.right, |_, _, level| {
                255.0 * (level / 255.0).powf(amount)
            }),
            Kind::Vignetting => {
                let (width, height) = scene.left.dimensions();
                let [half_x, half_y] = [width, height].map(|side| (side as f32 - 1.0) / 2.0);
                both(scene, |[x, y], _, level| {
                    let away = ((x - half_x) / half_x).powi(2) + ((y - half_y) / half_y).powi(2);
                    level * (1.0 - amount * away / 2.0)
                });
            }
            Kind::WhiteBalance => map(&mut scene.right, |_, channel, level| match channel {
                0 => level * amount,
                2 => level / amount,
                _ => level,
            }),
            Kind::Gain => Exposure {
                gain: amount,
                ..Exposure::EQUAL
            }
            .apply(&mut scene.right),
            Kind::BlackLevel => Exposure {
                offset: amount,
                ..Exposure::EQUAL
            }
            .apply(&mut scene.right),
            Kind::LineOffset => scene.right = lowered(&scene.right, amount),
            Kind::Roll => {
                let (sine, cosine) = amount.to_radians().sin_cos();
                turn_right(scene, Turn { cosine, sine });
            }
            Kind::Scale => turn_right(
                scene,
                Turn {
                    cosine: 1.0 + amount / 100.0,
                    sine: 0.0,
                },
            ),
            Kind::Bands => {
                let band = |phase: f32| {
                    move |[_, y]: [f32; 2], _: usize, level: f32| {
                        level * (1.0 + amount / 100.0 * (TAU * y / BAND_LINES + phase).sin())
                    }
                };
                map(&mut scene.left, band(0.0));
                map(&mut scene.right, band(TAU / 4.0));
            }
            Kind::RowNoise => {
                for (stream, view) in (0..).zip([&mut scene.left, &mut scene.right]) {
                    add_row_noise(view, amount, seed, stream)?;
                }
            }
            Kind::Jpeg => {
                // The cast saturates.
                let quality = amount as u8;
                for view in [&mut scene.left, &mut scene.right] {
                    *view = through_jpeg(view, quality)?;
                }
            }
            Kind::Clipped => both(scene, |_, _, level| level * amount),
            Kind::Periodic => paint(scene, seed, |x| 127.5 + 100.0 * (TAU * x / amount).sin())?,
            Kind::Plain => paint(scene, seed, |_| amount)?,
            Kind::OneGrey => {
                let view = match amount >= 0.0 {
                    true => &mut scene.right,
                    false => &mut scene.left,
                };
                *view = image::DynamicImage::ImageLuma8(imageops::grayscale(view)).to_rgb8();
            }
        }
        Ok(())
    }
}

/// Changes the levels of a view: `change` takes the place, px, the channel and the level.
fn map(view: &mut RgbImage, change: impl Fn([f32; 2], usize, f32) -> f32) {
    for (x, y, pixel) in view.enumerate_pixels_mut() {
        for (channel, level) in pixel.0.iter_mut().enumerate() {
            // The cast saturates.
            *level = change([x as f32, y as f32], channel, f32::from(*level)).round() as u8;
        }
    }
}

fn both(scene: &mut Scene, change: impl Fn([f32; 2], usize, f32) -> f32) {
    map(&mut scene.left, &change);
    map(&mut scene.right, &change);
}

/// Noise of each view is of a stream of its own.
fn noise(deviation: f32, seed: u64, stream: u64) -> Result<(Normal<f32>, Pcg32)> {
    let normal = Normal::new(0.0, deviation).ok();
    let normal = normal.with_context(|| format!("{deviation} is no standard deviation"))?;
    Ok((normal, Pcg32::new(seed, stream)))
}

fn add_noise(view: &mut RgbImage, deviation: f32, seed: u64, stream: u64) -> Result<()> {
    let (normal, mut random) = noise(deviation, seed, stream)?;
    for level in view.iter_mut() {
        *level = (f32::from(*level) + normal.sample(&mut random)).round() as u8;
    }
    Ok(())
}

fn add_row_noise(view: &mut RgbImage, deviation: f32, seed: u64, stream: u64) -> Result<()> {
    let (normal, mut random) = noise(deviation, seed, stream)?;
    for row in view.rows_mut() {
        let offset = normal.sample(&mut random);
        for level in row.flat_map(|pixel| &mut pixel.0) {
            *level = (f32::from(*level) + offset).round() as u8;
        }
    }
    Ok(())
}

fn through_jpeg(view: &RgbImage, quality: u8) -> Result<RgbImage> {
    let mut bytes = Cursor::new(Vec::new());
    view.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, quality))?;
    let stored = image::load_from_memory_with_format(bytes.get_ref(), ImageFormat::Jpeg)?;
    Ok(stored.to_rgb8())
}

/// A rotation clockwise with a scale: `scale cos` and `scale sin` of the angle.
#[derive(Debug, Clone, Copy)]
struct Turn {
    cosine: f32,
    sine: f32,
}

impl Turn {
    /// Where what was at a place is afterwards, both from the middle of the view, px.
    fn of(self, [x, y]: [f32; 2]) -> [f32; 2] {
        let Self { cosine, sine } = self;
        [cosine * x - sine * y, cosine * y + sine * x]
    }

    fn inverse(self) -> Self {
        let square = self.cosine * self.cosine + self.sine * self.sine;
        Self {
            cosine: self.cosine / square,
            sine: -self.sine / square,
        }
    }
}

/// Turns the right view about its middle. The truth becomes that of the turned view: how far to the left a
/// point is in it, whatever its line. Points that leave the view are occluded.
fn turn_right(scene: &mut Scene, turn: Turn) {
    let view = &scene.right;
    let (width, height) = view.dimensions();
    let sides = [width, height].map(|side| side as f32 - 1.0);
    let turned = |[x, y]: [f32; 2], turn: Turn| {
        let [dx, dy] = turn.of([x - sides[0] / 2.0, y - sides[1] / 2.0]);
        [dx + sides[0] / 2.0, dy + sides[1] / 2.0]
    };
    let back = turn.inverse();
    let right = RgbImage::from_fn(width, height, |x, y| {
        let [x, y] = turned([x as f32, y as f32], back);
        let (x, y) = (x.clamp(0.0, sides[0]), y.clamp(0.0, sides[1]));
        imageops::interpolate_bilinear(view, x, y).unwrap_or(Rgb([0; 3]))
    });
    scene.right = right;
    let Some(truth) = &mut scene.truth else {
        return;
    };
    truth.right_px = None;
    let places = (0..height).flat_map(|y| (0..width).map(move |x| [x as f32, y as f32]));
    let stays = |px: &mut f32, [x, y]: [f32; 2]| {
        let at = turned([x - *px, y], turn);
        *px = x - at[0];
        at.iter()
            .zip(sides)
            .all(|(at, side)| (0.0..=side).contains(at))
    };
    let pixels = truth.left_px.iter_mut().zip(places);
    let stays: Vec<bool> = pixels.map(|(px, place)| stays(px, place)).collect();
    for mask in [&mut truth.nonocc, &mut truth.disc].into_iter().flatten() {
        let counts = mask.iter().zip(&stays);
        let counts: Vec<bool> = counts.map(|(&counts, &stays)| counts && stays).collect();
        *mask = counts.into();
    }
}

/// Paints the surfaces in the middle third of the lines and half of the columns of the left view: a
/// surface has the level of the left column at which it is seen, in both views. What else the right view
/// shows stays. The truth is cut to what is painted.
fn paint(scene: &mut Scene, seed: u64, level: impl Fn(f32) -> f32) -> Result<()> {
    let (width, height) = scene.left.dimensions();
    let truth = scene.truth.as_mut();
    let truth = truth.with_context(|| format!("{} has no ground truth", scene.name))?;
    let columns = width / 4..width - width / 4;
    let lines = height / 3..height - height / 3;
    let (normal, mut random) = noise(PAINT_NOISE, seed, 2)?;
    let mut painted = |level: f32| {
        let level = (level + normal.sample(&mut random)).round() as u8;
        Rgb([level; 3])
    };
    let mut inside = vec![false; truth.left_px.len()];
    for y in lines {
        let row = (y * width) as usize..((y + 1) * width) as usize;
        let disparities_px = &truth.left_px[row.clone()];
        // What is nearest hides the rest.
        let mut nearest_px = vec![f32::NEG_INFINITY; width as usize];
        for x in columns.clone() {
            let known_px = disparities_px[x as usize];
            if known_px.is_nan() {
                continue;
            }
            inside[row.start + x as usize] = true;
            scene.left.put_pixel(x, y, painted(level(x as f32)));
            let next_px = disparities_px.get(x as usize + 1).copied();
            let next_px = next_px.filter(|px| (px - known_px).abs() <= 1.0);
            // The right columns from this pixel's place to that of the next on its surface.
            let from = x as f32 - known_px;
            let to = next_px.map_or(from + 1.0, |px| x as f32 + 1.0 - px);
            let mut at = from.ceil();
            while at < to {
                if at >= 0.0 && at < width as f32 && nearest_px[at as usize] < known_px {
                    nearest_px[at as usize] = known_px;
                    let share = (at - from) / (to - from);
                    scene
                        .right
                        .put_pixel(at as u32, y, painted(level(x as f32 + share)));
                }
                at += 1.0;
            }
        }
    }
    let keep = |mask: &Option<Mask>| {
        let mask = mask.as_deref()?;
        let kept: Vec<bool> = mask.iter().zip(&inside).map(|(&a, &b)| a && b).collect();
        Some(Mask::from(kept))
    };
    truth.all = keep(&truth.all);
    truth.nonocc = keep(&truth.nonocc);
    truth.disc = keep(&truth.disc);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{RenderOptions, render};

    fn scene() -> Scene {
        render(&RenderOptions {
            width: 160,
            height: 120,
            d_max: 31,
            ..RenderOptions::default()
        })
    }

    #[test]
    fn every_kind_changes_the_pictures_and_is_the_same_for_one_seed() {
        let before = scene();
        for (kind, name, amounts) in Kind::ALL {
            assert_eq!(kind.name(), name);
            for &amount in amounts {
                let apply = |seed| {
                    let mut disturbed = before.clone();
                    Stress { kind, amount }.apply(&mut disturbed, seed).unwrap();
                    disturbed
                };
                let [once, again, other] = [apply(1), apply(1), apply(2)];
                assert!(
                    once.left == again.left && once.right == again.right,
                    "{name}"
                );
                assert!(
                    once.left != before.left || once.right != before.right,
                    "{name} {amount}"
                );
                let is_random = matches!(
                    kind,
                    Kind::Noise | Kind::RowNoise | Kind::Periodic | Kind::Plain
                );
                assert_eq!(once.right != other.right, is_random, "{name}");
            }
        }
    }

    #[test]
    fn noise_has_its_deviation_and_differs_between_the_views() {
        let grey = RgbImage::from_pixel(100, 100, Rgb([128; 3]));
        let mut disturbed = Scene {
            left: grey.clone(),
            right: grey,
            ..scene()
        };
        let stress = Stress {
            kind: Kind::Noise,
            amount: 10.0,
        };
        stress.apply(&mut disturbed, 7).unwrap();
        assert_ne!(disturbed.left, disturbed.right);
        let squares = disturbed
            .left
            .iter()
            .map(|&level| (f64::from(level) - 128.0).powi(2));
        let deviation = (squares.sum::<f64>() / 30_000.0).sqrt();
        assert!((deviation - 10.0).abs() < 0.2, "{deviation}");
    }

    #[test]
    fn a_roll_and_a_scale_move_what_is_away_from_the_middle() {
        // A bright line from the middle to the right.
        let line = RgbImage::from_fn(201, 101, |_, y| Rgb([if y == 50 { 200 } else { 0 }; 3]));
        let moved = |kind, amount| {
            let mut disturbed = Scene {
                right: line.clone(),
                ..scene()
            };
            Stress { kind, amount }.apply(&mut disturbed, 1).unwrap();
            let brightest = |x: u32| (0..101).max_by_key(|&y| disturbed.right.get_pixel(x, y)[0]);
            [brightest(20), brightest(100), brightest(180)].map(Option::unwrap)
        };
        // 80 px from the middle, 3 degrees are 4.2 px.
        assert_eq!(moved(Kind::Roll, 3.0), [46, 50, 54]);
        assert_eq!(moved(Kind::Scale, 2.0), [50; 3]);
    }

    /// What the truth says of a turned view is there: at the disparity, and on the line that the angle or
    /// the scale gives.
    #[test]
    fn the_truth_follows_a_turned_view() {
        let undisturbed = scene();
        for (kind, amount) in [(Kind::Roll, 2.0), (Kind::Roll, -0.5), (Kind::Scale, 3.0)] {
            let mut disturbed = scene();
            Stress { kind, amount }.apply(&mut disturbed, 1).unwrap();
            let truth = disturbed.truth.as_ref().unwrap();
            let nonocc = truth.nonocc.as_deref().unwrap();
            let (mut count, mut off, mut moved) = (0, 0, 0);
            for (index, (&counts, &px)) in nonocc.iter().zip(&truth.left_px).enumerate() {
                if !counts {
                    continue;
                }
                let (x, y) = ((index % 160) as u32, (index / 160) as u32);
                let before_px = undisturbed.truth.as_ref().unwrap().left_px[index];
                let (right, down) = (x as f32 - before_px - 79.5, y as f32 - 59.5);
                let line = match kind {
                    Kind::Scale => 59.5 + down * (1.0 + amount / 100.0),
                    _ => {
                        59.5 + down * amount.to_radians().cos() + right * amount.to_radians().sin()
                    }
                };
                let at = (x as f32 - px).clamp(0.0, 159.0);
                let line = line.clamp(0.0, 119.0);
                let turned = imageops::interpolate_bilinear(&disturbed.right, at, line).unwrap();
                let left = imageops::interpolate_bilinear(
                    &undisturbed.right,
                    (right + 79.5).clamp(0.0, 159.0),
                    y as f32,
                );
                count += 1;
                off += usize::from(turned[1].abs_diff(left.unwrap()[1]) > 25);
                moved += usize::from((px - before_px).abs() > 0.25);
            }
            // Interpolated twice, edges are blurred.
            assert!(
                count > 10_000 && off < count / 15 && moved > count / 4,
                "{kind:?} {amount}: {off} and {moved} of {count}"
            );
        }
    }

    #[test]
    fn what_is_painted_matches_by_the_truth_alone() {
        let mut disturbed = scene();
        let stress = Stress {
            kind: Kind::Periodic,
            amount: 40.0,
        };
        stress.apply(&mut disturbed, 1).unwrap();
        let truth = disturbed.truth.as_ref().unwrap();
        let nonocc = truth.nonocc.as_deref().unwrap();
        let (mut count, mut off) = (0, 0);
        for (index, (&counts, &px)) in nonocc.iter().zip(&truth.left_px).enumerate() {
            if !counts {
                continue;
            }
            let (x, y) = ((index % 160) as u32, (index / 160) as u32);
            let left = f32::from(disturbed.left.get_pixel(x, y)[0]);
            let at = (x as f32 - px).clamp(0.0, 159.0);
            let right = imageops::interpolate_bilinear(&disturbed.right, at, y as f32).unwrap();
            count += 1;
            off += usize::from((left - f32::from(right[0])).abs() > 12.0);
        }
        // At edges, levels of two surfaces mix.
        assert!(count > 1000 && off < count / 20, "{off} of {count}");
    }
}
