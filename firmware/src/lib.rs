//! From a camera's line pairs to disparity lines, with fault recovery.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;
