//! Differences of a block of pixels from their samples, four pixels in a word.

use vgstereo_core::matching::{self, DifferenceBlock, MASK_LANES, MAX_CHANNELS};
use vgstereo_core::synapse::Offset;

use crate::simd::{add_saturating_u8x4, distance_u8x4, load, store};

/// Words of a row of the block.
const WORDS: usize = MASK_LANES / 4;

/// Four pixels each.
type Row = [[u8; 4]; WORDS];

/// The same as core's `difference_block`.
#[inline(never)]
pub fn difference_block(block: &DifferenceBlock<'_>, differences: &mut [u8]) {
    let (rows, rest) = differences.as_chunks_mut::<4>().0.as_chunks_mut::<WORDS>();
    if block.lanes != MASK_LANES || !rest.is_empty() {
        matching::difference_block(block, differences);
    } else if block.channels == 1 {
        difference_channels::<1>(block, rows);
    } else {
        difference_channels::<MAX_CHANNELS>(block, rows);
    }
}

#[inline(always)]
fn difference_channels<const CHANNELS: usize>(block: &DifferenceBlock<'_>, rows: &mut [Row]) {
    let mut channels = [&[][..]; CHANNELS];
    for (pixels, window) in channels.iter_mut().zip(&block.windows) {
        *pixels = window.pixels();
    }
    let runs_at = |offset: Offset| -> Option<[&Row; CHANNELS]> {
        let start = block.windows[0].start(offset, block.first, MASK_LANES)?;
        let mut runs = [&[[0; 4]; WORDS]; CHANNELS];
        for (run, pixels) in runs.iter_mut().zip(&channels) {
            *run = pixels.get(start..)?.as_chunks().0.first_chunk()?;
        }
        Some(runs)
    };
    let Some(centres) = runs_at(Offset { dx: 0, dy: 0 }) else {
        rows.fill([[0; 4]; WORDS]);
        return;
    };
    let centres = centres.map(|run| run.map(|bytes| load(&bytes)));
    for (row, offset) in rows.iter_mut().zip(block.synapses.iter()) {
        let Some(runs) = runs_at(offset) else {
            *row = [[0; 4]; WORDS];
            continue;
        };
        for (word, to) in row.iter_mut().enumerate() {
            let mut sum = 0;
            for (centre, run) in centres.iter().zip(runs) {
                let difference = distance_u8x4(centre[word], load(&run[word]));
                sum = if CHANNELS == 1 {
                    difference
                } else {
                    add_saturating_u8x4(sum, difference)
                };
            }
            store(sum, to);
        }
    }
}
