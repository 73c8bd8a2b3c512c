//! Rivals: where what is seen repeats along the line, a second disparity fits about as well as the best,
//! and paths decide between them by what lies around. Such pixels are in doubt: their costs count less in the
//! aggregation, and steps from them cost more, so that paths bring in what is known around them.
//!
//! The matching costs of a row are summed over a window along the line, as they are before aggregation.
//! Where a sum is nearly as small as the least one, and much larger ones lie between, the least has a rival. A
//! short run of pixels with rivals is chance. A longer one puts those around it in doubt as well: their
//! windows reach beyond what repeats.

use crate::config::RivalParameters;
use crate::kernel::{AttenuateRow, Kernels, RIVAL_BLOCK_PX as BLOCK_PX, RivalsRow};
use crate::rows::{Arena, OutOfMemory, words};

/// Finds rivals row by row.
#[derive(Debug)]
pub(super) struct Rivals<'m> {
    /// Whether the pixels of a block are in doubt, block by block.
    doubts: &'m mut [u8],
    /// Rows until the next is searched.
    rows_left: u8,
}

impl<'m> Rivals<'m> {
    /// Words of memory: a byte per block.
    pub(super) const fn words(width: usize) -> usize {
        words(width.div_ceil(BLOCK_PX), 1)
    }

    /// # Errors
    /// [`OutOfMemory`] when the arena has less left than [`Rivals::words`] says.
    pub(super) fn new(width: usize, arena: &mut Arena<'m>) -> Result<Self, OutOfMemory> {
        Ok(Self {
            doubts: arena.take(width.div_ceil(BLOCK_PX))?,
            rows_left: 0,
        })
    }

    /// Forgets the frame: the next row is searched.
    pub(super) fn reset(&mut self) {
        self.rows_left = 0;
    }

    /// Takes the costs of the next row, `stride` per pixel, of which the first are those of the
    /// `disparities`. All rows but every `row_step`th have the doubts of the row above. `scratch` has a word
    /// for each disparity.
    // Apart, so that its stack is not that of costs and aggregation as well.
    #[inline(never)]
    pub(super) fn observe(
        &mut self,
        costs: &[u8],
        stride: usize,
        disparities: usize,
        scratch: &mut [u32],
        parameters: &RivalParameters,
        kernels: &impl Kernels,
    ) {
        if self.rows_left > 0 {
            self.rows_left -= 1;
            return;
        }
        self.rows_left = parameters.row_step.saturating_sub(1);
        let row = RivalsRow {
            costs,
            stride,
            disparities,
            reach_px: parameters.reach_px.into(),
            ratio_q4: parameters.ratio_q4,
            slack: parameters.slack,
            rise: parameters.rise,
        };
        kernels.rivals_row(&row, scratch, self.doubts);
        self.keep_long_runs(parameters.run_min_px);
        self.spread(parameters.spread_px);
    }

    /// Attenuates the costs of pixels in doubt, of the row observed last.
    pub(super) fn attenuate(
        &self,
        costs: &mut [u8],
        stride: usize,
        disparities: usize,
        parameters: &RivalParameters,
        kernels: &impl Kernels,
    ) {
        if parameters.cost_shift > 0 {
            kernels.attenuate_row(&mut AttenuateRow {
                costs,
                stride,
                disparities,
                doubts: self.doubts,
                shift: parameters.cost_shift,
            });
        }
    }

    /// Writes `value` for each pixel in doubt.
    // Apart, so that all rows have one.
    #[inline(never)]
    pub(super) fn fill(&self, row: &mut [u8], value: u8) {
        for (block, &doubt) in row.chunks_mut(BLOCK_PX).zip(&*self.doubts) {
            if doubt > 0 {
                block.fill(value);
            }
        }
    }

    /// Clears runs of marked blocks that are shorter than `run_min_px`.
    fn keep_long_runs(&mut self, run_min_px: u8) {
        let blocks_min = usize::from(run_min_px).div_ceil(BLOCK_PX);
        let mut rest = &mut *self.doubts;
        while let Some(&first) = rest.first() {
            let length = rest.iter().take_while(|&&doubt| doubt == first).count();
            let Some((run, after)) = rest.split_at_mut_checked(length) else {
                break;
            };
            if run.len() < blocks_min {
                run.fill(0);
            }
            rest = after;
        }
    }

    /// Marks the blocks up to `spread_px` from marked ones.
    fn spread(&mut self, spread_px: u8) {
        let reach = usize::from(spread_px) / BLOCK_PX;
        spread_on(self.doubts.iter_mut(), reach);
        spread_on(self.doubts.iter_mut().rev(), reach);
    }
}

/// Marks up to `reach` blocks that follow one which was searched and marked, with 2.
fn spread_on<'a>(blocks: impl Iterator<Item = &'a mut u8>, reach: usize) {
    let mut left = 0;
    for doubt in blocks {
        if *doubt == 1 {
            left = reach;
        } else if left > 0 {
            left -= 1;
            *doubt = 2;
        }
    }
}
