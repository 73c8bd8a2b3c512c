//! From a camera's line pairs to disparity lines, with fault recovery.
//!
//! A [`Session`] reads pairs of lines from a
//! [`LinePairSource`](crate::camera::LinePairSource), gives them to a
//! [`Matcher`](vgstereo_core::matcher::Matcher) and its lines of disparities to a
//! [`DisparitySink`]. It drops a frame that is not whole, counts what was lost and starts
//! again at line 0 of the next frame. A [`Watchdog`] is fed with each line that is matched, as
//! long as frames come whole.
//! For tests, [`scripted`] has a camera that fails as a script says. Drivers, pins and clocks
//! are left to the boards.
//!
//! Three features are off by default: `sensors` sets up image sensors, `link` adds live
//! sessions, and `defmt` lets faults, events and counters be logged with defmt.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod calibration;
pub mod camera;
pub mod fault;
#[cfg(feature = "link")]
pub mod live;
pub mod scripted;
#[cfg(feature = "sensors")]
pub mod sensors;
pub mod session;
pub mod sink;
pub mod watchdog;

pub use fault::Fault;
pub use session::{Event, Session, Statistics};
pub use sink::{DisparitySink, FrameInfo};
pub use watchdog::{NoWatchdog, Watchdog};
