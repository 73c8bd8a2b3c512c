//! Geometry: from the lines of two real cameras to rectified ones, and from disparities to
//! distances.
//!
//! Lenses distort, and no two cameras are mounted parallel. A [`Rectification`] says, for each pixel
//! of a rectified view, where a camera saw it; a program on a host makes it from a calibration, and
//! a device reads it from its flash. The [`Rectifier`] stands between camera and matcher: raw
//! lines go in, and rectified lines come out as soon as the lines that they need have come. It keeps
//! those lines and no others.
//!
//! ```text
//!  pair of raw lines ──▶ Rectifier ──▶ pairs of rectified lines ──▶ Matcher ──▶ DisparityLine
//!                          ▲                                                         │
//!                    Rectification                                            Depth ─┼─▶ mm
//!                                                                   RectifiedCamera ─┼─▶ points
//!                                                                         LaserScan ─┴─▶ ranges
//! ```

mod camera;
mod depth;
mod rectification;
mod rectifier;
mod scan;

pub use crate::kernel::Interpolation;
pub use camera::{Point, RectifiedCamera};
pub use depth::Depth;
pub use rectification::{Rectification, RectificationError, ViewMap};
pub use rectifier::{RawLineError, RectifiedLine, Rectifier};
pub use scan::{LINES_MAX as SCAN_LINES_MAX, LaserScan, Scan, ScanConfig, ScanError};
