//! From a camera's line pairs to disparity lines, with fault recovery.
//!
//! A [`Session`] reads pairs of lines from a
//! [`LinePairSource`](vgstereo_core::camera::LinePairSource), gives them to a
//! [`Matcher`](vgstereo_core::matcher::Matcher) and its lines of disparities to a
//! [`DisparitySink`]. It drops a frame that is not whole, counts what was lost and starts
//! again at line 0 of the next frame; [`scripted`] puts scripted ones in its way. A
//! [`Watchdog`] is fed with each line that is matched. Drivers, pins and clocks are a board's
//! affair.
//!
//! Features, off by default: `serial`, a sink over a serial port; `defmt`, faults, events and
//! counters can be logged with defmt.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod fault;
pub mod scripted;
pub mod session;
pub mod sink;
pub mod watchdog;

pub use fault::Fault;
pub use session::{Event, Session, Statistics};
pub use sink::{DisparitySink, FrameInfo};
pub use watchdog::{NoWatchdog, Watchdog};
