//! Truncation by evidence: the pattern of a pixel costs the less at most, the fewer of its cells are 1.
//!
//! A cell is 1 where its sample is greater than its partner's. Where there is texture, about half of
//! a pixel's cells are 1; where all samples are alike, on what is clipped or plain, none is. There, the
//! other patterns that differ tell nothing of the pixel, and levels and paths are to decide.

use crate::config::SgmParameters;
use crate::kernel::Planes;
use crate::kernel::lanes::{LANES, Lanes, add, in_order, lanes_of};

/// Largest number of pixels of a run.
pub(super) const MAX_LANES: usize = 128;

/// The highest bit of each half of a word. No number of ones has it.
const HIGHEST: u32 = 0x8000_8000;

/// How much the pattern of a pixel may cost at most, by the number of its cells that are 1.
pub(super) struct Evidence {
    truncation: u8,
    /// Largest cost of the pattern per cost of its ones, 1/256.
    weight_q8: u32,
    /// Ones of the pixels of a run, counted so far; 0 between runs.
    ones: [Lanes; MAX_LANES / LANES],
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
            ones: [Lanes::default(); MAX_LANES / LANES],
        })
    }

    /// Writes the largest cost of the pattern of each pixel of a run of at most [`MAX_LANES`]. The
    /// patterns start at `first` of `inputs`, the masks at 0; without masks, every cell counts. A
    /// differing cell of a pixel costs `cell_costs_q8`, which is the same of all pixels if there are
    /// no masks.
    pub(super) fn truncate(
        &mut self,
        (inputs, first): (Planes<'_>, usize),
        masks: Planes<'_>,
        cell_costs_q8: &[u16],
        truncations: &mut [u8],
    ) {
        let (weight_q8, truncation) = (self.weight_q8, u32::from(self.truncation));
        // The cost of all cells of a pixel fits 16 bits, and so does the weight.
        let weight_q24 = |cell_cost_q8: u16| u32::from(cell_cost_q8) * weight_q8;
        let largest =
            |ones: u32, weight_q24: u32| ((ones * weight_q24) >> 16).min(truncation) as u8;
        let lanes = cell_costs_q8.len().min(MAX_LANES);
        let (costs, other_costs) = cell_costs_q8.as_chunks::<LANES>();
        let (words, others) = truncations.as_chunks_mut::<LANES>();
        if let (0, Some(&cost)) = (masks.count, cell_costs_q8.first()) {
            let weight_q24 = weight_q24(cost);
            // From so many ones on, all patterns have the same truncation.
            let enough = (truncation << 16).div_ceil(weight_q24.max(1)).min(1 << 15);
            let none_left = HIGHEST - enough * 0x1_0001;
            let truncate = |[even, odd]: Lanes| {
                if (even + none_left) & (odd + none_left) & HIGHEST == HIGHEST {
                    [self.truncation; LANES]
                } else {
                    in_order([even, odd]).map(|ones| largest(ones, weight_q24))
                }
            };
            let words = words.iter_mut().zip(costs);
            // Of `lite`: in one pass, and with all four pixels of a word in one sum.
            if inputs.count == 4 {
                let plane = |byte| words_of(inputs, byte, first, lanes);
                let counts = plane(0).zip(plane(1)).zip(plane(2).zip(plane(3)));
                let none_left = (0x80 - enough.min(0x80)) * 0x0101_0101;
                for ((truncations, _), ((a, b), (c, d))) in words.zip(counts) {
                    let ones = ones_of_three(a, b, c) + ones_of_word(d);
                    // At most 32 ones are added to at most 128.
                    *truncations = if !(ones + none_left) & 0x8080_8080 == 0 {
                        [self.truncation; LANES]
                    } else {
                        in_order(lanes_of(ones)).map(|ones| largest(ones, weight_q24))
                    };
                }
            } else {
                add_ones((inputs, first), masks, lanes, &mut self.ones);
                for ((truncations, _), ones) in words.zip(&mut self.ones) {
                    *truncations = truncate(core::mem::take(ones));
                }
            }
        } else {
            add_ones((inputs, first), masks, lanes, &mut self.ones);
            let pixels = words.iter_mut().zip(&mut self.ones).zip(costs);
            for ((truncations, ones), &[a_cost, b_cost, c_cost, d_cost]) in pixels {
                let [a, b, c, d] = in_order(core::mem::take(ones));
                let pairs = [(a, a_cost), (b, b_cost), (c, c_cost), (d, d_cost)];
                *truncations = pairs.map(|(ones, cost)| largest(ones, weight_q24(cost)));
            }
        }
        // The last word of a run may lie within a row of truncations.
        let others = match words.get_mut(costs.len()) {
            Some(word) => word.as_mut_slice(),
            None => others,
        };
        for ((truncation, &cost), x) in others
            .iter_mut()
            .zip(other_costs)
            .zip(costs.len() * LANES..)
        {
            let ones = ones_of_pixel((inputs, first), masks, x);
            *truncation = largest(ones, weight_q24(cost));
        }
    }
}

/// Adds the number of cells that are 1 of each pixel of a run, of those in its mask, for all whole
/// words of pixels.
fn add_ones(
    (inputs, first): (Planes<'_>, usize),
    masks: Planes<'_>,
    lanes: usize,
    ones: &mut [Lanes],
) {
    let plane = |byte| words_of(inputs, byte, first, lanes);
    // The number of synapses is a multiple of 16.
    if masks.count == 0 {
        let pair = |byte| {
            let words = plane(byte).zip(plane(byte + 1));
            words.map(|(a, b)| ones_of_bytes(a, b))
        };
        for byte in (0..inputs.count).step_by(4) {
            if byte + 2 < inputs.count {
                let fours = pair(byte).zip(pair(byte + 2));
                add_bytes(fours.map(|(a, b)| a + b), ones);
            } else {
                add_bytes(pair(byte), ones);
            }
        }
    } else {
        let masked = |byte| {
            let words = plane(byte).zip(words_of(masks, byte, 0, lanes));
            words.map(|(word, mask)| word & mask)
        };
        for byte in (0..inputs.count).step_by(2) {
            let words = masked(byte).zip(masked(byte + 1));
            add_bytes(words.map(|(a, b)| ones_of_bytes(a, b)), ones);
        }
    }
}

/// Adds the numbers of four bytes to those of four pixels, word by word.
#[inline(always)]
fn add_bytes(words: impl Iterator<Item = u32>, ones: &mut [Lanes]) {
    for (ones, counts) in ones.iter_mut().zip(words) {
        add(ones, lanes_of(counts));
    }
}

/// The number of cells that are 1 of pixel `x` of a run, of those in its mask.
fn ones_of_pixel((inputs, first): (Planes<'_>, usize), masks: Planes<'_>, x: usize) -> u32 {
    let at = |planes: Planes<'_>, byte, x| planes.bytes.get(byte * planes.stride + x).copied();
    let cells = (0..inputs.count).map(|byte| {
        let mask = at(masks, byte, x).filter(|_| masks.count > 0);
        at(inputs, byte, first + x).unwrap_or(0) & mask.unwrap_or(u8::MAX)
    });
    cells.map(u8::count_ones).sum()
}

/// The whole words of some pixels of plane `byte`; none if there is no such plane.
#[inline(always)]
fn words_of(
    planes: Planes<'_>,
    byte: usize,
    first: usize,
    lanes: usize,
) -> impl Iterator<Item = u32> {
    let start = byte * planes.stride + first;
    let run = planes.bytes.get(start..start + lanes);
    let run = run.filter(|_| byte < planes.count).unwrap_or_default();
    let words = run.as_chunks::<LANES>().0.iter();
    words.map(|&bytes| u32::from_le_bytes(bytes))
}

/// The ones of each pair of bits.
#[inline(always)]
const fn pairs(word: u32) -> u32 {
    word - (word >> 1 & 0x5555_5555)
}

/// The sums of neighbouring pairs of bits.
#[inline(always)]
const fn quads(pairs: u32) -> u32 {
    (pairs & 0x3333_3333) + (pairs >> 2 & 0x3333_3333)
}

/// The sums of neighbouring halves of bytes.
#[inline(always)]
const fn bytes(quads: u32) -> u32 {
    (quads & 0x0f0f_0f0f) + (quads >> 4 & 0x0f0f_0f0f)
}

/// Counts the ones of each byte of two words together.
#[inline(always)]
const fn ones_of_bytes(a: u32, b: u32) -> u32 {
    // At most 8, which fits four bits.
    bytes(quads(pairs(a)) + quads(pairs(b)))
}

/// Counts the ones of each byte of three words together.
#[inline(always)]
const fn ones_of_three(a: u32, b: u32, c: u32) -> u32 {
    // At most three to a pair of bits, and 12 to four.
    let a = pairs(a) + (c & 0x5555_5555);
    let b = pairs(b) + (c >> 1 & 0x5555_5555);
    bytes(quads(a) + quads(b))
}

/// Counts the ones of each byte of a word.
#[inline(always)]
const fn ones_of_word(word: u32) -> u32 {
    let quads = quads(pairs(word));
    // At most 8 to a byte.
    (quads + (quads >> 4)) & 0x0f0f_0f0f
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;

    #[test]
    fn truncations_follow_from_the_ones_of_each_pixel() {
        let seed = 12;
        let mut random = Pcg32::seed_from_u64(seed);
        let mut below = |bound: u32| random.next_u32() % bound;
        for round in 0..400 {
            let (lanes, count) = (1 + below(128) as usize, [2, 4, 6, 8, 64][round % 5]);
            let (first, stride) = (below(9) as usize, 150);
            // Sparse, dense and even patterns, so that many pixels have about enough ones.
            let sparse = below(256) as u8;
            let mut bytes =
                |size: usize| -> Vec<u8> { (0..size).map(|_| below(256) as u8 & sparse).collect() };
            let (own, mask) = (bytes(stride * count), bytes(lanes * count));
            let planes = |bytes, stride| Planes {
                bytes,
                stride,
                count,
            };
            let inputs = planes(&own, stride);
            let mut evidence = Evidence {
                truncation: [0, 1, 32, below(256) as u8, 255][below(5) as usize],
                weight_q8: [0, 1, 264, below(65_536), 65_535][below(5) as usize],
                ones: [Lanes::default(); MAX_LANES / LANES],
            };
            // Of all cells together the costs fit 16 bits.
            let mut cost = || below(1 + 65_535 / (8 * count as u32)) as u16;
            let (uniform, costs) = ([cost(); MAX_LANES], [(); MAX_LANES].map(|()| cost()));
            for (masks, costs) in [(Planes::NONE, uniform), (planes(&mask, lanes), costs)] {
                let mut found = [7; MAX_LANES];
                evidence.truncate((inputs, first), masks, &costs[..lanes], &mut found);
                for (x, (&found, cost)) in found.iter().zip(costs).enumerate().take(lanes) {
                    let ones = u64::from(ones_of_pixel((inputs, first), masks, x));
                    let largest = (ones * u64::from(cost) * u64::from(evidence.weight_q8)) >> 16;
                    let expected = largest.min(evidence.truncation.into());
                    assert_eq!(
                        u64::from(found),
                        expected,
                        "seed {seed}, round {round}, {x}"
                    );
                }
            }
        }
    }

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
                    let mut ones = [Lanes::default(); MAX_LANES / LANES];
                    add_ones((inputs, first), masks, lanes, &mut ones);
                    let words = ones.iter().take(lanes / LANES);
                    let ones = words.flat_map(|&ones| in_order(ones));
                    let others = (lanes / LANES * LANES..lanes)
                        .map(|x| ones_of_pixel((inputs, first), masks, x));
                    for (x, ones) in ones.chain(others).enumerate() {
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
                        assert_eq!(ones, expected, "seed {seed}, {lanes}, {count}");
                    }
                }
            }
        }
    }
}
