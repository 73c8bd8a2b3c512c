//! The README's example of a board, built without the standard library.
#![no_std]
#![allow(missing_docs)]

include!("../../docs/board.rs");
