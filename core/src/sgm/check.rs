//! The checks of a row of selected disparities: left-right, uniqueness and texture.

use core::ops::Range;

use crate::disparity::INVALID;
use crate::kernel::{CheckRow, Kernels};
use crate::rows::{Found, fill_outside};

/// A row of selected disparities, to be checked.
///
/// The left-right check rejects a pixel that its camera did not see, and one whose match lies
/// outside of what the other camera saw or has another best disparity itself. A pixel whose margin
/// is too small (uniqueness), or whose surroundings have too little texture, is in doubt. Texture
/// is the sum of the absolute steps from pixel to pixel along the line, over the pixels at most
/// `reach` away.
#[derive(Debug, Clone)]
pub struct RowCheck<'a> {
    /// [`AggregateRow::best`](crate::kernel::AggregateRow::best).
    pub best: &'a [u16],
    /// [`AggregateRow::refined_index_q4`](crate::kernel::AggregateRow::refined_index_q4).
    pub refined_index_q4: &'a [i16],
    /// [`AggregateRow::margins`](crate::kernel::AggregateRow::margins).
    pub margins: &'a [i16],
    /// [`AggregateRow::other_best`](crate::kernel::AggregateRow::other_best).
    pub other_best: &'a [u32],
    /// Lowest disparity, px.
    pub minimum_px: i16,
    /// Largest difference between the disparities of the two views, px.
    pub tolerance_px: u8,
    /// Smallest margin of a pixel that is not in doubt.
    pub margin: i16,
    /// Positions of the row that the camera saw.
    pub valid: Range<usize>,
    /// Positions of the other view's row that its camera saw, in the stored order of that view.
    pub other_valid: Range<usize>,
    /// Grey levels of the line, with `reach` more pixels at both ends.
    pub grey: &'a [u8],
    /// Reach of the window over which texture is summed, px, at most 128.
    pub reach: usize,
    /// Smallest texture of a pixel that is not in doubt, levels; 0 accepts all.
    pub texture_min: u16,
}

impl RowCheck<'_> {
    /// The position, in the stored order of the other view, of the match of pixel `x` at the
    /// disparity of index `best`; `None` outside the view.
    #[must_use]
    #[inline(always)]
    pub fn position(&self, x: usize, best: u16) -> Option<usize> {
        let count = self.best.len();
        // Before the first pixel the position wraps round, and is then beyond the last.
        let position =
            (count - 1 - x + usize::from(best)).wrapping_add_signed(self.minimum_px.into());
        (position < count).then_some(position)
    }

    /// Writes the state of each pixel, as stored values of [`Found`], and its confidence: the
    /// margin, clamped to 1 to 255, if its disparity holds, else 0.
    pub fn write(&self, kernels: &impl Kernels, found: &mut [i16], confidences: &mut [u8]) {
        let count = self.best.len();
        // The other view's best matches at the positions of its pixels.
        let minimum_px = isize::from(self.minimum_px);
        let index = |position: usize| position.saturating_add_signed(-minimum_px);
        let (start, end) = (index(self.other_valid.start), index(self.other_valid.end));
        let others = self.other_best.get(..end.min(self.other_best.len()));
        let others = others
            .and_then(|others| others.get(start..))
            .unwrap_or_default();
        let row = CheckRow {
            best: self.best,
            refined_index_q4: self.refined_index_q4,
            margins: self.margins,
            others,
            // Rows have less than 2^16 pixels.
            first: count.wrapping_sub(start + 1) as u32,
            tolerance_px: self.tolerance_px,
            margin: self.margin,
        };
        kernels.check_row(&row, found, confidences);
        fill_outside(found, &self.valid, INVALID);
        fill_outside(confidences, &self.valid, 0);
        if self.texture_min == 0 {
            return;
        }
        let textures = textures(self.grey, self.reach);
        for ((found, confidence), texture) in found.iter_mut().zip(confidences).zip(textures) {
            if texture < self.texture_min {
                *found = Found::of(*found).doubted().stored();
                *confidence = 0;
            }
        }
    }

    /// Positions of every `STEP`th pixel whose disparity holds, and of its match in the stored
    /// order of the other view.
    pub(super) fn matches<const STEP: usize>(
        &self,
        confidences: &[u8],
    ) -> impl Iterator<Item = (usize, usize)> {
        let first = (self.best.len().wrapping_sub(1)).wrapping_add_signed(self.minimum_px.into());
        let mut next = 0;
        core::iter::from_fn(move || {
            loop {
                let x = next;
                let (&confidence, &best) = (confidences.get(x)?, self.best.get(x)?);
                next += STEP;
                if confidence > 0 {
                    // Within the other view, as the disparity holds.
                    let position = first.wrapping_sub(x).wrapping_add(best.into());
                    return Some((x, position));
                }
            }
        })
    }
}

/// The texture of each pixel of a line that has `reach` more pixels at both ends.
fn textures(grey: &[u8], reach: usize) -> impl Iterator<Item = u16> {
    let steps = || {
        let pairs = grey.iter().zip(grey.iter().skip(1));
        pairs.map(|(&a, &b)| u16::from(a.abs_diff(b)))
    };
    let mut entering = steps().skip(2 * reach);
    let mut leaving = steps();
    let first: u16 = steps().take(2 * reach).sum();
    let pixels = grey.len().saturating_sub(2 * reach);
    core::iter::successors(Some(first), move |texture| {
        // This does not wrap: the step that leaves the window is part of the sum.
        Some(texture + entering.next().unwrap_or(0) - leaving.next().unwrap_or(0))
    })
    .take(pixels)
}
