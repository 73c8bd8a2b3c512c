//! Rivals: where what is seen repeats along the line, a second disparity fits about as well as the best,
//! and paths decide between them by what lies around. Such pixels are in doubt.
//!
//! The matching costs of a row are summed over a window along the line, as they are before aggregation.
//! Where a sum is nearly as small as the least one, and much larger ones lie between, the least has a rival. A
//! short run of pixels with rivals is chance. A longer one puts those around it in doubt as well: their
//! windows reach beyond what repeats.

use super::lanes::{LANES, Lanes, add, in_order, lanes_of, subtract};
use crate::config::RivalParameters;
use crate::rows::{Arena, OutOfMemory, words};

/// Pixels that share a window.
const BLOCK_PX: usize = 4;

/// Distance of the pixels of a window whose costs are summed up, px. Those between have nearly the same
/// patterns.
const SAMPLE_STEP: usize = 2;

/// The highest bit of each of two sums. No sum has it: 65 costs of at most 254 are less.
const HIGHEST: u32 = 0x8000_8000;

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
    ) {
        if self.rows_left > 0 {
            self.rows_left -= 1;
            return;
        }
        self.rows_left = parameters.row_step.saturating_sub(1);
        let sums = scratch.as_chunks_mut::<2>().0;
        let sums = sums.get_mut(..disparities / LANES).unwrap_or_default();
        self.search(costs, stride, sums, parameters);
        self.keep_long_runs(parameters.run_min_px);
        self.spread(parameters.spread_px);
    }

    /// Takes the confidence from pixels in doubt.
    pub(super) fn doubt(&self, confidences: &mut [u8]) {
        for (block, &doubt) in confidences.chunks_mut(BLOCK_PX).zip(&*self.doubts) {
            if doubt > 0 {
                block.fill(0);
            }
        }
    }

    /// Marks the blocks whose window has a rival. `sums` is for those of the costs over the window.
    fn search(
        &mut self,
        costs: &[u8],
        stride: usize,
        sums: &mut [Lanes],
        parameters: &RivalParameters,
    ) {
        let reach = usize::from(parameters.reach_px);
        sums.fill([0; 2]);
        let costs_of = |x: usize| {
            let costs = costs.get(x * stride..(x + 1) * stride);
            let (words, _) = costs.unwrap_or_default().as_chunks::<LANES>();
            words
                .iter()
                .map(|&costs| lanes_of(u32::from_le_bytes(costs)))
        };
        let width = costs.len() / stride.max(1);
        let samples =
            |from: usize, to: usize| (from.next_multiple_of(SAMPLE_STEP)..to).step_by(SAMPLE_STEP);
        // The columns whose samples are in the sums.
        let mut window = 0..0;
        for (doubt, first) in self.doubts.iter_mut().zip((0..).step_by(BLOCK_PX)) {
            let centre = first + BLOCK_PX / 2;
            let next = centre.saturating_sub(reach)..(centre + reach + 1).min(width);
            let mut entering = samples(window.end, next.end);
            let mut leaving = samples(window.start, next.start);
            loop {
                // What leaves has entered before.
                match (entering.next(), leaving.next()) {
                    (Some(entering), Some(leaving)) => {
                        let both = costs_of(entering).zip(costs_of(leaving));
                        for (sums, (entering, leaving)) in sums.iter_mut().zip(both) {
                            add(sums, entering);
                            subtract(sums, leaving);
                        }
                    }
                    (Some(entering), None) => {
                        let costs = costs_of(entering);
                        sums.iter_mut().zip(costs).for_each(|(a, b)| add(a, b));
                    }
                    (None, Some(leaving)) => {
                        let costs = costs_of(leaving);
                        sums.iter_mut().zip(costs).for_each(|(a, b)| subtract(a, b));
                    }
                    (None, None) => break,
                }
            }
            let count = samples(next.start, next.end).len();
            *doubt = u8::from(has_rival(sums, count, parameters));
            window = next;
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

/// Whether the least of the sums over `samples` pixels has a rival: whether sums below the bound lie on both
/// sides of one that is far above it. Where they do, one of them is the least.
fn has_rival(sums: &[Lanes], samples: usize, parameters: &RivalParameters) -> bool {
    let least = sums.iter().flatten().fold(!HIGHEST, |a, &b| least_of(a, b));
    let least = (least & 0xffff).min(least >> 16);
    let bound = ((least * u32::from(parameters.ratio_q4)) >> 4) + u32::from(parameters.slack);
    let wall = bound + u32::from(parameters.rise) * samples as u32;
    let (lows_end, walls_start) = (both_halves(bound), both_halves(wall));
    let (mut has_low, mut has_wall) = (false, false);
    for &sums in sums {
        // Only a wall is looked for after a low sum, and only a low sum otherwise.
        let [a, b] = sums;
        let has_none = if has_low && !has_wall {
            at_least(a, walls_start) | at_least(b, walls_start) == 0
        } else {
            at_least(a, lows_end) & at_least(b, lows_end) == HIGHEST
        };
        if has_none {
            continue;
        }
        for sum in in_order(sums) {
            if sum < bound {
                if has_wall {
                    return true;
                }
                has_low = true;
            } else if sum >= wall {
                has_wall = has_low;
            }
        }
    }
    false
}

/// A bound of sums in both halves of a word; all that are above every sum are the same.
fn both_halves(bound: u32) -> u32 {
    // Either half of `HIGHEST`.
    let bound = bound.min(1 << 15);
    bound << 16 | bound
}

/// The highest bit of each of the two sums of a word that is at least its bound.
#[inline(always)]
fn at_least(sums: u32, bounds: u32) -> u32 {
    // No half borrows.
    ((sums | HIGHEST) - bounds) & HIGHEST
}

/// The lesser of each of the two sums of two words.
fn least_of(a: u32, b: u32) -> u32 {
    // Where `b` is not the greater one, the difference keeps the highest bit.
    let kept = at_least(a, b);
    let mask = kept - (kept >> 15);
    a ^ ((a ^ b) & mask)
}
