//! The paper's network as published: one neuron per pixel, each with its own memory.
//!
//! It is not part of the pipeline. It is of bounded size, and serves as the oracle that the
//! streaming [`Matcher`](crate::Matcher) equals bit for bit.

mod image;
mod network;
mod neuron;
mod pattern;

pub use image::{GreyImage, GreyImageSizeError};
pub use network::{DisparityNeuron, Network, NetworkError, Ties, Wiring};
pub use neuron::{MemoryFull, Neuron, Recall};
pub use pattern::{Pattern, PatternError, Word};
