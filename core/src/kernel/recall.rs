//! Recall: the nearest stored pattern of every neuron of a row, and the runners-up.
//!
//! All neurons share their offsets, so the memory of a neuron is a run of the other view's row
//! of patterns: those of the columns at which its disparities would put it.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use super::hamming::{LANES, NO_DISTANCE, Planes};
use super::nearest::{best, nearest, nth_at};
use crate::disparity::INVALID;

/// Choice among several nearest stored patterns at one distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum TieBreak {
    /// The lowest disparity.
    Lowest,
    /// One at random (paper, Section II). The draw depends on this seed, the line and
    /// the column alone, so that every part of a frame can be computed by itself.
    Random {
        /// Seed of the frame.
        seed: u64,
    },
}

impl TieBreak {
    /// This rule with another seed.
    #[must_use]
    pub const fn with_seed(self, seed: u64) -> Self {
        match self {
            Self::Lowest => Self::Lowest,
            Self::Random { .. } => Self::Random { seed },
        }
    }
}

/// One of `0 .. ties` from one 32-bit draw; no choice is likelier than another by more than
/// `ties / 2^32`.
#[inline(always)]
pub(crate) fn pick(draw: u32, ties: usize) -> usize {
    // The high word of a product is below its right factor.
    ((u64::from(draw) * ties as u64) >> 32) as usize
}

/// A row of neurons to recall.
#[derive(Debug, Clone, Copy)]
pub struct RowRecall<'a> {
    /// Patterns of the reference view, one per neuron.
    pub inputs: Planes<'a>,
    /// Number of neurons in the row.
    pub count: usize,
    /// Patterns of the other view.
    pub stored: Planes<'a>,
    /// Number of patterns in `stored`.
    pub stored_count: usize,
    /// Position in `stored` of neuron 0's pattern for the lowest disparity; it may lie
    /// outside.
    pub first: isize,
    /// Change of that position from one neuron to the next: -1 or 1.
    pub step: isize,
    /// Lowest disparity, px.
    pub minimum_px: i16,
    /// Number of disparities.
    pub disparities: usize,
    /// Number of candidates per neuron, the recalled one included, at least 1.
    pub candidates: usize,
    /// Choice among several nearest patterns at one distance.
    pub ties: TieBreak,
    /// Line of the frame, for random ties.
    pub line: u32,
    /// Column of neuron 0 in the frame, for random ties.
    pub column: u32,
}

/// Recalls every neuron of `row` (paper, Section II).
///
/// `candidates_px` gets `row.candidates` planes of `row.count` disparities, px. Plane 0 is the
/// recalled output, ties broken as `row.ties` says. Plane `k` is the stored disparity that
/// comes as number `k` in the order of distance and then of disparity. [`INVALID`] stands where
/// there is none. `distances` is scratch of the number of disparities, rounded up to a multiple
/// of [`LANES`].
#[inline(always)]
pub fn recall_row(row: &RowRecall<'_>, distances: &mut [i16], candidates_px: &mut [i16]) {
    candidates_px.fill(INVALID);
    let mut generator = match row.ties {
        TieBreak::Lowest => None,
        TieBreak::Random { seed } => {
            let mut generator = Pcg32::seed_from_u64(seed.wrapping_add(u64::from(row.line)));
            generator.advance(u64::from(row.column));
            Some(generator)
        }
    };
    let mut start = row.first;
    for x in 0..row.count {
        // The part of the run of disparities whose columns are inside the other view.
        let before = start.min(0).unsigned_abs();
        let first = start.max(0).unsigned_abs();
        let count = row
            .disparities
            .saturating_sub(before)
            .min(row.stored_count.saturating_sub(first));
        start += row.step;
        // One draw per column, used or not: see `TieBreak::Random`.
        let draw = generator.as_mut().map_or(0, Rng::next_u32);
        let Some(run) = distances.get_mut(..count.next_multiple_of(LANES)) else {
            continue;
        };
        super::distances(row.inputs, x, row.stored, first, count, run);
        let nearest = nearest(run);
        if nearest.ties == 0 || nearest.distance == NO_DISTANCE {
            continue;
        }
        let chosen = pick(draw, nearest.ties);
        let index = if chosen == 0 {
            nearest.first
        } else {
            nth_at(run, nearest.distance, chosen).unwrap_or(nearest.first)
        };
        // Both fit: a range of disparities is checked to fit `i16`.
        let disparity_px = |index: usize| row.minimum_px + (before + index) as i16;
        if let Some(recalled) = candidates_px.get_mut(x) {
            *recalled = disparity_px(index);
        }
        if row.candidates > 1 {
            best(run, row.candidates, |rank, index| {
                if rank > 0
                    && let Some(candidate) = candidates_px.get_mut(rank * row.count + x)
                {
                    *candidate = disparity_px(index);
                }
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Neurons of eight cells whose patterns are counted by hand.
    #[test]
    fn a_neuron_recalls_the_nearest_pattern_in_its_run() {
        const STRIDE: usize = 3 + LANES;
        let plane = |patterns: [u8; 3]| {
            let mut bytes = [0; STRIDE];
            bytes[..3].copy_from_slice(&patterns);
            bytes
        };
        let planes = |bytes| Planes {
            bytes,
            stride: STRIDE,
            count: 1,
        };
        // The inputs are inverted from the paper's Table 1, so that the distances are 2, 1 and 3.
        let inputs = plane([0b101, 0b101, 0b101]);
        let stored = plane([0b110, 0b001, 0b010]);
        let row = RowRecall {
            inputs: planes(&inputs),
            count: 3,
            stored: planes(&stored),
            stored_count: 3,
            first: -1,
            step: 1,
            minimum_px: 10,
            disparities: 3,
            candidates: 3,
            ties: TieBreak::Lowest,
            line: 0,
            column: 0,
        };
        let mut candidates = [7; 9];
        recall_row(&row, &mut [0; LANES], &mut candidates);
        // Neuron 0 begins one pattern before the first, neuron 2 reaches one beyond the last.
        let by_rank = [[12, 11, 10], [11, 10, 11], [INVALID, 12, INVALID]];
        assert_eq!(candidates.as_chunks::<3>().0, by_rank);
    }

    #[test]
    fn a_draw_picks_each_tie_as_often() {
        let picked = |ties| (0..ties).map(move |tie| ((1u64 << 32) * tie / ties) as u32 + 1);
        for ties in 1..9 {
            for (tie, draw) in picked(ties).enumerate() {
                assert_eq!(pick(draw, ties as usize), tie);
            }
        }
        assert_eq!(pick(u32::MAX, 5), 4);
    }
}
