//! A pair of views, and their lines as a matcher takes them.

use std::ops::Range;

use vgstereo_core::kernel::luma_row;
use vgstereo_core::{Kernels, Line};
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
    /// Grey levels of the left and of the right view, row-major, where they are not the luma of
    /// the pixels: rectified in colour, each channel is rounded for itself.
    pub grey: Option<[Vec<u8>; 2]>,
    /// For each line of the left and of the right view, the columns that the camera saw; no lines
    /// where it saw all.
    pub valid_columns: [Vec<Range<u16>>; 2],
}

/// A line of one of the [`Views`].
#[derive(Debug, Clone)]
pub struct ViewLine<'a, K> {
    /// The pixels.
    pub pixels: RawLine<'a, K>,
    /// Grey levels; `None` where they are the luma of the pixels.
    pub grey: Option<&'a [u8]>,
    /// The columns that the camera saw.
    pub valid_columns: Range<usize>,
}

impl<K: Kernels> Line for ViewLine<'_, K> {
    fn width(&self) -> usize {
        self.pixels.width()
    }

    fn valid_columns(&self) -> Range<usize> {
        self.valid_columns.clone()
    }

    fn has_colour(&self) -> bool {
        self.pixels.has_colour()
    }

    fn write_grey(&self, row: &mut [u8]) {
        match self.grey {
            Some(levels) => levels.write_grey(row),
            None => self.pixels.write_grey(row),
        }
    }

    fn write_channel(&self, channel: usize, row: &mut [u8]) {
        self.pixels.write_channel(channel, row);
    }
}

impl Views {
    /// Returns the views of these bytes, row-major without gaps, of which the cameras saw every column.
    #[must_use]
    pub fn new(left: Vec<u8>, right: Vec<u8>, width: u16, format: PixelFormat) -> Self {
        Self {
            left,
            right,
            width,
            format,
            grey: None,
            valid_columns: Default::default(),
        }
    }

    /// Returns these views with every pixel replaced by its luma.
    #[must_use]
    pub fn to_grey(&self) -> Self {
        let luma = |view: &[u8]| {
            let mut grey = vec![0; view.len() / self.format.bytes_per_pixel()];
            luma_row(self.format, view, &mut grey);
            grey
        };
        let [left, right] = match &self.grey {
            Some(levels) => levels.clone(),
            None => [luma(&self.left), luma(&self.right)],
        };
        Self {
            left,
            right,
            width: self.width,
            format: PixelFormat::Grey8,
            grey: None,
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
        let width = usize::from(self.width);
        let line = move |view: usize, y: usize, bytes| ViewLine {
            pixels: RawLine::new(self.format, bytes, kernels),
            grey: self
                .grey
                .as_ref()
                .and_then(|levels| levels[view].get(y * width..(y + 1) * width)),
            valid_columns: match self.valid_columns[view].get(y) {
                Some(columns) => columns.start.into()..columns.end.into(),
                None => 0..width,
            },
        };
        let right = self.right.chunks_exact(bytes);
        let pairs = self.left.chunks_exact(bytes).zip(right).enumerate();
        pairs.map(move |(y, (left, right))| (line(0, y, left), line(1, y, right)))
    }
}
