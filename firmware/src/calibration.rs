//! Whether a calibration suits a board.

use core::fmt;

use vgstereo_core::geometry::{Rectification, Rectifier};

use crate::camera::Geometry;

/// The sizes that a calibration must have to suit a board, and the memory for its rectifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fit {
    /// The camera's lines.
    pub raw: Geometry,
    /// Width of the matched lines, px.
    pub width: u16,
    /// Whether red, green and blue are matched.
    pub colour: bool,
    /// Words of 32 bits that there are for the rectifier.
    pub rectifier_words: usize,
}

/// Why a calibration does not suit a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Unfit {
    /// It is for raw views of another size.
    RawSize,
    /// Its rectified views have another width than the lines that are matched.
    Width,
    /// Its rectifier takes more memory than there is.
    Memory,
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::RawSize => "the calibration is for views of another size",
            Self::Width => "the rectified views have another width than the lines that are matched",
            Self::Memory => "the calibration keeps more raw lines than there is memory for",
        })
    }
}

impl core::error::Error for Unfit {}

impl Fit {
    /// Checks that the board can use a rectification.
    ///
    /// # Errors
    /// [`Unfit`] when it cannot.
    pub fn check(&self, rectification: &Rectification<'_>) -> Result<(), Unfit> {
        let raw_height = u32::from(rectification.raw_height);
        if (rectification.raw_width, raw_height) != (self.raw.width, self.raw.height) {
            return Err(Unfit::RawSize);
        }
        if rectification.width != self.width {
            return Err(Unfit::Width);
        }
        if Rectifier::words(rectification, self.colour) > self.rectifier_words {
            return Err(Unfit::Memory);
        }
        Ok(())
    }
}
