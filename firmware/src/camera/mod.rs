//! Cameras: sources of numbered pairs of lines, and the bytes that they send.
//!
//! Two sensors can be connected to a chip in many ways: over two ports, side by side, line by line
//! or pixel by pixel. A driver hides the difference, with a [`Layout`] that splits the raw bytes of
//! a pair into its two lines. It delivers pairs of lines with their numbers, or an error that says
//! what went wrong. A [`RawLine`] unpacks the bytes of a line, in a [`PixelFormat`], for the
//! matcher.

mod error;
mod layout;
mod pattern;
mod source;
mod unpack;

pub use error::{Error, ErrorKind, ErrorType};
pub use layout::Layout;
pub use pattern::{OrTestPattern, TestPattern};
pub use source::{Geometry, LinePair, LinePairSource};
pub use unpack::RawLine;
pub use vgstereo_core::kernel::PixelFormat;
