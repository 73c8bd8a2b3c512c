//! Conversion of images to the lines that a matcher takes.

use std::ops::Range;

use anyhow::{Context, Result};
use image::RgbImage;
use vgstereo_core::kernel::luma_row;
use vgstereo_core::{Kernels, PartlyValid};
use vgstereo_firmware::camera::{PixelFormat, RawLine};

/// A rectified pair of views, both of one size, stored as a camera delivers them: line by
/// line, from the top.
#[derive(Debug, Clone)]
pub struct Views {
    /// Bytes of the left view, row-major without gaps.
    pub left: Vec<u8>,
    /// Bytes of the right view, row-major without gaps.
    pub right: Vec<u8>,
    /// Width of each view, px.
    pub width: u16,
    /// Pixel format of both views.
    pub format: PixelFormat,
    /// For each line of the left and of the right view, the columns that the camera saw; no lines
    /// where it saw all.
    pub valid_columns: [Vec<Range<u16>>; 2],
}

/// A line of one of the [`Views`].
pub type ViewLine<'a, K> = PartlyValid<RawLine<'a, K>>;

impl Views {
    /// Returns the views of two images that have one size. Pixels are grey with `grey` or when one of
    /// the images has no colour; otherwise they are RGB.
    ///
    /// # Errors
    /// Fails with one line that states the limit when the images are too wide.
    pub fn new(left: RgbImage, right: RgbImage, grey: bool) -> Result<Self> {
        let is_grey =
            |image: &RgbImage| image.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]);
        // Colour that one view alone has tells nothing about a match.
        let grey = grey || is_grey(&left) || is_grey(&right);
        let views = Self {
            width: u16::try_from(left.width())
                .with_context(|| format!("images are at most {} px wide", u16::MAX))?,
            left: left.into_raw(),
            right: right.into_raw(),
            format: PixelFormat::Rgb888,
            valid_columns: Default::default(),
        };
        Ok(if grey { views.to_grey() } else { views })
    }

    /// Returns these views with every pixel replaced by its luma.
    #[must_use]
    pub fn to_grey(&self) -> Self {
        let lines = |view: &[u8]| {
            let mut grey = vec![0; view.len() / self.format.bytes_per_pixel()];
            luma_row(self.format, view, &mut grey);
            grey
        };
        Self {
            left: lines(&self.left),
            right: lines(&self.right),
            width: self.width,
            format: PixelFormat::Grey8,
            valid_columns: self.valid_columns.clone(),
        }
    }

    /// Whether the views have colour.
    #[must_use]
    pub fn has_colour(&self) -> bool {
        !self.format.is_grey()
    }

    /// Number of pairs of lines.
    #[must_use]
    pub fn height(&self) -> usize {
        self.left.len() / self.format.line_bytes(self.width).max(1)
    }

    /// The pairs of lines from the top, to be unpacked by `kernels`.
    pub fn lines<K: Kernels>(
        &self,
        kernels: K,
    ) -> impl Iterator<Item = (ViewLine<'_, K>, ViewLine<'_, K>)> {
        let bytes = self.format.line_bytes(self.width).max(1);
        let line = move |bytes, valid: Option<&Range<u16>>| PartlyValid {
            line: RawLine::new(self.format, bytes, kernels),
            valid_columns: match valid {
                Some(columns) => columns.start.into()..columns.end.into(),
                None => 0..self.width.into(),
            },
        };
        let right = self.right.chunks_exact(bytes);
        let pairs = self.left.chunks_exact(bytes).zip(right).enumerate();
        pairs.map(move |(y, (left, right))| {
            let [left_valid, right_valid] = &self.valid_columns;
            (
                line(left, left_valid.get(y)),
                line(right, right_valid.get(y)),
            )
        })
    }
}
