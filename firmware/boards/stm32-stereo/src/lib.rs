//! Shared code of the boards with an STM32 that has a camera port (DCMI), and two HM01B0: capture
//! of lines by DMA, the camera over it, the sensors' set-up, the clock, the watchdog, and the loop
//! of the session. A board has its pins, clocks and memory, and chooses the chip by a feature.
#![no_std]

pub mod calibration;
pub mod camera;
pub mod capture;
pub mod clock;
pub mod rig;
pub mod run;
pub mod sensors;
pub mod serial;
pub mod watchdog;
