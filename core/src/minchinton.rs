//! Minchinton cells: order comparisons of two samples, packed one bit each.
//!
//! Paper, Section III: synapse `r` forms a cell with synapse `r + 1`, the last
//! with the first; the cell is 1 when the sample of `r` is greater than that of
//! its partner, else 0. Comparisons of order survive any monotonic change of
//! exposure. The |W| bits are the neuron's input pattern.
//!
//! [`Pattern`] is one neuron's pattern in words, as the literal network stores
//! it. The line-streaming matcher keeps the patterns of a whole row as
//! [`PatternRow`], in byte planes.

use core::fmt;

use crate::kernel::Kernels;
use crate::memory::{Arena, OutOfMemory};
use crate::strip::Strip;
use crate::synapse::{Offset, Synapses};
use crate::view::View;

/// Cells per byte of a packed pattern.
pub const CELLS_PER_BYTE: usize = 8;

/// |W| must be a multiple of this.
pub const SYNAPSE_STEP: usize = 16;

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

/// Why a pattern could not be formed.
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

    /// Packs cells, the first into bit 0 of word 0. Cells beyond the capacity are left out.
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

    /// Looks at `view` through `synapses` centred on column `x`, line `y`; samples
    /// outside the view take the nearest pixel inside.
    ///
    /// # Errors
    /// [`PatternError::Length`] when |W| is no positive multiple of 16 or too large.
    pub fn observe(
        view: &View<'_>,
        synapses: &Synapses<'_>,
        x: usize,
        y: usize,
    ) -> Result<Self, PatternError> {
        let count = synapses.len();
        if count == 0 || !count.is_multiple_of(SYNAPSE_STEP) || count > Self::CAPACITY {
            return Err(PatternError::Length);
        }
        let sample = |o: Offset| view.sample(x, y, o.dx, o.dy);
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

/// The patterns of one row of neurons in byte planes.
///
/// Byte `b` of the pattern at position `i`, cells `8 b` (bit 0) to `8 b + 7`, stands
/// at `planes[b * stride + i]`. Neighbouring positions are neighbouring bytes, so a
/// vector register of any width holds one byte of as many patterns as it has lanes.
/// Each plane ends in [`PatternRow::SLACK`] bytes that may be read but mean nothing.
#[derive(Debug)]
pub struct PatternRow<'m> {
    planes: &'m mut [u8],
    stride: usize,
    count: usize,
}

impl<'m> PatternRow<'m> {
    /// Readable bytes after the last pattern of a plane: what a kernel may overshoot.
    pub const SLACK: usize = 16;

    /// Bytes for `width` patterns of `synapses` cells.
    #[must_use]
    pub const fn bytes(width: usize, synapses: usize) -> usize {
        (width + Self::SLACK) * (synapses / CELLS_PER_BYTE)
    }

    /// Patterns of `synapses` cells for `width` neurons.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has less than [`PatternRow::bytes`] left.
    pub fn new(width: usize, synapses: usize, arena: &mut Arena<'m>) -> Result<Self, OutOfMemory> {
        let bytes = arena.take(Self::bytes(width, synapses))?;
        Ok(Self::over(bytes, width, synapses))
    }

    /// The same in `bytes`, at least [`PatternRow::bytes`], whatever they hold.
    #[must_use]
    pub fn over(bytes: &'m mut [u8], width: usize, synapses: usize) -> Self {
        let used = Self::bytes(width, synapses).min(bytes.len());
        Self {
            planes: bytes.split_at_mut(used).0,
            stride: width + Self::SLACK,
            count: synapses / CELLS_PER_BYTE,
        }
    }

    /// Observes `count` neurons of the strips' line `line`, from stored position
    /// `first` of the strips on, and packs their patterns at positions 0 to `count - 1`.
    /// The first half of the synapses looks at the first strip, the others at the second.
    ///
    /// Positions count in the order in which the strips store their pixels.
    pub fn observe(
        &mut self,
        strips: [&Strip<'_>; 2],
        synapses: &Synapses<'_>,
        line: u32,
        first: usize,
        count: usize,
        kernels: &impl Kernels,
    ) {
        // Nine samples make eight cells; the ninth is the first of the next byte.
        let [near, far] = strips.map(|strip| strip.window(line));
        let half = synapses.len() / 2;
        let windows = (0..synapses.len()).map(|index| if index < half { near } else { far });
        let offsets = synapses.iter().zip(windows).cycle();
        let mut samples = offsets.map(|(offset, window)| window.samples(offset, first, count));
        let mut next = samples.next().unwrap_or_default();
        for plane in self.planes.chunks_exact_mut(self.stride.max(1)) {
            let mut group: [&[u8]; CELLS_PER_BYTE + 1] = [next; CELLS_PER_BYTE + 1];
            for slot in &mut group[1..] {
                *slot = samples.next().unwrap_or_default();
            }
            next = group[CELLS_PER_BYTE];
            if let Some(plane) = plane.get_mut(..count) {
                kernels.pack_cells(&group, plane);
            }
        }
    }

    /// Repeats the first pattern of `count` before it and the last behind it, so that they
    /// begin at position `front` of `positions` in all.
    pub fn extend(&mut self, count: usize, front: usize, positions: usize) {
        if count == 0 || front + count > positions || positions + Self::SLACK > self.stride {
            return;
        }
        let last = count - 1;
        for plane in self.planes.chunks_exact_mut(self.stride.max(1)) {
            let (Some(&first_byte), Some(&last_byte)) = (plane.first(), plane.get(last)) else {
                return;
            };
            // From the end, as both runs overlap; without negative disparities they are one.
            for x in (0..count).rev().take_while(|_| front > 0) {
                let byte = plane.get(x).copied();
                if let (Some(to), Some(byte)) = (plane.get_mut(front + x), byte) {
                    *to = byte;
                }
            }
            if let Some(before) = plane.get_mut(..front) {
                before.fill(first_byte);
            }
            if let Some(behind) = plane.get_mut(front + count..positions) {
                behind.fill(last_byte);
            }
        }
    }

    /// The planes, for a kernel.
    #[must_use]
    pub fn planes(&self) -> Planes<'_> {
        Planes {
            bytes: self.planes,
            stride: self.stride,
            count: self.count,
        }
    }
}

/// A borrowed [`PatternRow`].
#[derive(Debug, Clone, Copy)]
pub struct Planes<'a> {
    /// Byte planes, `stride` bytes each.
    pub bytes: &'a [u8],
    /// Bytes from a pattern's byte to its next: patterns plus slack.
    pub stride: usize,
    /// Planes: bytes per pattern.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_compare_each_sample_with_the_next_and_the_last_with_the_first() {
        // One line whose samples are 5 3 3 9: cells 5>3, 3>3, 3>9, 9>5, four times over.
        let pixels = [5, 3, 3, 9];
        let view = View::new(&pixels, 4, 1).unwrap();
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
        let view = View::new(&[0], 1, 1).unwrap();
        for count in [0, 8, 24, 80] {
            let stored = [[0; 2]; 80];
            let synapses = Synapses::from_stored(&stored[..count]);
            let refused = Pattern::<u64, 1>::observe(&view, &synapses, 0, 0);
            assert_eq!(refused, Err(PatternError::Length), "{count}");
        }
    }
}
