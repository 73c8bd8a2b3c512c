//! The matcher: pairs of lines in, lines of disparities out, at a fixed latency.

use core::fmt;

use crate::config::{Checks, ChecksError, Config, ConfigError, Method};
use crate::disparity::DisparityLine;
use crate::kernel::{Kernels, Portable};
use crate::pattern::Synapses;
use crate::plan::Plan;
use crate::recall::{RecallMatcher, RecallRefiner};
use crate::rows::{Arena, Line, LineOffsets};
use crate::sgm::{SgmMatcher, SgmRefiner};

/// Largest number of lines of a frame: the range of a `u32`, less the latency of any configuration.
pub const MAX_LINES: u32 = u32::MAX - (1 << 10);

/// A pair of lines was refused; the matcher is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PushError {
    /// A line does not have the configured width.
    Width,
    /// A line has no colour, though the configuration says that lines have.
    Colour,
    /// The frame is being flushed: call `finish` until it gives `None`, or `reset`.
    Finishing,
    /// The frame has [`MAX_LINES`] lines already.
    TooManyLines,
}

impl fmt::Display for PushError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Width => "the line does not have the configured width",
            Self::Colour => "the line has no colour, which the configuration asks for",
            Self::Finishing => "the last frame is not flushed to its end",
            Self::TooManyLines => "the frame has too many lines",
        })
    }
}

impl core::error::Error for PushError {}

/// Matches a stream of rectified line pairs in bounded memory.
///
/// ```
/// use vgstereo_core::{Config, DisparityRange, Matcher, Portable, Preset};
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
    kernels: K,
    config: Config,
    latency_lines: u32,
    next_line: u32,
    lines_in: u32,
    finishing: bool,
}

/// Matcher and refinement of the configured method.
#[derive(Debug)]
// Either variant is stored in place; neither holds rows itself.
#[allow(clippy::large_enum_variant)]
enum Pipeline<'m, K> {
    Recall {
        rows: RecallMatcher<'m, K>,
        refiner: RecallRefiner<'m>,
    },
    Sgm {
        rows: SgmMatcher<'m, K>,
        refiner: SgmRefiner<'m, K>,
    },
}

impl<K: Kernels> Pipeline<'_, K> {
    fn reset(&mut self) {
        match self {
            Self::Recall { rows, refiner } if K::SCOPE.recall => {
                rows.reset();
                refiner.reset();
            }
            Self::Sgm { rows, refiner } if K::SCOPE.sgm => {
                rows.reset();
                refiner.reset();
            }
            _ => {}
        }
    }

    fn rows_out(&self) -> u32 {
        match self {
            Self::Recall { rows, .. } if K::SCOPE.recall => rows.rows_out(),
            Self::Sgm { rows, .. } if K::SCOPE.sgm => rows.rows_out(),
            _ => 0,
        }
    }

    /// Takes a pair. Returns whether a row went to the refinement, and whether that completed a
    /// line.
    fn push(&mut self, left: &(impl Line + ?Sized), right: &(impl Line + ?Sized)) -> (bool, bool) {
        match self {
            Self::Recall { rows, refiner } if K::SCOPE.recall => match rows.push(left, right) {
                Some(_) => (true, refiner.push(rows.candidates_px(), rows.valid())),
                None => (false, false),
            },
            Self::Sgm { rows, refiner } if K::SCOPE.sgm => match rows.push(left, right) {
                Some(_) => (
                    true,
                    refiner.push(
                        rows.found(),
                        rows.confidences(),
                        rows.valid(),
                        rows.channels(),
                    ),
                ),
                None => (false, false),
            },
            _ => (false, false),
        }
    }

    /// Completes a line that waits for rows which will not come; returns whether there was one.
    fn flush_refinement(&mut self) -> bool {
        match self {
            Self::Recall { refiner, .. } if K::SCOPE.recall => refiner.flush(),
            Self::Sgm { rows, refiner } if K::SCOPE.sgm => refiner.flush(rows.channels()),
            _ => false,
        }
    }

    /// Completes the next line after the last pair; returns false if there are no more.
    fn flush(&mut self) -> bool {
        match self {
            Self::Recall { rows, refiner } if K::SCOPE.recall => {
                while rows.flush().is_some() {
                    if refiner.push(rows.candidates_px(), rows.valid()) {
                        return true;
                    }
                }
            }
            Self::Sgm { rows, refiner } if K::SCOPE.sgm => {
                while rows.flush().is_some() {
                    let (row, confidences) = (rows.found(), rows.confidences());
                    if refiner.push(row, confidences, rows.valid(), rows.channels()) {
                        return true;
                    }
                }
            }
            _ => {}
        }
        self.flush_refinement()
    }

    fn line(&self) -> (&[i16], &[u8]) {
        match self {
            Self::Recall { refiner, .. } => (refiner.line_q4(), refiner.line_confidences()),
            Self::Sgm { refiner, .. } => (refiner.line_q4(), refiner.line_confidences()),
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
            Method::Recall(recall) if K::SCOPE.recall => Pipeline::Recall {
                rows: RecallMatcher::new(config, recall, kernels, &mut arena)?,
                refiner: RecallRefiner::new(config, recall, &mut arena)?,
            },
            Method::Sgm(sgm) if K::SCOPE.sgm => Pipeline::Sgm {
                rows: SgmMatcher::new(config, sgm, kernels, &mut arena)?,
                refiner: SgmRefiner::new(config, sgm, kernels, &mut arena)?,
            },
            _ => return Err(ConfigError::Scope),
        };
        Ok(Self {
            pipeline,
            kernels,
            config: *config,
            latency_lines: Plan::new(config).latency_lines(),
            next_line: config.region.y,
            lines_in: 0,
            finishing: false,
        })
    }

    /// The configuration that the matcher was built from, with the checks that it has now.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The kernel set that the matcher was built with.
    pub fn kernels(&self) -> K {
        self.kernels
    }

    /// The synapses drawn for this configuration.
    #[must_use]
    pub fn synapses(&self) -> Synapses<'m> {
        match &self.pipeline {
            Pipeline::Recall { rows, .. } => rows.synapses(),
            Pipeline::Sgm { rows, .. } => rows.synapses(),
        }
    }

    /// Takes other checks than those of the configuration, and forgets the frame: they hold from line 0 of
    /// the next.
    ///
    /// # Errors
    /// [`ChecksError`]; the matcher is then unchanged.
    pub fn set_checks(&mut self, checks: &Checks) -> Result<(), ChecksError> {
        let mut config = self.config;
        config.set_checks(checks)?;
        if let (Pipeline::Sgm { rows, refiner }, Method::Sgm(sgm)) =
            (&mut self.pipeline, &config.parameters.method)
        {
            if !refiner.set_checks(&config, sgm) {
                return Err(ChecksError::SpeckleSize);
            }
            rows.set_checks(sgm);
        }
        self.config = config;
        self.reset();
        Ok(())
    }

    /// By how much the lines of the other view lie too low, as the last frame showed that was finished; before
    /// one, and where lines are not moved, what frames begin with. What differs by less than 24/256 line all over
    /// the frame from what that frame began with does not count.
    #[must_use]
    pub fn line_offsets(&self) -> LineOffsets {
        match &self.pipeline {
            Pipeline::Recall { .. } => self.config.line_offsets,
            Pipeline::Sgm { rows, .. } => rows.line_offsets(),
        }
    }

    /// Takes other offsets than those of the configuration for frames to begin with, and forgets the frame: of two
    /// cameras that are fixed to each other, a frame may begin with what the one before taught.
    pub fn set_line_offsets(&mut self, offsets: LineOffsets) {
        if let Pipeline::Sgm { rows, .. } = &mut self.pipeline {
            rows.set_line_offsets(offsets);
        }
        self.reset();
    }

    /// Takes the next pair of lines, rectified, from the top. Rows of grey are slices of bytes; see
    /// [`Line`] for colour. Returns the line that this completes, if any: at most one,
    /// [`Plan::latency_lines`] above the pair.
    ///
    /// # Errors
    /// [`PushError`]; the matcher is then unchanged.
    pub fn push(
        &mut self,
        left: &(impl Line + ?Sized),
        right: &(impl Line + ?Sized),
    ) -> Result<Option<DisparityLine<'_>>, PushError> {
        let width = usize::from(self.config.width);
        if left.width() != width || right.width() != width {
            return Err(PushError::Width);
        }
        if self.config.colour && !(left.has_colour() && right.has_colour()) {
            return Err(PushError::Colour);
        }
        if self.finishing {
            return Err(PushError::Finishing);
        }
        let pair = self.lines_in;
        if pair == MAX_LINES {
            return Err(PushError::TooManyLines);
        }
        self.lines_in = pair + 1;
        let (has_row, mut complete) = self.pipeline.push(left, right);
        if !has_row {
            // Below the region, no further rows push the last lines out: they are flushed when they
            // are due.
            complete =
                self.region_is_matched() && self.is_due(pair) && self.pipeline.flush_refinement();
        }
        Ok(if complete {
            Some(self.take_line())
        } else {
            None
        })
    }

    /// Returns the remaining lines after the last pair of a frame, one per call, then `None`. After
    /// that, the next frame may be pushed.
    pub fn finish(&mut self) -> Option<DisparityLine<'_>> {
        self.finishing = true;
        if self.pipeline.flush() {
            Some(self.take_line())
        } else {
            if let Pipeline::Sgm { rows, .. } = &mut self.pipeline {
                rows.end_frame();
            }
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
        pair >= self.next_line.saturating_add(self.latency_lines)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Preset, presets};
    use crate::disparity::DisparityRange;
    use crate::kernel::{Only, Scope, Scoped};
    use std::vec;

    #[test]
    fn the_line_after_the_last_that_can_be_counted_is_refused() {
        for preset in [Preset::PaperRaw, Preset::Micro] {
            let config = Config::new(preset.parameters(), 8, DisparityRange::up_to(3));
            let mut memory = vec![0; config.memory_words()];
            let mut matcher = Matcher::new(&config, Portable, &mut memory).unwrap();
            assert!(matcher.push(&[7; 8], &[7; 8]).is_ok());
            matcher.lines_in = MAX_LINES - 1;
            assert!(matcher.push(&[7; 8], &[7; 8]).is_ok());
            for _ in 0..2 {
                let refused = matcher.push(&[7; 8], &[7; 8]).map(|_| ());
                assert_eq!(refused, Err(PushError::TooManyLines));
                assert_eq!(matcher.lines_in, MAX_LINES);
            }
            // The pairs that were taken have their lines.
            let mut lines = 0;
            while matcher.finish().is_some() {
                lines += 1;
            }
            assert_eq!(lines, 2);
        }
    }

    /// The lines of a scene that shifts, which has texture, plain parts and noise.
    fn lines(y: u32) -> [[u8; 72]; 2] {
        let level = |x: u32, noise: u32| {
            let texture = ((x * 7919 + y * 104_729) * 31) >> 3;
            let plain = 40 + y;
            let base = if (x / 12 + y / 6).is_multiple_of(3) {
                plain
            } else {
                texture
            };
            (base & 0xff) as u8 ^ ((x * y + noise) % 3) as u8
        };
        let left = core::array::from_fn(|x| level(x as u32, 0));
        let right = core::array::from_fn(|x| level(x as u32 + 3 + y / 20, 1));
        [left, right]
    }

    /// Runs a frame of 50 lines; returns the synapses, the disparities and the confidences.
    fn run(
        config: &Config,
        kernels: impl Kernels,
    ) -> (vec::Vec<[i8; 2]>, vec::Vec<i16>, vec::Vec<u8>) {
        let mut memory = vec![0; config.memory_words()];
        let mut matcher = Matcher::new(config, kernels, &mut memory).unwrap();
        let synapses = matcher.synapses().iter().map(|o| [o.dx, o.dy]).collect();
        let (mut disparities_q4, mut confidences) = (vec![], vec![]);
        let mut keep = |line: DisparityLine<'_>| {
            disparities_q4.extend_from_slice(line.disparities_q4);
            confidences.extend_from_slice(line.confidences);
        };
        for y in 0..50 {
            let [left, right] = lines(y);
            if let Some(line) = matcher.push(&left, &right).unwrap() {
                keep(line);
            }
        }
        while let Some(line) = matcher.finish() {
            keep(line);
        }
        (synapses, disparities_q4, confidences)
    }

    /// A matcher in the scope of a preset has that preset's synapses, disparities and confidences, and refuses presets
    /// with another scope.
    #[test]
    fn in_its_scope_alone_a_preset_is_what_it_is_among_all() {
        fn compare<S: Scoped>(_: S, own: Preset) {
            for preset in Preset::ALL {
                let config = Config::new(preset.parameters(), 72, DisparityRange::up_to(20));
                let kernels = Only::<_, S>::new(Portable);
                let accepted = config.validate_for::<Only<Portable, S>>();
                if preset == own {
                    assert_eq!(accepted, Ok(()));
                    let (alone, among_all) = (run(&config, kernels), run(&config, Portable));
                    assert_eq!(alone.0, among_all.0, "the synapses of {preset}");
                    assert!(alone == among_all, "the disparities of {preset}");
                } else if preset.parameters().scope() != own.parameters().scope() {
                    assert_eq!(accepted, Err(ConfigError::Scope), "{preset} of {own}");
                    let mut memory = vec![0; config.memory_words()];
                    let refused = Matcher::new(&config, kernels, &mut memory).map(drop);
                    assert_eq!(refused, Err(ConfigError::Scope), "{preset} of {own}");
                }
            }
        }
        compare(presets::PaperRaw, Preset::PaperRaw);
        compare(presets::Paper, Preset::Paper);
        compare(presets::Lite, Preset::Lite);
        compare(presets::Micro, Preset::Micro);
        compare(presets::Balanced, Preset::Balanced);
        compare(presets::Quality, Preset::Quality);
    }

    /// The scope of one configuration refuses what differs from it in any respect that it fixes.
    #[test]
    fn a_scope_refuses_what_it_leaves_out() {
        const CONFIG: Config =
            Config::new(Preset::Micro.parameters(), 72, DisparityRange::up_to(20));
        #[derive(Clone, Copy)]
        struct This;
        impl Scoped for This {
            const SCOPE: Scope = Scope {
                drawn: presets::Micro::SCOPE.drawn,
                ..CONFIG.scope()
            };
        }
        type Kernels = Only<Portable, This>;
        const _: () = assert!(CONFIG.validate_for::<Kernels>().is_ok());
        let kernels = Kernels::new(Portable);
        assert!(run(&CONFIG, kernels) == run(&CONFIG, Portable));
        let narrower = Config {
            width: 40,
            region: crate::config::Region::whole(40),
            ..CONFIG
        };
        assert_eq!(narrower.validate_for::<Kernels>(), Ok(()));
        let changes: [fn(&mut Config); 5] = [
            |config| config.colour = true,
            |config| config.disparities.count = 20,
            |config| config.parameters = config.parameters.with_seed(2),
            |config| config.parameters.synapses = 32,
            |config| config.parameters.cell_length_max_px = 4,
        ];
        for change in changes {
            let mut config = CONFIG;
            change(&mut config);
            assert_eq!(config.validate(), Ok(()));
            assert_eq!(config.validate_for::<Kernels>(), Err(ConfigError::Scope));
        }
    }
}
