//! Attenuation of the matching costs of pixels in doubt, so that paths cross them with what they know already.

use super::RIVAL_BLOCK_PX;

/// A row of matching costs, and which of its pixels are in doubt.
#[derive(Debug)]
pub struct AttenuateRow<'a> {
    /// Matching costs, `stride` per pixel, of which the first are those of the `disparities`; what lies beyond stays.
    /// Those of a set that keeps them elsewhere are not here.
    pub costs: &'a mut [u8],
    /// Bytes from the costs of one pixel to those of the next, a multiple of 4.
    pub stride: usize,
    /// Number of disparities.
    pub disparities: usize,
    /// Of each block of [`RIVAL_BLOCK_PX`] pixels 0, unless they are in doubt.
    pub doubts: &'a [u8],
    /// Costs in doubt are divided by 2 to the power of this, below 8.
    pub shift: u8,
}

/// Divides the costs of the pixels in doubt, rounding down.
#[inline(always)]
pub fn attenuate_row(row: &mut AttenuateRow<'_>) {
    let stride = row.stride.max(1);
    let shift = u32::from(row.shift & 7);
    // The bits of each cost that stay once they are shifted within a word.
    let kept = (0xff >> shift) * 0x0101_0101;
    let blocks = row.costs.chunks_mut(RIVAL_BLOCK_PX * stride);
    for (block, &doubt) in blocks.zip(row.doubts) {
        if doubt == 0 {
            continue;
        }
        for costs in block.chunks_mut(stride) {
            let (words, rest) = costs
                .split_at_mut_checked(row.disparities)
                .unwrap_or_default()
                .0
                .as_chunks_mut();
            for word in words {
                *word = (u32::from_le_bytes(*word) >> shift & kept).to_le_bytes();
            }
            for cost in rest {
                *cost >>= shift;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec;

    use super::*;
    use crate::kernel::NO_COST;

    #[test]
    fn costs_in_doubt_are_divided_and_what_is_beyond_the_range_stays() {
        let (stride, disparities, width) = (16, 11, 10);
        let mut costs = vec![NO_COST; width * stride];
        for pixel in costs.chunks_mut(stride) {
            for (cost, value) in pixel[..disparities].iter_mut().zip((3..).step_by(20)) {
                *cost = value;
            }
        }
        let before = costs.clone();
        attenuate_row(&mut AttenuateRow {
            costs: &mut costs,
            stride,
            disparities,
            doubts: &[0, 2, 1],
            shift: 2,
        });
        for (index, (&after, &before)) in costs.iter().zip(&before).enumerate() {
            let (pixel, disparity) = (index / stride, index % stride);
            let is_divided = pixel >= RIVAL_BLOCK_PX && disparity < disparities;
            assert_eq!(after, if is_divided { before / 4 } else { before });
        }
    }
}
