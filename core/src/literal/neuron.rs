//! VG-RAM neurons: a memory of (pattern, output) pairs recalled by Hamming distance.
//!
//! ```
//! // The paper's Table 1: three inputs, entries 110 -> 1, 001 -> 2, 010 -> 3.
//! use vgstereo_core::literal::{Neuron, Pattern};
//! use rand_core::SeedableRng;
//!
//! let pattern = |text: &str| Pattern::<u32, 1>::from_cells(text.bytes().map(|b| b == b'1'));
//! let mut neuron = Neuron::<_, _, 3>::new();
//! neuron.train(pattern("110"), 1)?;
//! neuron.train(pattern("001"), 2)?;
//! neuron.train(pattern("010"), 3)?;
//!
//! // Input 101 is nearest to entry 2: distances 2, 1 and 3.
//! let mut ties = rand_pcg::Pcg32::seed_from_u64(1);
//! let recall = neuron.recall(&pattern("101"), &mut ties).unwrap();
//! assert_eq!((recall.output, recall.distance, recall.ties), (2, 1, 1));
//!
//! // A fourth pair does not fit, and the memory stays as it was.
//! assert!(neuron.train(pattern("111"), 4).is_err());
//! assert_eq!(neuron.len(), 3);
//! # Ok::<(), vgstereo_core::literal::MemoryFull>(())
//! ```

use core::fmt;

use heapless::Vec;
use rand_core::Rng;

use super::pattern::{Pattern, Word};
use crate::kernel::pick;

/// The neuron's memory holds its capacity of pairs; nothing was stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryFull;

impl fmt::Display for MemoryFull {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the neuron's memory is full")
    }
}

impl core::error::Error for MemoryFull {}

/// Result of a recall.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Recall<O> {
    /// Output of the nearest stored pattern.
    pub output: O,
    /// Its Hamming distance to the input.
    pub distance: u32,
    /// Stored patterns at that distance, at least 1.
    pub ties: usize,
}

/// A VG-RAM neuron that stores up to `CAPACITY` pairs of a pattern and an output `O`.
#[derive(Debug, Clone)]
pub struct Neuron<P, O, const CAPACITY: usize> {
    memory: Vec<(P, O), CAPACITY>,
}

impl<P, O, const CAPACITY: usize> Default for Neuron<P, O, CAPACITY> {
    fn default() -> Self {
        Self { memory: Vec::new() }
    }
}

impl<P, O, const CAPACITY: usize> Neuron<P, O, CAPACITY> {
    /// An untrained neuron.
    #[must_use]
    pub const fn new() -> Self {
        Self { memory: Vec::new() }
    }

    /// Stores a pair.
    ///
    /// # Errors
    /// [`MemoryFull`] when `CAPACITY` pairs are stored; the memory is unchanged.
    pub fn train(&mut self, pattern: P, output: O) -> Result<(), MemoryFull> {
        self.memory.push((pattern, output)).map_err(|_| MemoryFull)
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.memory.clear();
    }

    /// Pairs stored.
    #[must_use]
    pub fn len(&self) -> usize {
        self.memory.len()
    }

    /// Whether nothing is stored.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.memory.is_empty()
    }
}

impl<W: Word, O: Copy, const WORDS: usize, const CAPACITY: usize>
    Neuron<Pattern<W, WORDS>, O, CAPACITY>
{
    /// Recalls the nearest pair, one of the nearest at random when several tie.
    ///
    /// The generator is used exactly once, tie or not, so that the state after a row
    /// of neurons does not depend on the image. `None` when nothing is stored.
    pub fn recall(&self, input: &Pattern<W, WORDS>, generator: &mut impl Rng) -> Option<Recall<O>> {
        let first = self.recall_first(input)?;
        let chosen = pick(generator.next_u32(), first.ties);
        self.memory
            .iter()
            .filter(|(pattern, _)| pattern.hamming(input) == first.distance)
            .nth(chosen)
            .map(|&(_, output)| Recall { output, ..first })
    }

    /// Recalls the nearest pair, the one stored first when several tie.
    /// `None` when nothing is stored.
    #[must_use]
    pub fn recall_first(&self, input: &Pattern<W, WORDS>) -> Option<Recall<O>> {
        let mut best: Option<Recall<O>> = None;
        for (pattern, output) in &self.memory {
            let distance = pattern.hamming(input);
            match &mut best {
                Some(best) if distance > best.distance => {}
                Some(best) if distance == best.distance => best.ties += 1,
                _ => {
                    best = Some(Recall {
                        output: *output,
                        distance,
                        ties: 1,
                    });
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::SeedableRng;
    use rand_pcg::Pcg32;

    type P = Pattern<u64, 1>;

    fn pattern(bits: u64) -> P {
        P::from_cells((0..64).map(|i| bits >> i & 1 == 1))
    }

    #[test]
    fn an_untrained_neuron_has_no_answer() {
        let neuron = Neuron::<P, u8, 4>::new();
        let mut ties = Pcg32::seed_from_u64(1);
        assert_eq!(neuron.recall(&pattern(1), &mut ties), None);
        assert_eq!(neuron.recall_first(&pattern(1)), None);
    }

    #[test]
    fn a_full_memory_refuses_and_keeps_its_answers() {
        let mut neuron = Neuron::<P, u8, 2>::new();
        neuron.train(pattern(0b1111), 1).unwrap();
        neuron.train(pattern(0b0000), 2).unwrap();
        let before = neuron.recall_first(&pattern(0b0001));
        assert_eq!(neuron.train(pattern(0b0001), 3), Err(MemoryFull));
        assert_eq!(neuron.recall_first(&pattern(0b0001)), before);
        neuron.clear();
        assert!(neuron.is_empty());
    }

    #[test]
    fn ties_are_broken_evenly_and_counted() {
        let mut neuron = Neuron::<P, usize, 4>::new();
        for (output, bits) in [0b0011, 0b1111_1111, 0b0101, 0b1001]
            .into_iter()
            .enumerate()
        {
            neuron.train(pattern(bits), output).unwrap();
        }
        let mut generator = Pcg32::seed_from_u64(3);
        let mut counts = [0; 4];
        for _ in 0..3000 {
            let recall = neuron.recall(&pattern(0b0001), &mut generator).unwrap();
            assert_eq!((recall.distance, recall.ties), (1, 3));
            counts[recall.output] += 1;
        }
        assert_eq!(counts[1], 0);
        // Binomial with p = 1/3: standard deviation 26.
        assert!(
            [0, 2, 3]
                .iter()
                .all(|&i| (counts[i] - 1000_i32).abs() < 130),
            "{counts:?}"
        );
        let first = neuron.recall_first(&pattern(0b0001)).unwrap();
        assert_eq!((first.output, first.ties), (0, 3));
    }
}
