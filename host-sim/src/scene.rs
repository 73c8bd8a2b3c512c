//! A rectified stereo pair with what is known about it.

use core::ops::Deref;

use image::RgbImage;

/// A rectified stereo pair, and its ground truth where there is one.
///
/// Left pixel `(x, y)` shows the same point as right pixel `(x - d, y)`; `d` is its
/// disparity in px, not negative.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Short name for tables and file names.
    pub name: String,
    /// Left view.
    pub left: RgbImage,
    /// Right view, of the same size.
    pub right: RgbImage,
    /// Largest disparity to search, px.
    pub d_max: u16,
    /// What a matcher should have found; `None` for captured scenes.
    pub truth: Option<GroundTruth>,
}

/// The true disparities of a [`Scene`] and the pixels to judge a result at.
///
/// Maps and masks hold one value per pixel, row-major, without padding.
#[derive(Debug, Clone)]
pub struct GroundTruth {
    /// Disparity of each left pixel, px; NaN where unknown.
    pub left_px: Vec<f32>,
    /// Disparity of each right pixel, px; NaN where unknown.
    pub right_px: Option<Vec<f32>>,
    /// Left pixels whose point the right view shows too.
    pub nonocc: Option<Mask>,
    /// Left pixels to judge whether or not the right view shows them.
    pub all: Option<Mask>,
    /// Left pixels of `nonocc` near a jump of disparity.
    pub disc: Option<Mask>,
}

/// The left pixels to evaluate: `true` where they count, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask(Vec<bool>);

impl Mask {
    /// How many pixels count.
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
