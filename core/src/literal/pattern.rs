//! The input pattern of one neuron, in machine words.
//!
//! Paper, Section III: synapse `r` forms a Minchinton cell with synapse `r + 1`, the last with
//! the first; the cell is 1 when the sample of `r` is greater than that of its partner, else 0.
//! Comparisons of order survive any monotonic change of exposure.

use core::fmt;

use super::image::GreyImage;
use crate::config::SYNAPSE_STEP;
use crate::pattern::Synapses;
use crate::rows::Offset;

/// A machine word that holds cells: `u32` or `u64`.
pub trait Word: Copy + Eq + Default + fmt::Debug + sealed::Sealed {
    /// Cells per word.
    const BITS: usize;
    /// The word with cell `index` set; `index < BITS`.
    #[must_use]
    fn with_bit(self, index: usize) -> Self;
    /// Whether cell `index` is set; `index < BITS`.
    #[must_use]
    fn bit(self, index: usize) -> bool;
    /// Cells in which two words differ.
    #[must_use]
    fn hamming(self, other: Self) -> u32;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for u32 {}
    impl Sealed for u64 {}
}

macro_rules! word {
    ($word:ty) => {
        impl Word for $word {
            const BITS: usize = <$word>::BITS as usize;
            #[inline]
            fn with_bit(self, index: usize) -> Self {
                self | (1 << index)
            }
            #[inline]
            fn bit(self, index: usize) -> bool {
                self >> index & 1 == 1
            }
            #[inline]
            fn hamming(self, other: Self) -> u32 {
                (self ^ other).count_ones()
            }
        }
    };
}
word!(u32);
word!(u64);

/// Reason for which a pattern could not be formed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PatternError {
    /// |W| is 0, no multiple of 16, or larger than the words of the pattern.
    Length,
}

impl fmt::Display for PatternError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the number of synapses must be a positive multiple of 16 that fits the words")
    }
}

impl core::error::Error for PatternError {}

/// The input pattern of one neuron: |W| cells in `WORDS` words, cell `r` in bit
/// `r % BITS` of word `r / BITS`; bits beyond |W| are 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pattern<W: Word, const WORDS: usize> {
    words: [W; WORDS],
}

impl<W: Word, const WORDS: usize> Default for Pattern<W, WORDS> {
    fn default() -> Self {
        Self {
            words: [W::default(); WORDS],
        }
    }
}

impl<W: Word, const WORDS: usize> Pattern<W, WORDS> {
    /// Largest |W| that fits.
    pub const CAPACITY: usize = WORDS * W::BITS;

    /// The pattern of these cells, the first in bit 0 of word 0. Cells beyond the capacity are
    /// left out.
    #[must_use]
    pub fn from_cells(cells: impl IntoIterator<Item = bool>) -> Self {
        let mut cells = cells.into_iter();
        Self {
            words: core::array::from_fn(|_| {
                (0..W::BITS)
                    .zip(&mut cells)
                    .filter(|&(_, cell)| cell)
                    .fold(W::default(), |word, (bit, _)| word.with_bit(bit))
            }),
        }
    }

    /// Returns the pattern that `synapses` centred on column `x`, line `y` sample in `image`. A
    /// sample outside the image takes the nearest pixel inside.
    ///
    /// # Errors
    /// [`PatternError::Length`] if |W| is not a positive multiple of 16 or is too large.
    pub fn observe(
        image: &GreyImage<'_>,
        synapses: &Synapses<'_>,
        x: usize,
        y: usize,
    ) -> Result<Self, PatternError> {
        let count = synapses.len();
        if count == 0 || !count.is_multiple_of(SYNAPSE_STEP) || count > Self::CAPACITY {
            return Err(PatternError::Length);
        }
        let sample = |o: Offset| image.sample(x, y, o.dx, o.dy);
        let partners = synapses.iter().cycle().skip(1);
        Ok(Self::from_cells(
            synapses
                .iter()
                .zip(partners)
                .map(|(own, partner)| sample(own) > sample(partner)),
        ))
    }

    /// Cell `index`; false beyond the capacity.
    #[must_use]
    pub fn cell(&self, index: usize) -> bool {
        self.words
            .get(index / W::BITS)
            .is_some_and(|word| word.bit(index % W::BITS))
    }

    /// Cells in which two patterns differ.
    #[inline]
    #[must_use]
    pub fn hamming(&self, other: &Self) -> u32 {
        self.words
            .iter()
            .zip(&other.words)
            .map(|(a, b)| a.hamming(*b))
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_compare_each_sample_with_the_next_and_the_last_with_the_first() {
        // One line whose samples are 5 3 3 9: cells 5>3, 3>3, 3>9, 9>5, four times over.
        let pixels = [5, 3, 3, 9];
        let view = GreyImage::new(&pixels, 4, 1).unwrap();
        let mut stored = [[0; 2]; 16];
        for (i, offset) in stored.iter_mut().enumerate() {
            *offset = [(i % 4) as i8, 0];
        }
        let synapses = Synapses::from_stored(&stored);
        let pattern = Pattern::<u32, 1>::observe(&view, &synapses, 0, 0).unwrap();
        let cells: [bool; 16] = core::array::from_fn(|i| pattern.cell(i));
        let four = [true, false, false, true];
        assert_eq!(cells, core::array::from_fn(|i| four[i % 4]));
        assert!((16..40).all(|i| !pattern.cell(i)));
    }

    #[test]
    fn both_word_sizes_hold_the_same_cells_and_distances() {
        let a = |i: usize| i * i % 7 < 3;
        let b = |i: usize| i % 3 == 1;
        let expected = (0..96).filter(|&i| a(i) != b(i)).count() as u32;
        let narrow = [
            Pattern::<u32, 3>::from_cells((0..96).map(a)),
            Pattern::from_cells((0..96).map(b)),
        ];
        let wide = [
            Pattern::<u64, 2>::from_cells((0..96).map(a)),
            Pattern::from_cells((0..96).map(b)),
        ];
        assert_eq!(narrow[0].hamming(&narrow[1]), expected);
        assert_eq!(wide[0].hamming(&wide[1]), expected);
        assert!((0..128).all(|i| wide[0].cell(i) == (i < 96 && a(i))));
    }

    #[test]
    fn lengths_that_do_not_fit_are_refused() {
        let view = GreyImage::new(&[0], 1, 1).unwrap();
        for count in [0, 8, 24, 80] {
            let stored = [[0; 2]; 80];
            let synapses = Synapses::from_stored(&stored[..count]);
            let refused = Pattern::<u64, 1>::observe(&view, &synapses, 0, 0);
            assert_eq!(refused, Err(PatternError::Length), "{count}");
        }
    }
}
