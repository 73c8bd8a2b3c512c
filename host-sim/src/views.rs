//! From images to the lines that the matcher takes.

use image::RgbImage;
use vgstereo_core::camera::PixelFormat;

/// A pair of views of the same size as a camera would deliver them, line by line.
#[derive(Debug, Clone)]
pub struct Views {
    /// Left view, row-major without gaps.
    pub left: Vec<u8>,
    /// Right view, likewise.
    pub right: Vec<u8>,
    /// Columns, px.
    pub width: u16,
    /// How pixels are stored.
    pub format: PixelFormat,
}

impl Views {
    /// The views of a pair of images of the same size: RGB, or grey when asked for or
    /// when there is no colour in either. `None` when they are wider than 65535 px.
    #[must_use]
    pub fn new(left: &RgbImage, right: &RgbImage, grey: bool) -> Option<Self> {
        let is_grey =
            |image: &RgbImage| image.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]);
        let views = Self {
            left: left.as_raw().clone(),
            right: right.as_raw().clone(),
            width: u16::try_from(left.width()).ok()?,
            format: PixelFormat::Rgb888,
        };
        Some(if grey || is_grey(left) && is_grey(right) {
            views.to_grey()
        } else {
            views
        })
    }

    /// The same in grey.
    #[must_use]
    pub fn to_grey(&self) -> Self {
        let lines = |view: &[u8]| {
            let mut grey = vec![0; view.len() / self.format.bytes_per_pixel()];
            self.format.luma(view, &mut grey);
            grey
        };
        Self {
            left: lines(&self.left),
            right: lines(&self.right),
            width: self.width,
            format: PixelFormat::Grey8,
        }
    }

    /// The pairs of lines from the top.
    pub fn lines(&self) -> impl Iterator<Item = (&[u8], &[u8])> {
        let bytes = self.format.line_bytes(self.width).max(1);
        self.left
            .chunks_exact(bytes)
            .zip(self.right.chunks_exact(bytes))
    }
}
