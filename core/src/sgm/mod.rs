//! The SGM branch: distances of patterns as matching costs, aggregated, checked and filled.
//!
//! ```text
//! two views -> brightness of the other view's lines (line_gain)                   SgmMatcher
//!           -> patterns of a row (pattern)
//!           -> masks: which cells lie on the pixel's surface
//!           -> matching costs: masked Hamming distance, truncated by evidence (evidence), and
//!              difference of levels in the reference camera's exposure (exposure)
//!           -> doubt where a second disparity fits, too: costs count less there, and P2 more (rivals)
//!           -> penalties P1, P2; path costs from left, right and above (kernel)
//!           -> winner-take-all, sub-pixel step, margin (kernel)
//!           -> left-right check, uniqueness, texture (check); what is in doubt has no confidence
//!              what holds teaches exposure, and alignment of the lines to come
//!
//!           -> speckle removal -> region vote -> border, fill                     SgmRefiner
//!           -> medians: of 3 x 3, weighted by colour, of 3 x 3
//!           -> line of disparities
//! ```

mod alignment;
mod border;
mod check;
mod evidence;
mod exposure;
mod fill;
mod line_gain;
mod masks;
mod matcher;
mod medians;
mod plan;
mod refine;
mod region_vote;
mod rivals;
mod speckle;
mod surroundings;

pub use check::RowCheck;
pub use masks::{BlockMasks, RowMasks, SgmMasks, block_first};
pub use matcher::SgmMatcher;
pub use plan::SgmPlan;
pub use refine::SgmRefiner;
