//! Patterns: the comparisons of samples that each neuron of a row makes, as bits.
//!
//! [`Synapses`] are the offsets at which a neuron samples its view. The [`Sampler`] forms the
//! Minchinton cells of a row of neurons of both views from the [`View`](crate::rows::View)s, into a
//! [`PatternRow`] each.

mod planes;
mod sampler;
mod synapse;

pub use planes::PatternRow;
pub use sampler::Sampler;
pub use synapse::{OffsetLaw, StoredOffset, Synapses};
