//! The streaming matcher of the paper's method: takes lines of both views, returns rows of
//! candidates.

use core::ops::Range;

use crate::config::{Config, ConfigError, RecallParameters};
use crate::disparity::{INVALID, Reference};
use crate::kernel::{Kernels, LANES, RowRecall};
use crate::pattern::{PatternRow, Sampler, Synapses};
use crate::rows::{
    Arena, Line, MatchPositions, Order, Part, Parts, ViewPair, ViewSize, fill_outside, words,
};

/// Takes pairs of lines and returns one row of candidate disparities for each, `support.y_px` lines
/// later.
#[derive(Debug)]
pub struct RecallMatcher<'m, K> {
    kernels: K,
    views: ViewPair<'m>,
    sampler: Sampler<'m>,
    /// Patterns of the reference view.
    inputs: PatternRow<'m>,
    /// Patterns of the other view.
    stored: PatternRow<'m>,
    distances: &'m mut [i16],
    candidates_px: &'m mut [i16],
    recall: RecallParameters,
    config: Config,
}

impl RecallMatcher<'_, ()> {
    /// The parts of the matcher. With `W` columns (region `w`), `D` disparities, `n` synapses,
    /// support `(X, Y)` and `k` candidates, they take, each rounded up to words:
    ///
    /// | part | bytes |
    /// |---|---|
    /// | synapses | `2 n` |
    /// | views | `2 (2 Y + 1) (W + 2 X) + 8 (Y + 1)` |
    /// | patterns | `(W + w + 32) n / 8` |
    /// | recall | `2 D`, `D` rounded up to 16, and `2 k w` |
    pub(crate) const fn parts(config: &Config, recall: &RecallParameters) -> Parts {
        let parameters = &config.parameters;
        let synapses = parameters.synapses as usize;
        let columns = config.region.width as usize;
        let width = config.width as usize;
        let ahead = parameters.support.y_px as u32;
        let patterns = words(PatternRow::bytes(columns, synapses), 1)
            + words(PatternRow::bytes(width, synapses), 1);
        let distances = (config.disparities.count as usize).next_multiple_of(LANES);
        let recalled = words(distances, size_of::<i16>())
            + words(recall.candidates as usize * columns, size_of::<i16>());
        Parts::NONE
            .and(Part::memory(
                "synapses",
                Sampler::words(parameters.synapses),
            ))
            .and(Part::memory("views", 2 * view_size(config).words()))
            .and(Part {
                name: "patterns",
                words: patterns,
                look_back_lines: 2 * ahead,
                latency_lines: ahead,
            })
            .and(Part::memory("recall", recalled))
    }
}

/// Shape of either view: the lines that patterns sample.
const fn view_size(config: &Config) -> ViewSize {
    let support = config.parameters.support;
    ViewSize {
        width: config.width as usize,
        grey_lines: Sampler::window_lines(support.y_px),
        grey_padding: support.x_px as usize,
        colour_lines: 0,
        colour_padding: 0,
        smoothed_lines: 0,
        smoothed_padding: 0,
        smoothing_step: 0,
        moving_lines: 0,
        smoothing_latency_lines: 0,
        valid_lines: support.y_px as usize + 1,
    }
}

impl<'m, K: Kernels> RecallMatcher<'m, K> {
    /// Words of memory.
    #[must_use]
    pub const fn words(config: &Config, recall: &RecallParameters) -> usize {
        RecallMatcher::parts(config, recall).words()
    }

    /// Draws the synapses and carves the memory.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena has fewer than
    /// [`RecallMatcher::words`] left.
    pub fn new(
        config: &Config,
        recall: &RecallParameters,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        config.validate_for::<K>()?;
        // Rising disparities must be rising positions: see the module above.
        let other_order = match config.reference {
            Reference::Left => Order::Mirrored,
            Reference::Right => Order::Columns,
        };
        let disparities = usize::from(config.disparities.count);
        let columns = usize::from(config.region.width);
        let synapses = usize::from(config.parameters.synapses);
        Ok(Self {
            kernels,
            sampler: Sampler::new::<K>(config, config.parameters.support.y_px.into(), arena)?,
            views: ViewPair::new(
                config.reference,
                [view_size(config); 2],
                [Order::Columns, other_order],
                arena,
            )?,
            inputs: PatternRow::new(columns, synapses, arena)?,
            stored: PatternRow::new(config.width.into(), synapses, arena)?,
            distances: arena.take(disparities.next_multiple_of(LANES))?,
            candidates_px: arena.take(usize::from(recall.candidates) * columns)?,
            recall: *recall,
            config: *config,
        })
    }

    /// The synapses drawn.
    #[must_use]
    pub fn synapses(&self) -> Synapses<'m> {
        self.sampler.synapses()
    }

    /// Forgets the frame: the next pair is that of line 0.
    pub fn reset(&mut self) {
        self.sampler.reset();
        self.views.clear();
    }

    /// Number of lines of the frame whose rows are done, those outside the region included.
    pub(crate) fn rows_out(&self) -> u32 {
        self.sampler.rows_out()
    }

    /// Takes the next pair of lines, of the configured width. If this completes a row inside the
    /// region of interest, returns its line in the frame; the row is then
    /// [`RecallMatcher::candidates_px`].
    pub fn push(
        &mut self,
        left: &(impl Line + ?Sized),
        right: &(impl Line + ?Sized),
    ) -> Option<u32> {
        self.views.push(left, right, &self.kernels);
        self.recall_next(false)
    }

    /// Completes the next row inside the region after the last pair and returns its line, or `None`
    /// if there are no more.
    pub fn flush(&mut self) -> Option<u32> {
        self.recall_next(true)
    }

    /// Recalls the next row if its lines have come, or no others will, and returns its line. Apart, so
    /// that it is compiled once, whatever kinds of lines are pushed.
    fn recall_next(&mut self, is_last: bool) -> Option<u32> {
        let line = self.sampler.next_row(self.views.lines(), is_last)?;
        self.recall(line);
        Some(line)
    }

    /// The row last completed: planes of `region.width` disparities, px; see
    /// [`recall_row`](crate::kernel::recall_row).
    #[must_use]
    pub fn candidates_px(&self) -> &[i16] {
        self.candidates_px
    }

    /// Columns of the row last completed, from the region's first on, that the reference camera
    /// saw, and positions of the other view's stored row that the other camera saw.
    #[must_use]
    pub fn valid(&self) -> [Range<usize>; 2] {
        let line = self.rows_out().saturating_sub(1);
        [self.valid_columns(line), self.views.other.valid(line)]
    }

    fn valid_columns(&self, line: u32) -> Range<usize> {
        let column = usize::from(self.config.region.x);
        let Range { start, end } = self.views.reference.valid(line);
        start.saturating_sub(column)..end.saturating_sub(column)
    }

    fn recall(&mut self, line: u32) {
        let region = &self.config.region;
        let columns = usize::from(region.width);
        let column = usize::from(region.x);
        let MatchPositions { first, step } = match_positions(&self.config);
        let first = first as isize + isize::from(self.config.disparities.minimum_px);
        let step = step as isize;
        let disparities = usize::from(self.config.disparities.count);
        let seen = self.views.other.valid(line);
        let used = used_positions(first, step, columns, disparities, seen);
        for (view, positions, patterns) in [
            (
                &self.views.reference,
                column..column + columns,
                &mut self.inputs,
            ),
            (&self.views.other, used.clone(), &mut self.stored),
        ] {
            self.sampler
                .observe(view, line, positions, patterns, &self.kernels);
        }
        let row = RowRecall {
            inputs: self.inputs.planes(),
            count: columns,
            stored: self.stored.planes(),
            stored_count: used.len(),
            first: first - used.start as isize,
            step,
            minimum_px: self.config.disparities.minimum_px,
            disparities,
            candidates: usize::from(self.recall.candidates),
            ties: self.recall.ties,
            line,
            column: u32::from(region.x),
        };
        self.kernels
            .recall_row(&row, self.distances, self.candidates_px);
        let valid = self.valid_columns(line);
        for plane in self.candidates_px.chunks_exact_mut(columns.max(1)) {
            fill_outside(plane, &valid, INVALID);
        }
    }
}

/// Where the columns of the region have their matches in the stored row of the other view.
pub(super) fn match_positions(config: &Config) -> MatchPositions {
    let column = i32::from(config.region.x);
    let (first, step) = match config.reference {
        Reference::Left => (i32::from(config.width) - 1 - column, -1),
        Reference::Right => (column, 1),
    };
    MatchPositions { first, step }
}

/// The stored positions of the other view that `columns` neurons can reach, of those that its
/// camera saw.
fn used_positions(
    first: isize,
    step: isize,
    columns: usize,
    disparities: usize,
    seen: Range<usize>,
) -> Range<usize> {
    let last = first + step * (columns as isize - 1);
    let clamp = |position: isize| position.max(0).unsigned_abs().max(seen.start).min(seen.end);
    clamp(first.min(last))..clamp(first.max(last) + disparities as isize)
}
