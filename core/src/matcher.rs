//! The matcher: pairs of lines in, lines of disparities out, at a fixed latency.

use core::fmt;

use crate::config::{Config, ConfigError, Method};
use crate::kernel::{Kernels, Portable};
use crate::matching::{RowMatcher, SurfaceMatcher};
use crate::memory::Arena;
use crate::refine::{Refiner, SurfaceRefiner};
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
    /// Confidence of each: 1 to 255 for one that was found, 0 for one that was filled in
    /// or is not known. 255 for all that is found by a method without this measure.
    pub confidences: &'a [u8],
}

/// A pair of lines was refused; the matcher is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PushError {
    /// A line does not have the configured width in the configured pixel format.
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
    pipeline: Pipeline<'m, K>,
    config: Config,
    next_line: u32,
    lines_in: u32,
    finishing: bool,
}

/// The rows of a method and their refinement.
#[derive(Debug)]
// One of them is there, in the place of the larger: neither holds rows itself.
#[allow(clippy::large_enum_variant)]
enum Pipeline<'m, K> {
    Recall {
        rows: RowMatcher<'m, K>,
        refiner: Refiner<'m>,
        /// Grey lines, where the pixel format has colour.
        grey: [&'m mut [u8]; 2],
    },
    Surface {
        rows: SurfaceMatcher<'m, K>,
        refiner: SurfaceRefiner<'m, K>,
    },
}

impl<K: Kernels> Pipeline<'_, K> {
    fn reset(&mut self) {
        match self {
            Self::Recall { rows, refiner, .. } => {
                rows.reset();
                refiner.reset();
            }
            Self::Surface { rows, refiner } => {
                rows.reset();
                refiner.reset();
            }
        }
    }

    fn rows_out(&self) -> u32 {
        match self {
            Self::Recall { rows, .. } => rows.rows_out(),
            Self::Surface { rows, .. } => rows.rows_out(),
        }
    }

    /// Takes a pair. Whether it gave a row to the refinement, and that a line.
    fn push(&mut self, config: &Config, left: &[u8], right: &[u8]) -> (bool, bool) {
        match self {
            Self::Recall {
                rows,
                refiner,
                grey: [grey_left, grey_right],
            } => {
                let row = if config.format.is_grey() {
                    rows.push(left, right)
                } else {
                    config.format.luma(left, grey_left);
                    config.format.luma(right, grey_right);
                    rows.push(grey_left, grey_right)
                };
                match row {
                    Some(_) => (true, refiner.push(rows.candidates_px())),
                    None => (false, false),
                }
            }
            Self::Surface { rows, refiner } => match rows.push(left, right) {
                Some(_) => (
                    true,
                    refiner.push(rows.found_q4(), rows.confidences(), rows.channels()),
                ),
                None => (false, false),
            },
        }
    }

    /// Completes a line of those that wait for rows which will not come.
    fn flush_refinement(&mut self) -> bool {
        match self {
            Self::Recall { refiner, .. } => refiner.flush(),
            Self::Surface { rows, refiner } => refiner.flush(rows.channels()),
        }
    }

    /// After the last pair: completes the next line; false when there are no more.
    fn flush(&mut self) -> bool {
        match self {
            Self::Recall { rows, refiner, .. } => {
                while rows.flush().is_some() {
                    if refiner.push(rows.candidates_px()) {
                        return true;
                    }
                }
            }
            Self::Surface { rows, refiner } => {
                while rows.flush().is_some() {
                    let (row, confidences) = (rows.found_q4(), rows.confidences());
                    if refiner.push(row, confidences, rows.channels()) {
                        return true;
                    }
                }
            }
        }
        self.flush_refinement()
    }

    fn line(&self) -> (&[i16], &[u8]) {
        match self {
            Self::Recall { refiner, .. } => (refiner.line_q4(), refiner.line_confidences()),
            Self::Surface { refiner, .. } => (refiner.line_q4(), refiner.line_confidences()),
        }
    }
}

impl<'m, K: Kernels> Matcher<'m, K> {
    /// Builds a matcher in lent memory of at least [`Config::memory_words`]; draws the
    /// synapses, the only step that uses floating point.
    ///
    /// # Errors
    /// [`ConfigError`] when the configuration is not valid or the memory too small.
    pub fn new(config: &Config, kernels: K, memory: &'m mut [u32]) -> Result<Self, ConfigError> {
        let mut arena = Arena::new(memory);
        let pipeline = match &config.parameters.method {
            Method::Recall(recall) => {
                let grey_bytes = if config.format.is_grey() {
                    0
                } else {
                    usize::from(config.width)
                };
                Pipeline::Recall {
                    rows: RowMatcher::new(config, recall, kernels, &mut arena)?,
                    refiner: Refiner::new(config, recall, &mut arena)?,
                    grey: [arena.take(grey_bytes)?, arena.take(grey_bytes)?],
                }
            }
            Method::Aggregation(aggregation) => Pipeline::Surface {
                rows: SurfaceMatcher::new(config, aggregation, kernels, &mut arena)?,
                refiner: SurfaceRefiner::new(config, aggregation, kernels, &mut arena)?,
            },
        };
        Ok(Self {
            pipeline,
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
        match &self.pipeline {
            Pipeline::Recall { rows, .. } => rows.synapses(),
            Pipeline::Surface { rows, .. } => rows.synapses(),
        }
    }

    /// Takes the next pair of lines, rectified, from the top, in the configured pixel
    /// format. Gives the line that this completes, if any: at most one,
    /// [`latency_lines`] above the pair.
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
        let bytes = self.config.format.line_bytes(self.config.width);
        if left.len() != bytes || right.len() != bytes {
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
        let (has_row, mut complete) = self.pipeline.push(&self.config, left, right);
        if !has_row {
            // Below the region no row comes to push the last lines out: they are flushed,
            // each when it is due.
            complete =
                self.region_is_matched() && self.is_due(pair) && self.pipeline.flush_refinement();
        }
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
        if self.pipeline.flush() {
            Some(self.take_line())
        } else {
            self.reset();
            None
        }
    }

    /// Forgets the frame: the next pair is that of line 0.
    pub fn reset(&mut self) {
        self.pipeline.reset();
        self.next_line = self.config.region.y;
        self.lines_in = 0;
        self.finishing = false;
    }

    /// Whether all rows of the region went to the refinement, and the frame goes on below.
    fn region_is_matched(&self) -> bool {
        let region = &self.config.region;
        self.pipeline.rows_out() >= region.y.saturating_add(region.height)
    }

    /// Whether the next line is at least the latency above `pair`.
    fn is_due(&self, pair: u32) -> bool {
        let latency = self.config.parameters.latency_lines();
        pair >= self.next_line.saturating_add(latency)
    }

    fn take_line(&mut self) -> DisparityLine<'_> {
        let line = self.next_line;
        self.next_line = line.saturating_add(1);
        let (disparities_q4, confidences) = self.pipeline.line();
        DisparityLine {
            line,
            column: self.config.region.x,
            disparities_q4,
            confidences,
        }
    }
}
