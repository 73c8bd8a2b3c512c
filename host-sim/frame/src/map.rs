//! The map of a frame as it grows line by line, and why there may be none.

use std::ops::Range;

use vgstereo_core::matcher::MAX_LINES;
use vgstereo_core::{Config, ConfigError, LineOffsets, PushError};

use crate::views::Views;

/// Why a frame was not matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameError {
    /// The configuration is not valid.
    Config(ConfigError),
    /// The pair does not fit the configuration.
    Push(PushError),
    /// The system does not give this many threads.
    Threads(usize),
}

impl std::fmt::Display for FrameError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Config(error) => error.fmt(f),
            Self::Push(error) => error.fmt(f),
            Self::Threads(threads) => write!(f, "cannot start {threads} threads"),
        }
    }
}

impl std::error::Error for FrameError {}

impl From<ConfigError> for FrameError {
    fn from(error: ConfigError) -> Self {
        Self::Config(error)
    }
}

impl From<PushError> for FrameError {
    fn from(error: PushError) -> Self {
        Self::Push(error)
    }
}

/// Lines of disparities, one after another.
#[derive(Debug)]
pub(crate) struct Map {
    pub(crate) disparities_q4: Vec<i16>,
    pub(crate) confidences: Vec<u8>,
    /// What the frame taught of the offsets of lines.
    pub(crate) line_offsets: LineOffsets,
}

impl Map {
    /// An empty map with room for the lines of a frame, so that they are not moved to make some.
    pub(crate) fn with_room(config: &Config, views: &Views) -> Self {
        let region = config.region;
        let lines = views.height().min(region.height as usize);
        let pixels = lines * usize::from(region.width);
        Self {
            disparities_q4: Vec::with_capacity(pixels),
            confidences: Vec::with_capacity(pixels),
            line_offsets: config.line_offsets,
        }
    }

    /// Appends a line.
    pub(crate) fn push(&mut self, line_q4: &[i16], confidences: &[u8]) {
        self.disparities_q4.extend_from_slice(line_q4);
        self.confidences.extend_from_slice(confidences);
    }
}

/// The rows of a frame that are inside the region.
///
/// # Errors
/// [`PushError::TooManyLines`] when the views have more lines than a frame may have.
pub(crate) fn rows_of(config: &Config, views: &Views) -> Result<Range<u32>, PushError> {
    let lines = u32::try_from(views.height()).unwrap_or(u32::MAX);
    if lines > MAX_LINES {
        return Err(PushError::TooManyLines);
    }
    let region = config.region;
    let end = region.y.saturating_add(region.height).min(lines);
    Ok(region.y.min(end)..end)
}
