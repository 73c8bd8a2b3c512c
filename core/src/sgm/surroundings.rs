//! The surroundings of a row on its way through the refinement.

use crate::rows::{Ring, Strip};

/// Data that the stages of the refinement use besides the row.
pub(super) struct Surroundings<'a, 'm, 'c> {
    /// Channels of the reference view, with all lines that a stage reads.
    pub(super) channels: &'a [Strip<'m>],
    /// Line of the channels that row 0 of every stage belongs to.
    pub(super) first_line: u32,
    /// Confidences of the rows that are in the stages.
    pub(super) confidences: &'a mut Ring<'c, u8>,
}
