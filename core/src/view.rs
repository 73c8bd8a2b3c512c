//! A borrowed grey image, for the literal network and for tests.

/// Why pixels do not make an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ViewSizeError;

impl core::fmt::Display for ViewSizeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("an image needs at least one pixel and exactly width x height of them")
    }
}

impl core::error::Error for ViewSizeError {}

/// Grey pixels, `height` lines of `width`, row-major without gaps.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    pixels: &'a [u8],
    width: usize,
    height: usize,
}

impl<'a> View<'a> {
    /// Borrows `width x height` pixels.
    ///
    /// # Errors
    /// [`ViewSizeError`] when the image is empty or the number of pixels differs.
    pub const fn new(pixels: &'a [u8], width: usize, height: usize) -> Result<Self, ViewSizeError> {
        match width.checked_mul(height) {
            Some(area) if area > 0 && area == pixels.len() => Ok(Self {
                pixels,
                width,
                height,
            }),
            _ => Err(ViewSizeError),
        }
    }

    /// Columns.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Lines.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// The lines from the top.
    pub fn lines(&self) -> impl ExactSizeIterator<Item = &'a [u8]> + use<'a> {
        self.pixels.chunks_exact(self.width)
    }

    /// The pixel at (`x + dx`, `y + dy`), or the nearest one inside the view.
    #[must_use]
    pub fn sample(&self, x: usize, y: usize, dx: i8, dy: i8) -> u8 {
        let column = x.saturating_add_signed(dx.into()).min(self.width - 1);
        let line = y.saturating_add_signed(dy.into()).min(self.height - 1);
        self.pixels[line * self.width + column]
    }
}
