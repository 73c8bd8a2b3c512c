//! Pictures of disparity maps: coloured disparities and error maps.

use image::{Rgb, RgbImage};
use vgstereo_core::disparity::px_to_q4;
use vgstereo_core::{DisparityRange, INVALID};

use crate::metrics::is_bad;
use crate::scene::{GroundTruth, Mask};

const BLACK: Rgb<u8> = Rgb([0, 0, 0]);

/// Returns a picture of disparities, which are in 1/16 px, row-major, in lines of `width` px.
/// Colours go from blue at the smallest disparity of the range to red at the largest. Pixels
/// without a disparity are black.
#[must_use]
pub fn colour_disparities(disparities_q4: &[i16], width: u32, range: DisparityRange) -> RgbImage {
    let px = |range_px: i32| i16::try_from(range_px).unwrap_or(i16::MAX);
    let range = range.range_px();
    let low = f64::from(px_to_q4(px(range.start)));
    let high = f64::from(px_to_q4(px(range.end - 1))).max(low + 1.0);
    picture(disparities_q4, width, |&disparity_q4| {
        if disparity_q4 == INVALID {
            return BLACK;
        }
        let position = (f64::from(disparity_q4) - low) / (high - low);
        Rgb(colour_at(position.clamp(0.0, 1.0)))
    })
}

/// Returns 256 colours from that of the smallest disparity to that of the largest: red, green and blue
/// of each.
#[must_use]
pub fn colour_map() -> Vec<u8> {
    let positions = (0..=255).map(|level| f64::from(level) / 255.0);
    positions.flat_map(colour_at).collect()
}

/// The colour of a place, 0 to 1, in the range of disparities.
fn colour_at(position: f64) -> [u8; 3] {
    let colour = colorous::TURBO.eval_continuous(position);
    [colour.r, colour.g, colour.b]
}

/// Returns a picture of the errors of disparities, which are in 1/16 px, row-major, in lines of
/// `width` px.
///
/// Pixels are bad when their disparity is missing or further than `threshold_px` from the
/// ground truth. Bad pixels are red when both views show them and orange when they are
/// occluded; the others are grey. Pixels without ground truth, and those that neither of the
/// masks `all` and `nonocc` counts, are black.
#[must_use]
pub fn error_map(
    disparities_q4: &[i16],
    width: u32,
    truth: &GroundTruth,
    threshold_px: f32,
) -> RgbImage {
    let pixels: Vec<Rgb<u8>> = disparities_q4
        .iter()
        .zip(&truth.left_px)
        .enumerate()
        .map(|(index, (&found, &known))| {
            let flag = |mask: &Option<Mask>| {
                mask.as_deref()
                    .is_none_or(|mask| mask.get(index).copied().unwrap_or(false))
            };
            if known.is_nan() || !(flag(&truth.all) || flag(&truth.nonocc)) {
                BLACK
            } else if !is_bad(found, known, threshold_px) {
                Rgb([200, 200, 200])
            } else if flag(&truth.nonocc) {
                Rgb([214, 39, 40])
            } else {
                Rgb([255, 166, 48])
            }
        })
        .collect();
    picture(&pixels, width, |&colour| colour)
}

/// Returns a picture whose pixels have the colours of these values, in lines of `width` px.
fn picture<T>(pixels: &[T], width: u32, colour: impl Fn(&T) -> Rgb<u8>) -> RgbImage {
    let width = width.max(1);
    let height = pixels.len() / width as usize;
    let mut picture = RgbImage::new(width, u32::try_from(height).unwrap_or(0));
    for (to, from) in picture.pixels_mut().zip(pixels) {
        *to = colour(from);
    }
    picture
}
