//! From colour images to the grey pairs that the matcher takes.

use image::RgbImage;
use vgstereo_core::camera::PixelFormat;

/// The grey pixels of an image, row-major, by the core's own conversion.
#[must_use]
pub fn grey(image: &RgbImage) -> Vec<u8> {
    let mut grey = vec![0; image.as_raw().len() / PixelFormat::Rgb888.bytes_per_pixel()];
    PixelFormat::Rgb888.luma(image.as_raw(), &mut grey);
    grey
}
