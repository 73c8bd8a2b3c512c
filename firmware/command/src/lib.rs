//! The host's side of the firmware: boards are built, those with an emulator fed with images and
//! held to the host's own results, byte for byte.
//!
//! From the bottom up: [`board`] knows the boards, [`toolchain`] finds what builds for
//! them, [`build`] builds, [`elf`] and [`panics`] look into what was linked, [`log`] takes the
//! texts of a board's log from it; [`pair`]
//! prepares images, [`emulator`] runs a board on them and [`host`] the same here;
//! [`commands`] are the verbs of `cargo firmware`.

pub mod board;
pub mod build;
pub mod commands;
pub mod elf;
pub mod emulator;
pub mod host;
pub mod log;
pub mod pair;
pub mod panics;
pub mod stack;
pub mod toolchain;
