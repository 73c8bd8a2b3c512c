//! Differences of a block of pixels from their samples, for processors whose registers hold
//! the whole block: what is the same for all synapses that see a line is looked up once.

use vgstereo_core::matching::{DifferenceBlock, MASK_LANES, MAX_CHANNELS};
use vgstereo_core::synapse::Offset;

/// Where a line begins that is not there: beyond every strip, and far from overflow.
const NO_LINE: usize = usize::MAX / 4;

/// The same as core's `difference_block`, for blocks of [`MASK_LANES`] pixels. Inlined to
/// be compiled for the caller's instruction set.
#[inline(always)]
pub fn difference_block(block: &DifferenceBlock<'_>, differences: &mut [u8]) {
    match block.channels {
        1 => difference_channels::<1>(block, differences),
        _ => difference_channels::<MAX_CHANNELS>(block, differences),
    }
}

#[inline(always)]
fn difference_channels<const CHANNELS: usize>(block: &DifferenceBlock<'_>, differences: &mut [u8]) {
    let window = &block.windows[0];
    let mut lines = [NO_LINE; 1 << u8::BITS];
    let heights = block.synapses.iter().map(|offset| offset.dy);
    let (top, bottom) = heights.fold((0, 0), |(top, bottom), dy| (dy.min(top), dy.max(bottom)));
    for dy in top..=bottom {
        lines[usize::from(dy.cast_unsigned())] = window.row(dy).unwrap_or(NO_LINE);
    }
    let mut channels = [&[][..]; CHANNELS];
    for (pixels, window) in channels.iter_mut().zip(&block.windows) {
        *pixels = window.pixels();
    }
    // Strips of one shape; said so that one check serves all.
    let length = channels.iter().map(|pixels| pixels.len()).min();
    let channels = channels.map(|pixels| &pixels[..length.unwrap_or(0)]);
    let run_at = |offset: Offset| -> Option<[&[u8; MASK_LANES]; CHANNELS]> {
        let column = window.column(offset.dx, block.first)?;
        if column + MASK_LANES > window.stride() {
            return None;
        }
        let start = lines[usize::from(offset.dy.cast_unsigned())] + column;
        let mut runs = [&[0; MASK_LANES]; CHANNELS];
        for (run, pixels) in runs.iter_mut().zip(&channels) {
            *run = pixels.get(start..)?.first_chunk()?;
        }
        Some(runs)
    };
    let rows = differences.as_chunks_mut::<MASK_LANES>().0;
    let Some(centres) = run_at(Offset { dx: 0, dy: 0 }).map(|centres| centres.map(|run| *run))
    else {
        rows.fill([0; MASK_LANES]);
        return;
    };
    for (row, offset) in rows.iter_mut().zip(block.synapses.iter()) {
        let mut sum = [0_u8; MASK_LANES];
        if let Some(runs) = run_at(offset) {
            for (centre, run) in centres.iter().zip(runs) {
                for lane in 0..MASK_LANES {
                    let (a, b) = (centre[lane], run[lane]);
                    // One of the two is 0; this form stays 8 bits wide in vector code.
                    let difference = a.saturating_sub(b) | b.saturating_sub(a);
                    sum[lane] = sum[lane].saturating_add(difference);
                }
            }
        }
        *row = sum;
    }
}
