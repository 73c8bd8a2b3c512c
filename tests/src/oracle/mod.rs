//! Oracles: slow and simple implementations of both methods on whole images.

pub mod recall;
pub mod sgm;
