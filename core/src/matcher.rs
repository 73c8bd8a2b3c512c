//! The matcher: pairs of lines in, lines of disparities out, at a fixed latency.

use core::fmt;

use crate::config::{Config, ConfigError};
use crate::kernel::{Kernels, Portable};
use crate::matching::RowMatcher;
use crate::memory::Arena;
use crate::refine::Refiner;
use crate::synapse::Synapses;

/// Most lines of a frame: what a `u32` counts, less the latency of any configuration.
pub const MAX_LINES: u32 = u32::MAX - (1 << 10);

/// A line of disparities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DisparityLine<'a> {
    /// Line of the frame, from 0.
    pub line: u32,
    /// First column of the frame that `disparities_q4` speaks of.
    pub column: u16,
    /// Disparities of the reference view, 1/16 px, [`INVALID`](crate::disparity::INVALID)
    /// where none is known; `region.width` of them.
    pub disparities_q4: &'a [i16],
}

/// A pair of lines was refused; the matcher is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PushError {
    /// A line does not have the configured width.
    Width,
    /// The frame is being flushed: call `finish` until it gives `None`, or `reset`.
    Finishing,
    /// The frame has [`MAX_LINES`] lines already.
    TooManyLines,
}

impl fmt::Display for PushError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Width => "the line does not have the configured width",
            Self::Finishing => "the last frame is not flushed to its end",
            Self::TooManyLines => "the frame has too many lines",
        })
    }
}

impl core::error::Error for PushError {}

/// Matches a stream of rectified line pairs in bounded memory.
///
/// ```
/// use vgstereo_core::config::Config;
/// use vgstereo_core::disparity::DisparityRange;
/// use vgstereo_core::kernel::Portable;
/// use vgstereo_core::matcher::Matcher;
/// use vgstereo_core::preset::Preset;
///
/// const CONFIG: Config = Config::new(Preset::PaperRaw.parameters(), 64, DisparityRange::up_to(15));
/// let mut memory = [0; CONFIG.memory_words()];
/// let mut matcher = Matcher::new(&CONFIG, Portable, &mut memory)?;
///
/// let mut lines = 0;
/// for _ in 0..20 {
///     if let Some(line) = matcher.push(&[128; 64], &[128; 64])? {
///         assert_eq!(line.line, lines);
///         lines += 1;
///     }
/// }
/// while let Some(_line) = matcher.finish() {
///     lines += 1;
/// }
/// assert_eq!(lines, 20);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Matcher<'m, K = Portable> {
    rows: RowMatcher<'m, K>,
    refiner: Refiner<'m>,
    config: Config,
    next_line: u32,
    lines_in: u32,
    finishing: bool,
}

impl<'m, K: Kernels> Matcher<'m, K> {
    /// Builds a matcher in lent memory of at least [`Config::memory_words`]; draws the
    /// synapses, the only step that uses floating point.
    ///
    /// # Errors
    /// [`ConfigError`] when the configuration is not valid or the memory too small.
    pub fn new(config: &Config, kernels: K, memory: &'m mut [u32]) -> Result<Self, ConfigError> {
        let mut arena = Arena::new(memory);
        Ok(Self {
            rows: RowMatcher::new(config, kernels, &mut arena)?,
            refiner: Refiner::new(config, &mut arena)?,
            config: *config,
            next_line: config.region.y,
            lines_in: 0,
            finishing: false,
        })
    }

    /// What the matcher was built from.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The offsets drawn for this configuration.
    #[must_use]
    pub fn synapses(&self) -> Synapses<'m> {
        self.rows.synapses()
    }

    /// Takes the next pair of lines, grey, rectified, from the top. Gives the line that
    /// this completes, if any: at most one, [`latency_lines`] above the pair.
    ///
    /// [`latency_lines`]: crate::config::Parameters::latency_lines
    ///
    /// # Errors
    /// [`PushError`]; the matcher is then unchanged.
    pub fn push(
        &mut self,
        left: &[u8],
        right: &[u8],
    ) -> Result<Option<DisparityLine<'_>>, PushError> {
        let width = usize::from(self.config.width);
        if left.len() != width || right.len() != width {
            return Err(PushError::Width);
        }
        if self.finishing {
            return Err(PushError::Finishing);
        }
        let pair = self.lines_in;
        if pair == MAX_LINES {
            return Err(PushError::TooManyLines);
        }
        self.lines_in = pair + 1;
        let complete = match self.rows.push(left, right) {
            Some(_) => self.refiner.push(self.rows.candidates_px()),
            // Below the region no row comes to push the last lines out: they are flushed,
            // each when it is due.
            None => self.region_is_matched() && self.is_due(pair) && self.refiner.flush(),
        };
        Ok(if complete {
            Some(self.take_line())
        } else {
            None
        })
    }

    /// After the last pair of a frame: gives the lines still to come, one per call, then
    /// `None`, after which the next frame may be pushed.
    pub fn finish(&mut self) -> Option<DisparityLine<'_>> {
        self.finishing = true;
        let mut complete = false;
        while !complete && self.rows.flush().is_some() {
            complete = self.refiner.push(self.rows.candidates_px());
        }
        if complete || self.refiner.flush() {
            Some(self.take_line())
        } else {
            self.reset();
            None
        }
    }

    /// Forgets the frame: the next pair is that of line 0.
    pub fn reset(&mut self) {
        self.rows.reset();
        self.refiner.reset();
        self.next_line = self.config.region.y;
        self.lines_in = 0;
        self.finishing = false;
    }

    /// Whether all rows of the region went to the refiner, and the frame goes on below.
    fn region_is_matched(&self) -> bool {
        let region = &self.config.region;
        self.rows.next_row() >= region.y.saturating_add(region.height)
    }

    /// Whether the next line is at least the latency above `pair`.
    fn is_due(&self, pair: u32) -> bool {
        let latency = self.config.parameters.latency_lines();
        pair >= self.next_line.saturating_add(latency)
    }

    fn take_line(&mut self) -> DisparityLine<'_> {
        let line = self.next_line;
        self.next_line = line.saturating_add(1);
        DisparityLine {
            line,
            column: self.config.region.x,
            disparities_q4: self.refiner.line_q4(),
        }
    }
}
