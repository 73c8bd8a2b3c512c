//! `vgstereo view`: what a board sends over the link, live on a page in the browser.
//!
//! [`source`] opens what the bytes come from, [`plane`] collects the lines of a frame, and
//! [`board`] knows what the board has told. [`snapshot`] and [`status`] are what the page gets,
//! [`request`] is what it asks for, and [`hub`] stands between: one thread, [`reader`], reads and
//! commands the board, and [`server`] serves the page, so that neither waits for the other.
//! [`demo`] is a board in this process.

pub mod board;
pub mod demo;
pub mod focus;
pub mod hub;
pub mod plane;
pub mod reader;
pub mod request;
pub mod server;
pub mod snapshot;
pub mod source;
pub mod status;
