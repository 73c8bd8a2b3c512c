//! Dense stereo matching, line by line, with VG-RAM weightless neural networks.
//!
//! For a microcontroller or an FPGA soft-core beside a stereo camera, and for the host, with the
//! same bits: `no_std`, no allocation, no unsafe code, integers in every per-pixel path. Nothing
//! here holds a frame: working memory is lent by the caller and grows with the width of a line,
//! never with the height of the image.
//!
//! The method starts from the paper *Stereo Matching with VG-RAM Weightless Neural Networks*: one
//! neuron per pixel samples the image at a constellation of synapses, compares the samples
//! pairwise, and recalls the disparity at which the other view shows the most similar pattern of
//! comparisons. On top of these patterns, a second branch aggregates matching costs semi-globally
//! (SGM), checks them from both views and fills what was not found.
//!
//! # The pipeline
//!
//! A [`Config`] says what to compute: the [`Parameters`] of a [`Preset`], the width, the
//! disparities to search. A [`Matcher`] takes pairs of [`Line`]s and gives [`DisparityLine`]s;
//! the [`Plan`] tells its bytes and its latency. One pair of lines goes in, one line of disparities
//! comes out:
//!
//! ```text
//!  pair of lines         rectified; grey, or grey and colour                        Line
//!    |
//!    v
//!  views                 the newest lines of each view: grey; for sgm also colour  rows
//!    |                   and smoothed grey, the other view's lines in the brightness
//!    |                   of the reference view's, and moved by a fraction of a line
//!    v
//!  patterns              one bit per pair of samples, one row per view              pattern
//!    |
//!    +-----------------------------+
//!    | recall                      | sgm
//!    v                             v
//!  nearest pattern of          masks: cells on the pixel's surface
//!  every neuron, and the           v
//!  runners-up                  matching costs: masked Hamming distance,
//!    |                         difference of levels in one exposure;
//!    |                         less of them where the texture repeats
//!    |                             v
//!    |                         aggregation: paths from left, right and above
//!    |                             v
//!    |                         winner-take-all, sub-pixel step, margin
//!    |                             v
//!    |                         left-right check, uniqueness, texture
//!    v                             v
//!  vote among neighbours       speckle removal, region vote
//!    v                             v
//!  median                      border, fill; medians, weighted by colour
//!    |                             |
//!    +-----------------------------+
//!    v
//!  line of disparities   1/16 px or none, and a confidence each             DisparityLine
//! ```
//!
//! The inner loops are [`kernel`]s: a plain reference each, for every target ([`Portable`]), and
//! faster sets of the same bits in the crate `vgstereo-kernels`.
//!
//! # The modules, lowest first
//!
//! Nothing imports what stands below it in this list.
//!
//! | module | what it has |
//! |---|---|
//! | [`disparity`] | the unit of disparities, lines of them, their range, the value that means "none" |
//! | [`kernel`] | the inner loops: task, plain reference, test, a file each |
//! | `rows` | lent memory, rings and strips of lines, views, stages from row to row |
//! | [`geometry`] | lines of two real cameras made epipolar ones; depths, points and a laser scan from disparities; before and after the pipeline above |
//! | [`config`] | parameters, presets, and what else a matcher is built from |
//! | `pattern` | synapses, and the patterns of a row of neurons |
//! | `recall`, `sgm` | the two branches, each with its matcher, its refinement and what they take |
//! | [`plan`] | bytes, lines looked back and latency of every part |
//! | [`matcher`] | the whole pipeline |
//! | `literal` | the paper's network as it is written, off the data path: the oracle |
//!
//! # Example
//!
//! ```
//! use vgstereo_core::{Config, DisparityRange, Matcher, Portable, Preset, STEPS_PER_PX};
//!
//! const WIDTH: usize = 64;
//! const CONFIG: Config =
//!     Config::new(Preset::Paper.parameters(), WIDTH as u16, DisparityRange::up_to(15));
//! // A bad configuration does not compile.
//! const _: () = assert!(CONFIG.validate().is_ok());
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
//! A matcher does not rectify: its lines must be epipolar lines already, as a
//! [`Rectifier`](geometry::Rectifier) makes them, but for an offset of up to one line between the
//! views, or up to four if so configured, which the SGM branch learns and corrects, also where it
//! changes along the line; what a frame taught can be given to the next ([`LineOffsets`]). The core
//! does not calibrate cameras: a [`Rectification`](geometry::Rectification) comes from elsewhere. It
//! uses no floating point but for drawing the synapses when a matcher is built, for the angles of a
//! scan when that is, and in some sums of a line for that offset. It does not read cameras: the crate
//! `vgstereo-firmware` does, and hands their bytes over as [`Line`]s; the conversions of pixel formats
//! are kernels.
//!
//! # Features
//!
//! Off by default: `serde`, parameters can be read from and written to text formats, which needs
//! an allocator; `defmt`, errors and parameters can be logged with defmt.
//!
//! The oldest Rust it is built with is 1.95.
#![no_std]
#![forbid(unsafe_code)]
// No panic is reachable from input.
#![cfg_attr(
    not(test),
    warn(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

#[cfg(test)]
extern crate std;

pub mod config;
pub mod disparity;
pub mod geometry;
#[allow(
    clippy::indexing_slicing,
    reason = "lanes of arrays, and rows whose common length is proven once: no check is left in the loops"
)]
pub mod kernel;
#[doc(hidden)]
pub mod literal;
pub mod matcher;
#[doc(hidden)]
pub mod pattern;
pub mod plan;
#[doc(hidden)]
pub mod recall;
#[doc(hidden)]
pub mod rows;
#[doc(hidden)]
pub mod sgm;

pub use config::{
    Config, ConfigError, Method, Output, Parameters, Preset, RecallParameters, Region,
    SgmParameters, presets,
};
pub use disparity::{DisparityLine, DisparityRange, INVALID, Reference, STEPS_PER_PX};
pub use kernel::{Kernels, Only, Portable, Scope, Scoped};
pub use matcher::{Matcher, PushError};
pub use plan::Plan;
pub use rows::{ColourRows, Line, LineOffsets};
