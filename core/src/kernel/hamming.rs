//! Hamming distances of one pattern to a run of stored patterns.

/// Distances are written in blocks of this many; see [`distances`]. Every plane has as many
/// readable bytes after its last pattern.
pub const LANES: usize = 16;

/// Patterns of a row of neurons in byte planes.
///
/// Byte `b` of the pattern at position `i`, cells `8 b` (bit 0) to `8 b + 7`, stands at
/// `bytes[b * stride + i]`.
#[derive(Debug, Clone, Copy)]
pub struct Planes<'a> {
    /// Byte planes, `stride` bytes each.
    pub bytes: &'a [u8],
    /// Bytes from one plane to the next: the number of patterns, and slack.
    pub stride: usize,
    /// Number of planes: bytes per pattern.
    pub count: usize,
}

impl Planes<'_> {
    /// No pattern.
    pub const NONE: Self = Self {
        bytes: &[],
        stride: 0,
        count: 0,
    };
}

/// Planes summed in 8 bits before the sum is widened: 16 planes differ in at most 128 cells.
const PLANES_PER_SUM: usize = 16;

/// A distance no pattern has: it loses against every real one.
pub const NO_DISTANCE: i16 = i16::MAX;

/// Writes the distances of the pattern at position `x` of `inputs` to the patterns at
/// positions `first`, `first + 1`, and so on, of `stored`: one for each of the first
/// `count` elements of `distances`, and [`NO_DISTANCE`] in the elements after them.
///
/// `distances` has a multiple of [`LANES`] elements, less than [`LANES`] more than
/// `count`. Rows that do not reach that far leave distances of 0.
#[inline(always)]
pub fn distances(
    inputs: Planes<'_>,
    x: usize,
    stored: Planes<'_>,
    first: usize,
    count: usize,
    distances: &mut [i16],
) {
    // The wider blocks keep more independent sums in registers.
    let mut at = first;
    let (blocks, rest) = distances.as_chunks_mut::<{ 4 * LANES }>();
    for block in blocks {
        *block = distances_block(inputs, x, stored, at);
        at += block.len();
    }
    let (blocks, rest) = rest.as_chunks_mut::<{ 2 * LANES }>();
    for block in blocks {
        *block = distances_block(inputs, x, stored, at);
        at += block.len();
    }
    for block in rest.as_chunks_mut::<LANES>().0 {
        *block = distances_block(inputs, x, stored, at);
        at += block.len();
    }
    if let Some(beyond) = distances.get_mut(count..) {
        beyond.fill(NO_DISTANCE);
    }
}

#[inline(always)]
fn distances_block<const N: usize>(
    inputs: Planes<'_>,
    x: usize,
    stored: Planes<'_>,
    first: usize,
) -> [i16; N] {
    let cells: [u16; N] = differing_cells(inputs, x, Planes::NONE, 0, stored, first);
    let mut distances = [0_i16; N];
    for (distance, cells) in distances.iter_mut().zip(cells) {
        // At most as many cells as a pattern has.
        *distance = cells as i16;
    }
    distances
}

/// Counts the cells in which the pattern at position `x` of `inputs` differs from each of the `N`
/// patterns of `stored` from position `first` on. With masks, only the cells in the mask at
/// position `mask_x` of `masks` are counted.
#[inline(always)]
pub(super) fn differing_cells<const N: usize>(
    inputs: Planes<'_>,
    x: usize,
    masks: Planes<'_>,
    mask_x: usize,
    stored: Planes<'_>,
    first: usize,
) -> [u16; N] {
    let mut totals = [0_u16; N];
    let (mut input_at, mut mask_at, mut stored_at) = (x, mask_x, first);
    let mut left = inputs.count;
    while left > 0 {
        let group = left.min(PLANES_PER_SUM);
        left -= group;
        let mut sums = [0_u8; N];
        for _ in 0..group {
            if let Some(&byte) = inputs.bytes.get(input_at)
                && let Some(run) = stored.bytes.get(stored_at..)
                && let Some(run) = run.first_chunk::<N>()
            {
                let mask = masks.bytes.get(mask_at).copied().unwrap_or(u8::MAX);
                for (sum, &other) in sums.iter_mut().zip(run) {
                    // At most 8, so that the sum stays within PLANES_PER_SUM * 8 = 128.
                    *sum += ((byte ^ other) & mask).count_ones() as u8;
                }
            }
            input_at += inputs.stride;
            mask_at += masks.stride;
            stored_at += stored.stride;
        }
        for (total, &sum) in totals.iter_mut().zip(&sums) {
            *total += u16::from(sum);
        }
    }
    totals
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec::Vec;

    /// Compared with counting bits one pattern at a time, up to the longest pattern with every cell
    /// different, and for counts that do not fill a block.
    #[test]
    fn distances_are_counts_of_differing_cells() {
        const WIDTH: usize = 130;
        const STRIDE: usize = WIDTH + LANES;
        for (seed, planes) in [(1, 2), (2, 15), (3, 16), (4, 17), (5, 128)] {
            let mut random = Pcg32::seed_from_u64(seed);
            let mut row = || -> Vec<u8> {
                let bytes = 0..planes * STRIDE;
                bytes.map(|_| random.next_u32() as u8).collect()
            };
            let (inputs, mut stored) = (row(), row());
            for (input, stored) in inputs
                .chunks_exact(STRIDE)
                .zip(stored.chunks_exact_mut(STRIDE))
            {
                stored[7] = !input[0];
            }
            let of = |bytes, x: usize| -> Vec<u8> {
                let planes = <[u8]>::chunks_exact(bytes, STRIDE);
                planes.map(|plane| plane[x]).collect()
            };
            let borrowed = |bytes| Planes {
                bytes,
                stride: STRIDE,
                count: planes,
            };
            for (x, first, count) in [(0, 7, 1), (3, 0, 16), (129, 5, 60), (64, 0, 130)] {
                let mut found = std::vec![-1; usize::next_multiple_of(count, LANES)];
                distances(
                    borrowed(&inputs),
                    x,
                    borrowed(&stored),
                    first,
                    count,
                    &mut found,
                );
                let input = of(&inputs, x);
                for (i, &distance) in found.iter().enumerate() {
                    let expected = if i < count {
                        let other = of(&stored, first + i);
                        let cells = input.iter().zip(&other);
                        cells.map(|(a, b)| (a ^ b).count_ones() as i16).sum()
                    } else {
                        NO_DISTANCE
                    };
                    assert_eq!(distance, expected, "{planes} planes, {x}, {first}, {i}");
                }
            }
        }
    }
}
