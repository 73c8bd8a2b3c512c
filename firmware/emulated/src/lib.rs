//! Code shared by the emulated boards: a session between files of the host.
//!
//! A board supplies a counter of instructions, memory to lend and the bounds of its stack. `serve`
//! does the rest: it parses a [`Request`] from the command line, matches frames whose lines are
//! read from a file pair by pair, writes the disparities and confidences to files, logs each frame
//! with defmt on standard output, and writes a [`Report`]. The host writes the file of lines and
//! reads the others. `alone`, `board`, `camera`, `cmsdk`, `run`, `sink` and `stack` are built for
//! chips only, and what reads and writes files only with the feature `semihosting`.
#![no_std]

#[cfg(test)]
extern crate std;

use core::ffi::CStr;

pub mod live;
pub mod memories;
#[cfg(any(test, all(target_os = "none", feature = "complete")))]
mod memory;
pub mod meter;
pub mod rectifier;
pub mod report;
pub mod request;
pub mod serial;
pub mod task;

#[cfg(all(target_os = "none", feature = "semihosting"))]
pub mod alone;
#[cfg(all(target_os = "none", feature = "semihosting"))]
pub mod board;
#[cfg(all(target_os = "none", feature = "semihosting"))]
pub mod camera;
#[cfg(target_os = "none")]
pub mod cmsdk;
#[cfg(all(target_os = "none", feature = "complete"))]
pub mod run;
#[cfg(all(target_os = "none", feature = "semihosting"))]
pub mod sink;
#[cfg(target_os = "none")]
pub mod stack;

#[cfg(all(target_os = "none", feature = "semihosting", not(feature = "complete")))]
pub use alone::run as serve;
#[cfg(all(target_os = "none", feature = "complete"))]
pub use run::run as serve;

pub use report::Report;
pub use request::Request;

/// File of the camera's lines, of one frame or of several that are sent in turn: for each line, the bytes
/// of the left view, then those of the right.
pub const LINES_FILE: &CStr = c"lines.raw";
/// File of the rectification, if the request has a calibration.
pub const CALIBRATION_FILE: &CStr = c"calibration.vgr";
/// File of disparities, written by the sink: whole frames one after another, row by row, 1/16 px,
/// each in two bytes, little-endian.
pub const DISPARITIES_FILE: &CStr = c"disparities.raw";
/// File of confidences in the order of the disparities, one byte each.
pub const CONFIDENCES_FILE: &CStr = c"confidences.raw";
/// File of laser scans, if the request has one: for each whole frame the first bearing and the step
/// between bearings, rad, as `f32`, and the ranges, mm, as `u16`, all little-endian.
pub const SCANS_FILE: &CStr = c"scans.raw";
/// File of the [`Report`], or of a single line that begins with `error`.
pub const REPORT_FILE: &CStr = c"report.txt";
