//! Dense stereo matching, line by line, with VG-RAM weightless neural networks.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod camera;
pub mod config;
pub mod disparity;
pub mod kernel;
pub mod matcher;
pub mod matching;
pub mod memory;
pub mod minchinton;
pub mod network;
pub mod neuron;
pub mod preset;
pub mod refine;
pub mod strip;
pub mod synapse;
pub mod view;
