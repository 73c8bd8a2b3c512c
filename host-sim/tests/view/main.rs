//! `vgstereo view` over real sockets: who is served, what clients can do to each other, and what
//! the board is told.

mod fixture;
mod reader;
mod server;
