//! Sums of bytes, four side by side in two words: on a processor without vectors, two sums are added to at
//! a time.

/// Bytes that are added at a time, each to a sum of its own.
pub(crate) const LANES: usize = size_of::<u32>();

/// Four sums of at most 16 bits: in the first word those of the bytes 0 and 2, byte 0's in the lower half,
/// and in the second one those of the bytes 1 and 3.
pub(crate) type Lanes = [u32; 2];

/// The low byte of each half of a word.
const LOW_BYTES: u32 = 0x00ff_00ff;

/// The sums of four bytes alone.
#[inline(always)]
pub(crate) const fn lanes_of(bytes: u32) -> Lanes {
    [bytes & LOW_BYTES, bytes >> 8 & LOW_BYTES]
}

/// Adds to each sum, of which none may become larger than 16 bits.
#[inline(always)]
pub(crate) fn add(sums: &mut Lanes, added: Lanes) {
    sums[0] += added[0];
    sums[1] += added[1];
}

/// Subtracts from each sum what was added to it before.
#[inline(always)]
pub(crate) fn subtract(sums: &mut Lanes, subtracted: Lanes) {
    sums[0] -= subtracted[0];
    sums[1] -= subtracted[1];
}

/// The four sums in the order of their bytes.
#[inline(always)]
pub(crate) const fn in_order([even, odd]: Lanes) -> [u32; LANES] {
    [even & 0xffff, odd & 0xffff, even >> 16, odd >> 16]
}
