//! The paper's method: every neuron recalls the disparity of the nearest pattern.
//!
//! ```text
//! two views -> patterns of a row (pattern) -> nearest patterns of each neuron   RecallMatcher
//!           -> vote among neighbours -> median -> line of disparities           RecallRefiner
//! ```
//!
//! All neurons share their offsets, so the memory of neuron `x` is a run of the other view's row of
//! patterns: those of the columns that its disparities lead to. Rising disparities are stored at
//! rising positions; for that, the other view is mirrored if the reference is the left one. So one
//! [`PatternRow`](crate::pattern::PatternRow) is the memory of a whole row of neurons.

mod matcher;
mod median;
mod refine;
mod vote;

pub use matcher::RecallMatcher;
pub use refine::RecallRefiner;
