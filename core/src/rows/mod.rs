//! Rows: the lent working memory, and the lines stored in it.
//!
//! [`Arena`] carves the lent block. `Ring` keeps the newest rows of any kind, and [`Strip`] the
//! newest lines of one channel, padded so that every sample of a pattern is a plain read. [`View`]
//! keeps the newest lines of one camera: grey, colour and smoothed grey, each in a strip. A
//! [`Line`] is the input of the matcher, and `ValidRuns` keeps
//! what a camera saw of each. `Found` is the state of a pixel in a row of disparities.
//! [`LineOffsets`] say how far the lines of one view lie from where they should be.

mod arena;
mod copy;
mod found;
mod line;
mod line_offsets;
mod moved;
mod ring;
mod runs;
mod stage;
mod strip;
mod views;

pub use arena::{Arena, OutOfMemory, words};
pub(crate) use copy::{copy_common, extend_run};
pub(crate) use found::Found;
pub use line::{ColourRows, Line};
pub use line_offsets::LineOffsets;
pub use moved::RowOffsets;
pub(crate) use moved::{MAX_MOVED_LINES, OFFSET_BITS};
pub(crate) use ring::{Ring, RowWindow};
pub(crate) use runs::{MatchPositions, ValidRuns, fill_outside};
pub use stage::Part;
pub(crate) use stage::{Parts, RowStage, Then};
pub use strip::{Offset, Order, Strip, StripWindow};
pub(crate) use views::NewestRows;
pub use views::{View, ViewPair, ViewSize};
