//! The command `cargo firmware`: it builds the firmware of the boards, runs the emulated ones
//! on images, and compares their results with those of the host, byte for byte.
//!
//! From the bottom up: [`board`] describes the boards, [`toolchain`] finds the compilers and
//! emulators for them, and [`build`] builds their firmware. [`elf`], [`panics`] and [`stack`]
//! look into the linked files, and [`log`] decodes what a board logs. [`pair`] prepares images,
//! [`host`] matches them here, [`emulator`] runs a board on them, [`live`] one that
//! serves the link, by way of a [`bridge`], [`model`] the real one's firmware on a model of its chip, and
//! [`simulation`] the one that is hardware in RTL, of which [`stereo_unit`] drives a part. [`received`] takes apart what these two send. [`commands`] are
//! the verbs of `cargo firmware`.

pub mod board;
pub mod bridge;
pub mod build;
pub mod commands;
pub mod elf;
pub mod emulator;
pub mod host;
pub mod live;
pub mod log;
pub mod model;
pub mod pair;
pub mod panics;
pub mod received;
pub mod simulation;
pub mod stack;
pub mod stereo_unit;
pub mod toolchain;
