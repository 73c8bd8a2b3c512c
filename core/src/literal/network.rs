//! The paper's network as published: one neuron per pixel, each with its own memory.
//!
//! It follows Section III literally, for bounded sizes, and is the oracle that the line-streaming
//! matcher equals. Training shifts the array of neurons over one view, one column per disparity;
//! testing shows it the other view. The tested view is the reference, which gets a disparity for
//! each pixel.

use core::fmt;

use rand_core::Rng;

use super::image::GreyImage;
use super::neuron::{MemoryFull, Neuron, Recall};
use super::pattern::{Pattern, PatternError, Word};
use crate::disparity::{DisparityRange, INVALID, Reference};
use crate::pattern::Synapses;

/// A neuron whose pattern has `WORDS` words and whose memory holds `CAPACITY` disparities.
pub type DisparityNeuron<W, const WORDS: usize, const CAPACITY: usize> =
    Neuron<Pattern<W, WORDS>, i16, CAPACITY>;

/// Assignment of offsets to neurons.
#[derive(Debug, Clone, Copy)]
pub enum Wiring<'a> {
    /// All neurons have the same offsets. Only this form can stream lines.
    Shared(Synapses<'a>),
    /// Each neuron has offsets of its own: `synapses` of them per neuron, neurons row-major.
    PerNeuron {
        /// |W| offsets for the first neuron, then for the second, and so on.
        offsets: Synapses<'a>,
        /// |W|.
        synapses: usize,
    },
}

/// Choice among several nearest patterns at one distance.
#[derive(Debug)]
pub enum Ties<'a, G> {
    /// The one stored first, which is the lowest disparity.
    Lowest,
    /// One at random, with this generator, drawn once per neuron that has a memory.
    Random(&'a mut G),
}

/// Reason for which the network cannot be built, trained or tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NetworkError {
    /// The number of neurons, offsets or outputs does not fit the size of the view.
    Size,
    /// Patterns cannot be formed of this many synapses.
    Pattern(PatternError),
    /// A neuron's capacity is smaller than the number of disparities.
    MemoryFull,
}

impl fmt::Display for NetworkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size => {
                f.write_str("neurons, offsets or outputs do not fit the size of the view")
            }
            Self::Pattern(error) => error.fmt(f),
            Self::MemoryFull => MemoryFull.fmt(f),
        }
    }
}

impl core::error::Error for NetworkError {}

impl From<PatternError> for NetworkError {
    fn from(error: PatternError) -> Self {
        Self::Pattern(error)
    }
}

impl From<MemoryFull> for NetworkError {
    fn from(_: MemoryFull) -> Self {
        Self::MemoryFull
    }
}

/// A network of `width x height` neurons in lent storage, row-major.
#[derive(Debug)]
pub struct Network<'a, W: Word, const WORDS: usize, const CAPACITY: usize> {
    neurons: &'a mut [DisparityNeuron<W, WORDS, CAPACITY>],
    width: usize,
    wiring: Wiring<'a>,
}

impl<'a, W: Word, const WORDS: usize, const CAPACITY: usize> Network<'a, W, WORDS, CAPACITY> {
    /// Wires lent neurons for views `width` px wide.
    ///
    /// # Errors
    /// [`NetworkError::Size`] when there is no neuron, the neurons do not fill their
    /// last line, or a per-neuron wiring does not have offsets for each.
    pub fn new(
        neurons: &'a mut [DisparityNeuron<W, WORDS, CAPACITY>],
        width: usize,
        wiring: Wiring<'a>,
    ) -> Result<Self, NetworkError> {
        let enough = match &wiring {
            Wiring::Shared(_) => true,
            Wiring::PerNeuron { offsets, synapses } => {
                Some(offsets.len()) == synapses.checked_mul(neurons.len())
            }
        };
        if width == 0 || neurons.is_empty() || !neurons.len().is_multiple_of(width) || !enough {
            return Err(NetworkError::Size);
        }
        Ok(Self {
            neurons,
            width,
            wiring,
        })
    }

    /// Trains anew on the view that is not the reference: for each disparity, lowest first, every
    /// neuron whose shifted centre is inside the view stores the pattern that it samples there.
    ///
    /// # Errors
    /// [`NetworkError::Size`] or [`NetworkError::Pattern`], with the memories cleared;
    /// [`NetworkError::MemoryFull`], with the memories filled up to that point.
    pub fn train(
        &mut self,
        other: &GreyImage<'_>,
        disparities: DisparityRange,
        reference: Reference,
    ) -> Result<(), NetworkError> {
        for neuron in self.neurons.iter_mut() {
            neuron.clear();
        }
        self.check(other)?;
        for disparity_px in disparities.range_px() {
            // A neuron at `x` looks for its match at `x - d` (left) or `x + d` (right).
            let shift = match reference {
                Reference::Left => -disparity_px as isize,
                Reference::Right => disparity_px as isize,
            };
            for index in 0..self.neurons.len() {
                let (x, y) = (index % self.width, index / self.width);
                let Some(centre) = x.checked_add_signed(shift).filter(|&c| c < self.width) else {
                    continue;
                };
                let pattern = Pattern::observe(other, &self.synapses(index), centre, y)?;
                let output = i16::try_from(disparity_px).map_err(|_| NetworkError::Size)?;
                if let Some(neuron) = self.neurons.get_mut(index) {
                    neuron.train(pattern, output)?;
                }
            }
        }
        Ok(())
    }

    /// Tests on the reference view: writes a disparity in px for each neuron, row-major,
    /// [`INVALID`] for one that has nothing stored.
    ///
    /// # Errors
    /// [`NetworkError`] when the view or `disparities_px` has another size than the network.
    pub fn test<G: Rng>(
        &self,
        reference: &GreyImage<'_>,
        mut ties: Ties<'_, G>,
        disparities_px: &mut [i16],
    ) -> Result<(), NetworkError> {
        self.check(reference)?;
        if disparities_px.len() != self.neurons.len() {
            return Err(NetworkError::Size);
        }
        for (index, (neuron, output)) in self.neurons.iter().zip(disparities_px).enumerate() {
            let (x, y) = (index % self.width, index / self.width);
            let input = Pattern::observe(reference, &self.synapses(index), x, y)?;
            let recall: Option<Recall<i16>> = match &mut ties {
                Ties::Lowest => neuron.recall_first(&input),
                Ties::Random(generator) => neuron.recall(&input, *generator),
            };
            *output = recall.map_or(INVALID, |recall| recall.output);
        }
        Ok(())
    }

    fn check(&self, view: &GreyImage<'_>) -> Result<(), NetworkError> {
        if view.width() == self.width && view.height() == self.neurons.len() / self.width {
            Ok(())
        } else {
            Err(NetworkError::Size)
        }
    }

    fn synapses(&self, index: usize) -> Synapses<'a> {
        match &self.wiring {
            Wiring::Shared(synapses) => *synapses,
            Wiring::PerNeuron { offsets, synapses } => offsets.group(index, *synapses),
        }
    }
}
