//! A borrowed grey image, for the literal network and for tests.

/// Error for pixels that do not make an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GreyImageSizeError;

impl core::fmt::Display for GreyImageSizeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("an image needs at least one pixel and exactly width x height of them")
    }
}

impl core::error::Error for GreyImageSizeError {}

/// Grey pixels, `height` lines of `width`, row-major without gaps.
#[derive(Debug, Clone, Copy)]
pub struct GreyImage<'a> {
    pixels: &'a [u8],
    width: usize,
    height: usize,
}

impl<'a> GreyImage<'a> {
    /// Borrows `width x height` pixels.
    ///
    /// # Errors
    /// [`GreyImageSizeError`] when the image is empty or the number of pixels differs.
    pub const fn new(
        pixels: &'a [u8],
        width: usize,
        height: usize,
    ) -> Result<Self, GreyImageSizeError> {
        match width.checked_mul(height) {
            Some(area) if area > 0 && area == pixels.len() => Ok(Self {
                pixels,
                width,
                height,
            }),
            _ => Err(GreyImageSizeError),
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

    /// The level of the pixel at (`x + dx`, `y + dy`), or of the nearest one inside the image.
    #[must_use]
    pub fn sample(&self, x: usize, y: usize, dx: i8, dy: i8) -> u8 {
        let column = x.saturating_add_signed(dx.into()).min(self.width - 1);
        let line = y.saturating_add_signed(dy.into()).min(self.height - 1);
        let level = self.pixels.get(line * self.width + column);
        // Clamped, and so inside.
        level.copied().unwrap_or(0)
    }
}
