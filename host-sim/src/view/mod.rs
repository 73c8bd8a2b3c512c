//! `vgstereo view`: what a board sends over the link, live on a page in the browser.
//!
//! [`snapshot`] and [`status`] are what the page gets, [`request`] is what it asks for, and [`hub`]
//! stands between: one thread, [`reader`], reads and commands the board, and [`server`] serves the
//! page, so that neither waits for the other.

pub mod focus;
pub mod hub;
pub mod reader;
pub mod request;
pub mod server;
pub mod snapshot;
pub mod status;
