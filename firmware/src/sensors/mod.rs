//! Sensors: set-up of image sensors over I²C, both of a pair alike.
//!
//! A [`Sensor`] takes the [`SensorSettings`] of its pair: window, clock, period of a line, length
//! of a frame, a fixed exposure and gain, and what starts a frame. Automatic exposure, gain and
//! white balance are off, because those of two sensors drift apart; the black level is calibrated
//! by each sensor itself. Settings out of a sensor's bounds are refused before anything is written.
//! [`set_up_pair`] sets both up, on two buses, or on one with two addresses; [`reset_by_pin`]
//! resets them. Everything is written with the traits of embedded-hal 1.0 alone.
//!
//! | sensor | shutter | lines | what starts a frame | registers by |
//! |---|---|---|---|---|
//! | [`hm01b0`] | rolling | `Grey8` | itself, a trigger | the crate `hm01b0` |
//! | [`mt9v034`] | global | 10 bits of grey | itself, a trigger, another sensor | its data sheet |
//! | [`ov7670`] | rolling | `Yuv422` | itself alone | its data sheet |
//!
//! Each is tested register by register against what its data sheet says, or what others quote of
//! it; on the hardware none has been run.

mod error;
pub mod hm01b0;
pub mod mt9v034;
pub mod ov7670;
mod pair;
mod reset;
mod sensor;
mod settings;
#[cfg(test)]
mod testing;
mod times;

pub use error::{SensorError, Setting, SettingError};
pub use pair::{PairError, Side, set_up_pair};
pub use reset::{ResetTiming, reset_by_pin};
pub use sensor::Sensor;
pub use settings::{Binning, FrameSync, SensorSettings, TestPattern, Window};
