//! The pixels of views that a board has sent, whatever their format.

use vgstereo_core::{Kernels, Portable};
use vgstereo_firmware::camera::PixelFormat;

use super::board::Pictures;
use super::plane::Plane;

/// A view with its pixels unpacked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pixels {
    /// Grey levels.
    pub grey: Plane<u8>,
    /// Red, green and blue of each pixel; `None` of a format without colour.
    pub colour: Option<Plane<u8>>,
}

/// Returns the pixels of the left and the right view.
#[must_use]
pub fn unpacked(pictures: &Pictures) -> [Pixels; 2] {
    let format = format_of(pictures.format);
    pictures.views.each_ref().map(|view| {
        let width = view.width / format.bytes_per_pixel();
        Pixels {
            grey: view.converted(width, |bytes, row| Portable.luma_row(format, bytes, row)),
            colour: (!format.is_grey()).then(|| colour(format, view, width)),
        }
    })
}

fn colour(format: PixelFormat, view: &Plane<u8>, width: usize) -> Plane<u8> {
    let mut levels = vec![0; width];
    view.converted(3 * width, |bytes, row| {
        for channel in 0..3 {
            Portable.channel_row(format, bytes, channel, &mut levels);
            for (pixel, level) in row.chunks_exact_mut(3).zip(&levels) {
                pixel[channel] = *level;
            }
        }
    })
}

fn format_of(format: vgstereo_link::PixelFormat) -> PixelFormat {
    match format {
        vgstereo_link::PixelFormat::Grey8 => PixelFormat::Grey8,
        vgstereo_link::PixelFormat::Rgb888 => PixelFormat::Rgb888,
        vgstereo_link::PixelFormat::Rgb565 => PixelFormat::Rgb565,
        vgstereo_link::PixelFormat::Yuv422 => PixelFormat::Yuv422,
    }
}
