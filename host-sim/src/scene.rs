//! A rectified stereo pair with its search range and its ground truth.

use core::ops::Deref;

use image::RgbImage;

/// A rectified stereo pair, with its ground truth if that is known.
///
/// Left pixel `(x, y)` shows the same point as right pixel `(x - d, y)`; `d` is its
/// disparity in px, not negative.
#[derive(Debug, Clone)]
pub struct Scene {
    /// A short name for tables and file names.
    pub name: String,
    /// The left view.
    pub left: RgbImage,
    /// The right view; its size is that of the left view.
    pub right: RgbImage,
    /// How many bits of their 16 the levels of the stored views used, if not all; `None` for views
    /// of 8 bits.
    pub bits: Option<u8>,
    /// The largest disparity to search, px.
    pub d_max: u16,
    /// The ground truth; `None` if it is not known.
    pub truth: Option<GroundTruth>,
}

/// The true disparities of a [`Scene`], and masks of the pixels at which a result is measured.
///
/// Maps and masks hold one value per pixel, row-major without gaps. A mask is `None` if the
/// scene does not have it.
#[derive(Debug, Clone)]
pub struct GroundTruth {
    /// The disparity of each left pixel, px; NaN where it is unknown.
    pub left_px: Vec<f32>,
    /// The disparity of each right pixel, px; NaN where it is unknown.
    pub right_px: Option<Vec<f32>>,
    /// The left pixels that are not occluded: the right view shows their points as well.
    pub nonocc: Option<Mask>,
    /// All left pixels to measure at, occluded or not.
    pub all: Option<Mask>,
    /// The left pixels of `nonocc` that are near a discontinuity of the disparities.
    pub disc: Option<Mask>,
}

/// A mask of left pixels: `true` for those that count, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask(Vec<bool>);

impl Mask {
    /// Returns the number of pixels that count.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.iter().filter(|&&counts| counts).count()
    }
}

impl From<Vec<bool>> for Mask {
    fn from(pixels: Vec<bool>) -> Self {
        Self(pixels)
    }
}

impl Deref for Mask {
    type Target = [bool];

    fn deref(&self) -> &[bool] {
        &self.0
    }
}
