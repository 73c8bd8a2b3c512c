//! A group of pixels whose matching costs are computed together.

use vgstereo_core::kernel::LANES;

/// Largest number of disparities, rounded up to a multiple of 16.
pub(super) const MAX_STRIDE: usize = 64;

/// Pixels whose patterns are copied at a time.
pub(super) const PIXELS: usize = 32;

/// Positions of the other view that their disparities reach, and one more.
pub(super) const POSITIONS: usize = PIXELS + MAX_STRIDE;

/// Disparities whose loop is unrolled. All rows of disparities are a multiple of it.
pub(super) const BLOCK: usize = LANES;

/// Pixels, at most [`PIXELS`], that are compared with the same positions of the other view. Patterns have `BYTES`
/// bytes; `TERMS` is 2 with masks and 1 if all cells count.
pub(super) struct Group<'a, const BYTES: usize, const TERMS: usize> {
    /// The pixels' patterns, byte by byte.
    pub(super) inputs: [&'a [u8]; BYTES],
    /// Their masks; empty without masks.
    pub(super) masks: [&'a [u8]; BYTES],
    /// Cost of a differing cell of each pixel, 1/256 of a cost.
    pub(super) cell_costs_q8: &'a [u16],
    /// Largest cost of each pixel's pattern, at most 127.
    pub(super) truncations: &'a [u8],
    /// The pixels' levels.
    pub(super) levels: &'a [u8],
    /// Patterns of the other view, byte by byte. The first position is that of the last pixel's lowest
    /// disparity, and that of each pixel before it is one more.
    pub(super) stored: [&'a [u8]; BYTES],
    /// Places of the other view's intervals of levels in [`LevelCosts`](super::levels::LevelCosts), from the
    /// same position on.
    pub(super) places: &'a [u16; POSITIONS],
    /// Bytes of costs per pixel.
    pub(super) stride: usize,
}
