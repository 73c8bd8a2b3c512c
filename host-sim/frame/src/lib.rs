//! Dense stereo matching of whole frames on a host: [`Views`], a rectified pair in memory, in; [`Matched`], its
//! disparities, out.
//!
//! [`match_frame`] gives the lines of the views to the matcher of `vgstereo-core` one by one, as firmware does, so that the
//! disparities are those of a microcontroller, bit for bit. It takes the kernels that it is given, of which
//! [`NativeKernels::fastest`] are the fastest, and works with one thread or several.

mod bands;
mod map;
mod pipelined;
mod views;

pub use bands::MAX_THREADS;
pub use map::FrameError;
pub use views::{ViewLine, Views};

use std::time::{Duration, Instant};

use vgstereo_core::{Config, DisparityLine, LineOffsets, Matcher, Method, PushError};
use vgstereo_kernels::NativeKernels;

use crate::map::Map;

/// The disparities of a frame, and the cost of matching it.
#[derive(Debug, Clone)]
pub struct Matched {
    /// Disparities of the region, 1/16 px, row-major.
    pub disparities_q4: Vec<i16>,
    /// Confidence of each disparity: 1 to 255, 0 where it was filled in or is not known.
    pub confidences: Vec<u8>,
    /// What the frame taught of the offsets of lines: see [`Matcher::line_offsets`].
    pub line_offsets: LineOffsets,
    /// Time from the first line in to the last line out, set-up of the memory excluded.
    pub time: Duration,
    /// Working memory of a matcher, bytes.
    pub working_bytes: usize,
    /// Number of lines between a pair going in and its disparities coming out.
    pub latency_lines: u32,
}

impl Matched {
    /// Returns the lines of the map, which is `width` px wide.
    pub fn lines(&self, width: u16) -> impl Iterator<Item = DisparityLine<'_>> {
        let columns = usize::from(width).max(1);
        let lines = self.disparities_q4.chunks(columns);
        let lines = (0..).zip(lines.zip(self.confidences.chunks(columns)));
        lines.map(|(line, (disparities_q4, confidences))| DisparityLine {
            line,
            column: 0,
            disparities_q4,
            confidences,
        })
    }
}

/// Matches a frame with up to `threads` threads; the disparities do not depend on their
/// number. The paper's method takes at most [`MAX_THREADS`] and one per row; SGM needs
/// the rows above, and takes at most two.
///
/// # Errors
/// [`FrameError`] when the configuration is not valid or the views do not fit it.
pub fn match_frame(
    config: &Config,
    views: &Views,
    kernels: NativeKernels,
    threads: usize,
) -> Result<Matched, FrameError> {
    config.validate()?;
    if views.width != config.width {
        return Err(PushError::Width.into());
    }
    if config.colour && !views.has_colour() {
        return Err(PushError::Colour.into());
    }
    let (map, time) = match &config.parameters.method {
        Method::Recall(recall) if threads > 1 => {
            bands::match_in_bands(config, recall, views, kernels, threads)?
        }
        Method::Sgm(sgm) if threads > 1 => pipelined::match_pipelined(config, sgm, views, kernels)?,
        _ => match_alone(config, views, kernels)?,
    };
    Ok(Matched {
        time,
        disparities_q4: map.disparities_q4,
        confidences: map.confidences,
        line_offsets: map.line_offsets,
        working_bytes: config.memory_words() * size_of::<u32>(),
        latency_lines: config.parameters.latency_lines(),
    })
}

/// Matches a frame; gives its map and the time from the first line in to the last out.
fn match_alone(
    config: &Config,
    views: &Views,
    kernels: NativeKernels,
) -> Result<(Map, Duration), FrameError> {
    let mut memory = vec![0; config.memory_words()];
    let mut matcher = Matcher::new(config, kernels, &mut memory)?;
    let mut map = Map::with_room(config, views);
    let started = Instant::now();
    for (left, right) in views.lines(kernels) {
        if let Some(line) = matcher.push(&left, &right)? {
            map.push(line.disparities_q4, line.confidences);
        }
    }
    while let Some(line) = matcher.finish() {
        map.push(line.disparities_q4, line.confidences);
    }
    let time = started.elapsed();
    map.line_offsets = matcher.line_offsets();
    Ok((map, time))
}

/// The example of the README, which is compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
