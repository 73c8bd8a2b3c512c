//! Truncation by evidence: the pattern of a pixel costs the less at most, the fewer of its cells are 1.
//!
//! A cell is 1 where its sample is greater than its partner's. Where there is texture, about half of
//! a pixel's cells are 1; where all samples are alike, on what is clipped or plain, none is. There, the
//! other patterns that differ tell nothing of the pixel, and levels and paths are to decide.

use crate::config::SgmParameters;
use crate::kernel::Planes;

/// Largest number of pixels of a run.
pub(super) const MAX_LANES: usize = 128;

/// Pixels per word.
const LANES: usize = size_of::<u32>();

/// Pairs of planes whose ones a byte counts: 16 each.
const MAX_PAIRS: usize = 15;

/// How much the pattern of a pixel may cost at most, by the number of its cells that are 1.
pub(super) struct Evidence {
    truncation: u8,
    /// Largest cost of the pattern per cost of its ones, 1/256.
    weight_q8: u32,
}

impl Evidence {
    /// `None` where all patterns have the same truncation.
    pub(super) fn new(parameters: &SgmParameters) -> Option<Self> {
        let truncation = parameters.hamming_truncation;
        // All cells together cost `hamming_scale`.
        let enough = u32::from(parameters.hamming_scale) * u32::from(parameters.evidence_q8);
        (enough > 0).then(|| Self {
            truncation,
            // With 16 bits, the smallest cost leads to every truncation.
            weight_q8: (u32::from(truncation) << 16)
                .div_ceil(enough)
                .min(u16::MAX.into()),
        })
    }

    /// Writes the largest cost of the pattern of each pixel of a run of at most [`MAX_LANES`]. The
    /// patterns start at `first` of `inputs`, the masks at 0; without masks, every cell counts. A
    /// differing cell of a pixel costs `cell_costs_q8`.
    pub(super) fn truncate(
        &self,
        (inputs, first): (Planes<'_>, usize),
        masks: Planes<'_>,
        cell_costs_q8: &[u16],
        truncations: &mut [u8],
    ) {
        let mut ones = [0; MAX_LANES];
        let lanes = cell_costs_q8.len().min(MAX_LANES);
        count_ones(
            (inputs, first),
            masks,
            ones.get_mut(..lanes).unwrap_or_default(),
        );
        let pixels = ones.iter().zip(cell_costs_q8);
        for (truncation, (&ones, &cell_cost_q8)) in truncations.iter_mut().zip(pixels) {
            // The cost of all cells of a pixel fits 16 bits.
            let cost_q8 = u32::from(ones) * u32::from(cell_cost_q8);
            let largest = (cost_q8 * self.weight_q8) >> 16;
            *truncation = largest.min(self.truncation.into()) as u8;
        }
    }
}

/// Counts the cells that are 1 of each pixel of a run, of those in its mask.
fn count_ones((inputs, first): (Planes<'_>, usize), masks: Planes<'_>, ones: &mut [u16]) {
    let lanes = ones.len();
    let (words, rest) = ones.as_chunks_mut::<LANES>();
    for start in (0..inputs.count).step_by(2 * MAX_PAIRS) {
        let mut counts = [0; MAX_LANES / LANES];
        let end = inputs.count.min(start + 2 * MAX_PAIRS);
        for byte in (start..end).step_by(2) {
            let plane = |byte| run_of(inputs, byte, first, lanes);
            let mask = |byte| match masks.count {
                0 => ALL.get(..lanes).unwrap_or_default(),
                _ => run_of(masks, byte, 0, lanes),
            };
            // The number of synapses is a multiple of 16.
            let runs = [plane(byte), mask(byte), plane(byte + 1), mask(byte + 1)];
            let [a, a_mask, b, b_mask] = runs.map(|run| run.as_chunks::<LANES>());
            let pixels = a.0.iter().zip(a_mask.0).zip(b.0.iter().zip(b_mask.0));
            for (count, ((a, a_mask), (b, b_mask))) in counts.iter_mut().zip(pixels) {
                *count += ones_of_bytes(word(a) & word(a_mask), word(b) & word(b_mask));
            }
            let pixels = a.1.iter().zip(a_mask.1).zip(b.1.iter().zip(b_mask.1));
            for (count, ((a, a_mask), (b, b_mask))) in rest.iter_mut().zip(pixels) {
                *count += ((a & a_mask).count_ones() + (b & b_mask).count_ones()) as u16;
            }
        }
        for (ones, count) in words.iter_mut().zip(counts) {
            for (ones, count) in ones.iter_mut().zip(count.to_le_bytes()) {
                *ones += u16::from(count);
            }
        }
    }
}

/// A mask of all cells.
const ALL: [u8; MAX_LANES] = [u8::MAX; MAX_LANES];

/// Some pixels of plane `byte`; none if there is no such plane.
fn run_of(planes: Planes<'_>, byte: usize, first: usize, lanes: usize) -> &[u8] {
    let start = byte * planes.stride + first;
    let run = planes.bytes.get(start..start + lanes);
    run.filter(|_| byte < planes.count).unwrap_or_default()
}

fn word(bytes: &[u8; LANES]) -> u32 {
    u32::from_le_bytes(*bytes)
}

/// Counts the ones of each byte of two words together.
#[inline(always)]
fn ones_of_bytes(a: u32, b: u32) -> u32 {
    let pairs = |word: u32| word - (word >> 1 & 0x5555_5555);
    let quads = |word: u32| (word & 0x3333_3333) + (word >> 2 & 0x3333_3333);
    // At most 8, which fits four bits.
    let both = quads(pairs(a)) + quads(pairs(b));
    (both & 0x0f0f_0f0f) + (both >> 4 & 0x0f0f_0f0f)
}

#[cfg(test)]
mod tests {
    use std::vec;
    use std::vec::Vec;

    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;

    #[test]
    fn ones_are_counted_pixel_by_pixel() {
        let seed = 11;
        let mut random = Pcg32::seed_from_u64(seed);
        for lanes in [1, 3, 4, 62, 64, 127, 128] {
            for count in [2, 4, 6, 30, 32, 128] {
                let (first, stride) = (random.next_u32() as usize % 9, 150);
                // Bytes of all ones often come up, which make the largest counts.
                let mut bytes = |size: usize| -> Vec<u8> {
                    let mut byte = || (random.next_u32() % 300).min(255) as u8;
                    (0..size).map(|_| byte()).collect()
                };
                let (own, mask) = (bytes(stride * count), bytes(lanes * count));
                let inputs = Planes {
                    bytes: &own,
                    stride,
                    count,
                };
                let masks = Planes {
                    bytes: &mask,
                    stride: lanes,
                    count,
                };
                for masks in [Planes::NONE, masks] {
                    let mut ones = vec![0; lanes];
                    count_ones((inputs, first), masks, &mut ones);
                    for (x, &ones) in ones.iter().enumerate() {
                        let expected: u32 = (0..count)
                            .map(|byte| {
                                let own = own[byte * stride + first + x];
                                let mask = match masks.count {
                                    0 => 255,
                                    _ => mask[byte * lanes + x],
                                };
                                (own & mask).count_ones()
                            })
                            .sum();
                        assert_eq!(u32::from(ones), expected, "seed {seed}, {lanes}, {count}");
                    }
                }
            }
        }
    }
}
