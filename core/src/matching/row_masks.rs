//! Masks of a row, block by block, made when they are asked for or ahead of that.

use core::num::NonZeroU8;

use super::cost::MAX_CHANNELS;
use super::mask::{MASK_LANES, MaskBlock};
use crate::config::{Aggregation, Config};
use crate::kernel::Kernels;
use crate::memory::{Arena, OutOfMemory, words};
use crate::minchinton::CELLS_PER_BYTE;
use crate::strip::Strip;
use crate::synapse::{Offset, Synapses};

/// Masks of a block of pixels.
#[derive(Debug, Clone, Copy)]
pub struct BlockMasks<'a> {
    /// The cells that count: a row per byte of cells, a byte per pixel of the block.
    pub masks: &'a [u8],
    /// Cells in each mask.
    pub counts: [u16; MASK_LANES],
}

/// Stored position of the first pixel of the block that has the masks from `start` on, a
/// multiple of [`MASK_LANES`]: the last block of a row overlaps the one before rather than be
/// narrower.
#[must_use]
pub const fn block_first(start: usize, width: usize) -> usize {
    let last = width.saturating_sub(MASK_LANES);
    if start < last { start } else { last }
}

/// Where a matcher has the masks of its rows from.
pub trait RowMasks {
    /// Begins row `line`; `channels` are the reference view's, with the lines around the row
    /// still there.
    fn begin(&mut self, channels: &[Strip<'_>], line: u32);

    /// Masks of the row's pixels from stored position `first` on: [`MASK_LANES`] of them, or
    /// all of a row that is narrower. `first` is one that
    /// [`block_first`] gives; `scratch` has at least [`SurfaceMasks::scratch_bytes`].
    fn block(&mut self, channels: &[Strip<'_>], first: usize, scratch: &mut [u8])
    -> BlockMasks<'_>;
}

/// Masks made when they are asked for.
#[derive(Debug)]
pub struct SurfaceMasks<'m, K> {
    kernels: K,
    synapses: Synapses<'m>,
    masks: &'m mut [u8],
    /// Where in the strips the row's first pixel has its samples, by synapse.
    starts: &'m mut [u32],
    /// Where it is itself.
    centre: usize,
    width: usize,
    lanes: usize,
    kept: u16,
    floor: u8,
    step: NonZeroU8,
}

impl SurfaceMasks<'_, ()> {
    /// Words of memory; none where every cell counts.
    #[must_use]
    pub const fn memory_words(config: &Config, parameters: &Aggregation) -> usize {
        if every_cell_counts(parameters) {
            return 0;
        }
        let cells = config.parameters.synapses as usize;
        words(cells / CELLS_PER_BYTE * MASK_LANES, 1) + words(cells, size_of::<u32>())
    }

    /// Bytes of scratch for a block.
    #[must_use]
    pub const fn scratch_bytes(config: &Config, parameters: &Aggregation) -> usize {
        if every_cell_counts(parameters) {
            return 0;
        }
        config.parameters.synapses as usize * MASK_LANES
    }
}

const fn every_cell_counts(parameters: &Aggregation) -> bool {
    parameters.kept_cells_q8 >= 256
}

impl<'m, K: Kernels> SurfaceMasks<'m, K> {
    /// Masks of cells of these synapses; `None` where every cell counts.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`SurfaceMasks::memory_words`] left.
    pub fn new(
        config: &Config,
        parameters: &Aggregation,
        synapses: Synapses<'m>,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Option<Self>, OutOfMemory> {
        if every_cell_counts(parameters) {
            return Ok(None);
        }
        let count = config.parameters.synapses;
        let synapse_count = usize::from(count);
        let width = usize::from(config.width);
        let lanes = MASK_LANES.min(width);
        let masks: &'m mut [u8] = arena.take(synapse_count / CELLS_PER_BYTE * MASK_LANES)?;
        // At least one cell, rounded up, and at most the number of synapses.
        let kept = (u32::from(count) * u32::from(parameters.kept_cells_q8)).div_ceil(256);
        Ok(Some(Self {
            kernels,
            synapses,
            // Of a narrow row, a block is smaller.
            masks: masks
                .get_mut(..synapse_count / CELLS_PER_BYTE * lanes)
                .unwrap_or_default(),
            starts: arena.take(synapse_count)?,
            centre: 0,
            width,
            lanes,
            kept: kept.max(1) as u16,
            floor: parameters.mask_floor,
            step: parameters.mask_step,
        }))
    }
}

impl<K: Kernels> RowMasks for SurfaceMasks<'_, K> {
    fn begin(&mut self, channels: &[Strip<'_>], line: u32) {
        // Strips of all channels have one shape.
        let window = channels.first().map(|channel| channel.window(line));
        let width = self.width;
        // No support leaves the strip.
        let start = |offset| window.and_then(|window| window.start(offset, 0, width));
        for (to, offset) in self.starts.iter_mut().zip(self.synapses.iter()) {
            *to = start(offset).unwrap_or(0) as u32;
        }
        self.centre = start(Offset { dx: 0, dy: 0 }).unwrap_or(0);
    }

    fn block(
        &mut self,
        channels: &[Strip<'_>],
        first: usize,
        scratch: &mut [u8],
    ) -> BlockMasks<'_> {
        let mut levels = [&[][..]; MAX_CHANNELS];
        for (levels, channel) in levels.iter_mut().zip(channels) {
            *levels = channel.pixels();
        }
        // Floor and step are stated for the sum of three channels.
        let (floor, step) = match channels.len() {
            1 => (self.floor / 3, self.step.get() / 3),
            _ => (self.floor, self.step.get()),
        };
        let cells = self.synapses.len() * self.lanes;
        debug_assert!(scratch.len() >= cells, "scratch of the masks");
        let mut task = MaskBlock {
            levels,
            channels: channels.len(),
            centre: self.centre + first,
            starts: self.starts,
            first,
            lanes: self.lanes,
            kept: self.kept,
            floor,
            step: NonZeroU8::new(step).unwrap_or(NonZeroU8::MIN),
            cells: scratch.get_mut(..cells).unwrap_or_default(),
            masks: self.masks,
            counts: [0; MASK_LANES],
        };
        self.kernels.mask_block(&mut task);
        let counts = task.counts;
        BlockMasks {
            masks: self.masks,
            counts,
        }
    }
}
