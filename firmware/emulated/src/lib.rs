//! What the emulated boards share: a session between files of the host.
//!
//! A board brings a counter of instructions, memory to lend and the bounds of its stack;
//! `run` does the rest: it reads a [`Request`] from the command line, matches the frames
//! of a camera whose lines come from a file, one pair at a time, writes the disparities
//! to another, logs each frame with defmt on standard output, and leaves a [`Report`]. The
//! host's side writes the one and reads the others. Only built for a chip: `camera`, `run`,
//! `sink` and `stack`.
#![no_std]

#[cfg(test)]
extern crate std;

use core::ffi::CStr;

pub mod meter;
pub mod report;
pub mod request;

#[cfg(target_os = "none")]
pub mod camera;
#[cfg(target_os = "none")]
pub mod run;
#[cfg(target_os = "none")]
pub mod sink;
#[cfg(target_os = "none")]
pub mod stack;

pub use report::Report;
pub use request::Request;

/// File that the camera reads: of each line, the left view's bytes, then the right's.
pub const LINES_FILE: &CStr = c"lines.raw";
/// File of disparities: whole frames one after another, row-major, 1/16 px, two bytes
/// each, little-endian, as the sink is given them.
pub const DISPARITIES_FILE: &CStr = c"disparities.raw";
/// File of their confidences, one byte each.
pub const CONFIDENCES_FILE: &CStr = c"confidences.raw";
/// File of the [`Report`], or of one line that begins with `error`.
pub const REPORT_FILE: &CStr = c"report.txt";
