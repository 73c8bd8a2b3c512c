//! The views of a pair of images, and the pictures of views.

use anyhow::{Context, Result};
use image::{DynamicImage, GrayImage, RgbImage};
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_frame::Views;

/// Returns the views of two images that have one size. Pixels are grey with `grey` or when one of
/// the images has no colour; otherwise they are RGB.
///
/// # Errors
/// Fails with one line that states the limit when the images are too wide.
pub fn views_of(left: RgbImage, right: RgbImage, grey: bool) -> Result<Views> {
    let is_grey = |image: &RgbImage| image.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]);
    // Colour that one view alone has tells nothing about a match.
    let grey = grey || is_grey(&left) || is_grey(&right);
    let width = u16::try_from(left.width());
    let width = width.with_context(|| format!("images are at most {} px wide", u16::MAX))?;
    let views = Views::new(
        left.into_raw(),
        right.into_raw(),
        width,
        PixelFormat::Rgb888,
    );
    Ok(if grey { views.to_grey() } else { views })
}

/// Returns the left (0) or the right view (1) as a picture.
///
/// # Errors
/// Fails when the view is not made of whole lines of grey or RGB.
pub fn picture_of(views: &Views, view: usize) -> Result<RgbImage> {
    let pixels = if view == 0 { &views.left } else { &views.right };
    let size = [views.width.into(), u32::try_from(views.height())?];
    let [width, height] = size;
    let picture = match views.format {
        PixelFormat::Grey8 => GrayImage::from_raw(width, height, pixels.clone())
            .map(|grey| DynamicImage::from(grey).into_rgb8()),
        _ => RgbImage::from_raw(width, height, pixels.clone()),
    };
    picture.context("the view is not made of whole lines")
}
