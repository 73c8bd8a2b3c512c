//! The host's end of the link: what a board sends, and commands to it.
//!
//! [`source`] opens what the bytes come from, of which [`demo`] is a board in this process. A
//! [`client`] makes messages of the bytes, and sends commands. [`board`] knows what the board has
//! told, and [`plane`] collects the lines of its frames, of whose views [`pixels`] unpacks the pixels.
//! [`derived`] has the depths and the scan that follow from disparities. [`attended`] joins them for
//! programs that ask and wait, of which [`upload`] sends a calibration. [`recording`] keeps the bytes,
//! and is a source of them in turn, of which [`recorded`] takes pairs and disparities; [`exporter`]
//! makes messages for other programs. [`tally`] says what came.

pub mod attended;
pub mod board;
pub mod client;
pub mod demo;
pub mod derived;
pub mod exporter;
pub mod pixels;
pub mod plane;
pub mod recorded;
pub mod recording;
pub mod source;
pub mod tally;
pub mod upload;
