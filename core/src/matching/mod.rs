//! Matching of one row: every neuron of the line against the patterns stored for it.
//!
//! All neurons share their offsets, so the memory of neuron `x` is a run of the row of
//! patterns of the other view: those of the columns at which its disparities would put
//! it. Kept so that rising disparities are rising positions (the other view is stored
//! mirrored when the reference is the left one), the memory of a whole row of neurons
//! is one [`PatternRow`](crate::minchinton::PatternRow).
//!
//! [`RowMatcher`] recalls the nearest patterns, as the paper has it. [`SurfaceMatcher`]
//! makes costs of the distances: over the cells on the pixel's surface (mask), with a
//! difference of levels in the reference camera's exposure (exposure, cost). On the way it
//! learns by how much the other view's lines lie too low (alignment). Half of its samples are
//! taken where noise is averaged away (smoothing).

mod alignment;
mod channels;
mod cost;
mod exposure;
mod hamming;
mod mask;
mod row;
mod row_masks;
mod sampler;
mod smoothing;
mod surface;
mod winner;

pub use channels::ChannelStrips;
pub use cost::{CostRun, MAX_CHANNELS, NO_COST, cost_run, cost_stride};
pub use exposure::{LevelConversion, convert_row};
pub use hamming::{LANES, NO_DISTANCE, distances};
pub use mask::{MASK_LANES, MaskBlock, mask_block};
pub use row::RowMatcher;
pub use row_masks::{BlockMasks, RowMasks, SurfaceMasks, block_first};
pub use smoothing::smooth_row;
pub use surface::SurfaceMatcher;
pub use winner::{Nearest, best, nearest, nth_at};

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use crate::disparity::INVALID;
use crate::minchinton::Planes;
use crate::neuron::pick;

/// How the nearest of several stored patterns at the same distance is chosen.
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

/// One row of neurons to recall.
#[derive(Debug, Clone, Copy)]
pub struct RowRecall<'a> {
    /// Patterns of the reference view, one per neuron.
    pub inputs: Planes<'a>,
    /// Neurons in the row.
    pub count: usize,
    /// Patterns of the other view.
    pub stored: Planes<'a>,
    /// Patterns in `stored`.
    pub stored_count: usize,
    /// Position in `stored` of neuron 0's pattern for the lowest disparity; it may lie
    /// outside.
    pub first: isize,
    /// How that position moves from a neuron to the next: -1 or 1.
    pub step: isize,
    /// Lowest disparity, px.
    pub minimum_px: i16,
    /// Number of disparities.
    pub disparities: usize,
    /// Candidates wanted per neuron, the recalled one included, at least 1.
    pub candidates: usize,
    /// How ties are broken.
    pub ties: TieBreak,
    /// Line of the frame, for random ties.
    pub line: u32,
    /// Column of neuron 0 in the frame, for random ties.
    pub column: u32,
}

/// Recalls every neuron of `row`; the reference of
/// [`Kernels::recall_row`](crate::kernel::Kernels::recall_row), inlined so that a caller
/// may compile it for its own instruction set.
///
/// `candidates_px` holds `row.candidates` planes of `row.count` disparities: plane 0 the
/// recalled output, ties broken as `row.ties` says; plane `k` the stored disparity that
/// is number `k` by distance and then by disparity. [`INVALID`] where there is none.
/// `distances` is scratch of at least the number of disparities, rounded up to a
/// multiple of [`LANES`].
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
        // Of the run of disparities, those whose column is inside the other view.
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
        self::distances(row.inputs, x, row.stored, first, count, run);
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
