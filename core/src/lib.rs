//! Dense stereo matching, line by line, with VG-RAM weightless neural networks.
//!
//! For a microcontroller or an FPGA soft-core beside a stereo camera, and for the host,
//! with the same bits: `no_std`, no allocation, no unsafe code, integers in every
//! per-pixel path. Nothing here holds a frame: working memory is lent by the caller and
//! grows with the width of a line, never with the height of the image.
//!
//! The method is that of the paper *Stereo Matching with VG-RAM Weightless Neural
//! Networks*: one neuron per pixel looks at the image through a constellation of
//! synapses, compares their samples pairwise, and recalls the disparity at which the
//! other view shows the most similar pattern of comparisons.
//!
//! # The pipeline
//!
//! One pair of lines goes in, one line of disparities comes out,
//! [`latency_lines`](config::Parameters::latency_lines) later:
//!
//! ```text
//!  camera      pair of lines, numbered, or what was lost        (camera)
//!    |         grey, and channels where there is colour         (camera::PixelFormat)
//!    v
//!  strip       the newest lines of each view, clamped; the     (strip)
//!    |         other's moved where they lie too low or high, by a fraction of a line
//!    |         samples at the offsets of the synapses,          (synapse)
//!    |         half of them where noise is averaged away        (matching)
//!    v
//!  patterns    one bit per pair of samples, one row per view    (minchinton)
//!    |
//!    +---------------------------+
//!    v                           v
//!  recall                      costs        Hamming distance over the cells on the
//!    nearest pattern wins;     |            pixel's surface, and difference of levels
//!    the k nearest are         |            in the reference's exposure (matching)
//!    candidates (matching)     v
//!    |                         aggregation  left, right and down, one row of state;
//!    |                         |            best, sub-pixel, margin     (aggregation)
//!    |                         v
//!    |                         check        the other view's best agrees, or not
//!    v                         v
//!  vote among neighbours,      speckles, vote of the surface, border,      (refine)
//!  median                      fill, medians, weighted by colour
//!    |                         |
//!    +---------------------------+
//!    v
//!  line        disparities in 1/16 px, or none, with confidence (disparity, matcher)
//! ```
//!
//! The left branch is the paper's, [`config::Recall`]; the right one is
//! [`config::Aggregation`]. A [`preset::Preset`] says which, and with what parameters.
//! Inner loops are [`kernel`]s: a plain reference each, and faster ones elsewhere.
//!
//! [`matcher::Matcher`] is all of it. It is built from a [`config::Config`]: the
//! parameters of a [`preset::Preset`], the width, the disparities to search, the
//! reference view and a region of interest. [`neuron`] and [`network`] are the method as
//! the paper writes it, a memory per neuron; the matcher is held to them bit for bit.
//! [`memory`] carves the lent block, [`view`] borrows an image.
//!
//! # Example
//!
//! ```
//! use vgstereo_core::config::Config;
//! use vgstereo_core::disparity::{DisparityRange, STEPS_PER_PX};
//! use vgstereo_core::kernel::Portable;
//! use vgstereo_core::matcher::Matcher;
//! use vgstereo_core::preset::Preset;
//!
//! const WIDTH: usize = 64;
//! const CONFIG: Config =
//!     Config::new(Preset::Paper.parameters(), WIDTH as u16, DisparityRange::up_to(15));
//!
//! // On a board: a static.
//! let mut memory = [0; CONFIG.memory_words()];
//! let mut matcher = Matcher::new(&CONFIG, Portable, &mut memory)?;
//!
//! // A texture seen 3 px further left by the right camera.
//! let texture = |x: usize, y: usize| ((x * 7919 + y * 104_729) * 31 >> 3) as u8;
//! let mut disparities_q4 = Vec::new();
//! for y in 0..40 {
//!     let left: [u8; WIDTH] = core::array::from_fn(|x| texture(x, y));
//!     let right: [u8; WIDTH] = core::array::from_fn(|x| texture(x + 3, y));
//!     if let Some(line) = matcher.push(&left, &right)? {
//!         disparities_q4.extend_from_slice(line.disparities_q4);
//!     }
//! }
//! while let Some(line) = matcher.finish() {
//!     disparities_q4.extend_from_slice(line.disparities_q4);
//! }
//! assert_eq!(disparities_q4.len(), 40 * WIDTH);
//! assert_eq!(disparities_q4[20 * WIDTH + 32], 3 * STEPS_PER_PX);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What it does not do
//!
//! It does not rectify: lines must be epipolar lines already, but for up to one line by which
//! all of one view may lie too low or too high: the right branch learns and mends that. It uses no floating point but
//! for drawing the synapses when a matcher is built.
//!
//! # Features
//!
//! Off by default: `serde`, parameters can be read from and written to text formats, which
//! needs an allocator; `defmt`, errors, parameters and what a camera tells can be logged with
//! defmt.
//!
//! The oldest Rust it is built with is 1.95.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod aggregation;
pub mod camera;
pub mod config;
pub mod disparity;
pub mod kernel;
pub mod matcher;
pub mod matching;
pub mod memory;
pub mod minchinton;
mod neighbours;
pub mod network;
pub mod neuron;
pub mod preset;
pub mod refine;
pub mod strip;
pub mod synapse;
pub mod view;
