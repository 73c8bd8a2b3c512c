//! Masks of a row of pixels, block by block.

use core::num::NonZeroU8;

use crate::config::{Config, SgmParameters};
use crate::kernel::{CELLS_PER_BYTE, Kernels, MASK_LANES, MAX_CHANNELS, MaskBlock};
use crate::pattern::Synapses;
use crate::rows::{Arena, Offset, OutOfMemory, Strip, words};

/// Masks of a block of pixels.
#[derive(Debug, Clone, Copy)]
pub struct BlockMasks<'a> {
    /// The cells that count: one row per eight cells, with one byte per pixel of the block.
    pub masks: &'a [u8],
    /// Number of cells in each mask.
    pub counts: [u16; MASK_LANES],
}

/// Stored position of the first pixel of the block that has the masks of pixel `start`, a multiple
/// of [`MASK_LANES`]. The last block of a row overlaps the one before it rather than being
/// narrower.
#[must_use]
pub const fn block_first(start: usize, width: usize) -> usize {
    let last = width.saturating_sub(MASK_LANES);
    if start < last { start } else { last }
}

/// A source of the masks of a matcher's rows, which computes them on demand or in advance.
pub trait RowMasks {
    /// Begins row `line`. `channels` are the reference view's, which still hold the lines around
    /// the row. The first row of a frame is begun twice, because it is matched twice.
    fn begin(&mut self, channels: &[Strip<'_>], line: u32);

    /// The masks of the row's pixels from stored position `first` on: [`MASK_LANES`] of them, or
    /// those of all pixels of a narrower row. `first` is a value of [`block_first`]; `scratch` has
    /// at least [`SgmMasks::scratch_bytes`].
    fn block(&mut self, channels: &[Strip<'_>], first: usize, scratch: &mut [u8])
    -> BlockMasks<'_>;
}

/// Masks computed on demand.
#[derive(Debug)]
pub struct SgmMasks<'m, K> {
    kernels: K,
    synapses: Synapses<'m>,
    masks: &'m mut [u8],
    /// Index in the strips of the sample that each synapse takes for the row's first pixel.
    starts: &'m mut [u32],
    /// Index in the strips of the row's first pixel.
    centre: usize,
    width: usize,
    lanes: usize,
    kept: u16,
    floor: u8,
    step: NonZeroU8,
}

impl SgmMasks<'_, ()> {
    /// Words of memory; 0 if every cell counts.
    #[must_use]
    pub const fn words(config: &Config, parameters: &SgmParameters) -> usize {
        if parameters.every_cell_counts() {
            return 0;
        }
        let cells = config.parameters.synapses as usize;
        words(cells / CELLS_PER_BYTE * MASK_LANES, 1) + words(cells, size_of::<u32>())
    }

    /// Bytes of scratch for a block.
    #[must_use]
    pub const fn scratch_bytes(config: &Config, parameters: &SgmParameters) -> usize {
        if parameters.every_cell_counts() {
            return 0;
        }
        config.parameters.synapses as usize * MASK_LANES
    }
}

impl<'m, K: Kernels> SgmMasks<'m, K> {
    /// A source of the masks of cells of these synapses; `None` if every cell counts.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the arena has fewer than [`SgmMasks::words`] left.
    pub fn new(
        config: &Config,
        parameters: &SgmParameters,
        synapses: Synapses<'m>,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Option<Self>, OutOfMemory> {
        if parameters.every_cell_counts() {
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
            // The block of a narrow row is smaller.
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

impl<K: Kernels> RowMasks for SgmMasks<'_, K> {
    fn begin(&mut self, channels: &[Strip<'_>], line: u32) {
        // Strips of all channels have one shape.
        let window = channels.first().map(|channel| channel.window(line));
        let width = self.width;
        // The support lies within the strip.
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
