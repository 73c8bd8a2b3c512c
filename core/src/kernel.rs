//! Kernels: the inner loops, as a plain reference that faster ones equal bit for bit.
//!
//! A kernel set is a type that implements [`Kernels`]. [`Portable`] is the reference:
//! plain safe code whose loops have fixed trip counts, so that a compiler vectorises
//! them. Other crates bring faster sets, for example the same bodies compiled for a
//! wider instruction set that was found at run time, or a chip's own instructions.

use crate::aggregation::{AggregateRow, aggregate_paths, select_row};
use crate::camera::PixelFormat;
use crate::matching::{
    CostRun, LevelConversion, MaskBlock, RowRecall, convert_row, cost_run, mask_block, recall_row,
    smooth_row,
};
use crate::minchinton::CELLS_PER_BYTE;
use crate::refine::{ArmsRow, WeightedMedianRow, arms_row, median9_row, weighted_median_row};

/// The inner loops of the pipeline. Provided methods are the reference; an override
/// must give the same bits for every input.
pub trait Kernels: Copy {
    /// Takes the luma of a line; see [`PixelFormat::luma`].
    #[inline]
    fn luma_row(&self, format: PixelFormat, line: &[u8], grey: &mut [u8]) {
        format.luma(line, grey);
    }

    /// Takes a channel of a line; see [`PixelFormat::channel`].
    #[inline]
    fn channel_row(&self, format: PixelFormat, line: &[u8], channel: usize, row: &mut [u8]) {
        format.channel(line, channel, row);
    }

    /// Converts levels of the other view; see [`convert_row`].
    #[inline]
    fn convert_row(
        &self,
        conversion: &LevelConversion,
        levels: &[u8],
        low: &mut [u8],
        high: &mut [u8],
    ) {
        convert_row(conversion, levels, low, high);
    }

    /// Smooths a line of grey; see [`smooth_row`]. Where a row is shorter than two pixels more
    /// than `smoothed`, that stays as it is.
    #[inline]
    fn smooth_row(&self, rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
        smooth_row(rows, step_max, smoothed);
    }

    /// Forms eight Minchinton cells for each of a run of neurons: bit `k` of
    /// `packed[i]` is `samples[k][i] > samples[k + 1][i]`.
    ///
    /// All sample rows have `packed.len()` elements; of shorter ones, only the common
    /// length is packed.
    #[inline]
    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
        pack_cells(samples, packed);
    }

    /// Recalls a row of neurons; see [`RowRecall`].
    #[inline]
    fn recall_row(&self, row: &RowRecall<'_>, distances: &mut [i16], candidates_px: &mut [i16]) {
        recall_row(row, distances, candidates_px);
    }

    /// Finds the cells that count of a block of pixels; see [`MaskBlock`].
    #[inline]
    fn mask_block(&self, block: &mut MaskBlock<'_>) {
        mask_block(block);
    }

    /// Computes the matching costs of a run of pixels; see [`CostRun`].
    #[inline]
    fn cost_run(&self, row: &CostRun<'_>, costs: &mut [u8]) {
        cost_run(row, costs);
    }

    /// Finds how far the surfaces of a line's pixels reach; see [`ArmsRow`].
    #[inline]
    fn arms_row(&self, row: &ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]) {
        arms_row(row, scratch, arms);
    }

    /// Filters a row by its median of 3 x 3 pixels; see [`median9_row`].
    #[inline]
    fn median9_row(&self, rows: [&[i16]; 3], output: &mut [i16]) {
        median9_row(rows, output);
    }

    /// Filters a row by its weighted median; see [`WeightedMedianRow`].
    #[inline]
    fn weighted_median_row(
        &self,
        row: &WeightedMedianRow<'_>,
        weights: &mut [u8],
        output: &mut [i16],
    ) {
        weighted_median_row(row, weights, output);
    }

    /// Aggregates a row of costs and selects; see [`AggregateRow`]. A set that selects while
    /// it aggregates overrides this, others the two halves.
    #[inline]
    fn aggregate_row(&self, row: &mut AggregateRow<'_>) {
        self.aggregate_paths(row);
        self.select_row(row);
    }

    /// The first half: path costs, those from the left in place of the costs.
    #[inline]
    fn aggregate_paths(&self, row: &mut AggregateRow<'_>) {
        aggregate_paths(row);
    }

    /// The second half: the best disparities of both views.
    #[inline]
    fn select_row(&self, row: &mut AggregateRow<'_>) {
        select_row(row);
    }
}

/// The reference kernels.
#[derive(Debug, Clone, Copy, Default)]
pub struct Portable;

impl Kernels for Portable {}

/// The reference of [`Kernels::pack_cells`], inlined so that a caller may compile it
/// for its own instruction set.
#[inline(always)]
pub fn pack_cells(samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
    let [a, b, c, d, e, f, g, h, i] = *samples;
    let common = samples.iter().fold(packed.len(), |n, row| n.min(row.len()));
    // Equal lengths, proven once: no check is left in the loop.
    let (a, b, c) = (&a[..common], &b[..common], &c[..common]);
    let (d, e, f) = (&d[..common], &e[..common], &f[..common]);
    let (g, h, i) = (&g[..common], &h[..common], &i[..common]);
    let packed = &mut packed[..common];
    let bit = |own: u8, partner: u8, place: u32| u8::from(own > partner) << place;
    for x in 0..common {
        packed[x] = bit(a[x], b[x], 0)
            | bit(b[x], c[x], 1)
            | bit(c[x], d[x], 2)
            | bit(d[x], e[x], 3)
            | bit(e[x], f[x], 4)
            | bit(f[x], g[x], 5)
            | bit(g[x], h[x], 6)
            | bit(h[x], i[x], 7);
    }
}
