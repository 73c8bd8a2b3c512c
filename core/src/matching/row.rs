//! The line-streaming half of the matcher: pairs of lines in, rows of candidates out.

use super::sampler::{Sampler, SamplerSize};
use super::{LANES, RowRecall, TieBreak};
use crate::config::{Config, ConfigError, Recall};
use crate::disparity::Reference;
use crate::kernel::Kernels;
use crate::memory::{Arena, words};
use crate::minchinton::PatternRow;
use crate::strip::{Order, Strip};
use crate::synapse::Synapses;

/// Pairs of lines in, one row of candidate disparities out, `support.y_px` lines later.
#[derive(Debug)]
pub struct RowMatcher<'m, K> {
    kernels: K,
    sampler: Sampler<'m>,
    /// Patterns of the reference view.
    inputs: PatternRow<'m>,
    /// Patterns of the other view.
    stored: PatternRow<'m>,
    distances: &'m mut [i16],
    candidates_px: &'m mut [i16],
    recall: Recall,
    config: Config,
}

impl RowMatcher<'_, ()> {
    /// Words of memory: the first five parts of the table of [`Config::memory_words`].
    #[must_use]
    pub const fn memory_words(config: &Config, recall: &Recall) -> usize {
        let disparities = config.disparities.count as usize;
        let columns = config.region.width as usize;
        let synapses = config.parameters.synapses as usize;
        Sampler::memory_words(config, Self::sampler_size(config))
            + words(PatternRow::bytes(columns, synapses), 1)
            + words(PatternRow::bytes(config.width as usize, synapses), 1)
            + words(disparities.next_multiple_of(LANES), size_of::<i16>())
            + words(recall.candidates as usize * columns, size_of::<i16>())
    }

    const fn sampler_size(config: &Config) -> SamplerSize {
        let support = config.parameters.support;
        SamplerSize {
            reference_depth: Strip::depth(support),
            reference_padding: support.x_px as usize,
            other_moving: false,
            smoothing_step: None,
        }
    }
}

impl<'m, K: Kernels> RowMatcher<'m, K> {
    /// Draws the synapses and carves the memory.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena is too small.
    pub fn new(
        config: &Config,
        recall: &Recall,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        config.validate()?;
        // Rising disparities must be rising positions: see the module above.
        let other_order = match config.reference {
            Reference::Left => Order::Mirrored,
            Reference::Right => Order::Columns,
        };
        let size = RowMatcher::sampler_size(config);
        let disparities = usize::from(config.disparities.count);
        let columns = usize::from(config.region.width);
        let synapses = usize::from(config.parameters.synapses);
        Ok(Self {
            kernels,
            sampler: Sampler::new(config, size, [Order::Columns, other_order], arena)?,
            inputs: PatternRow::new(columns, synapses, arena)?,
            stored: PatternRow::new(config.width.into(), synapses, arena)?,
            distances: arena.take(disparities.next_multiple_of(LANES))?,
            candidates_px: arena.take(usize::from(recall.candidates) * columns)?,
            recall: *recall,
            config: *config,
        })
    }

    /// The offsets drawn.
    #[must_use]
    pub fn synapses(&self) -> Synapses<'m> {
        self.sampler.synapses()
    }

    /// Forgets the frame: the next pair is that of line 0.
    pub fn reset(&mut self) {
        self.sampler.reset();
    }

    /// Lines of the frame whose rows are done, those outside the region too.
    pub(crate) fn rows_out(&self) -> u32 {
        self.sampler.rows_out()
    }

    /// Takes the next pair of lines, grey, `width` pixels each. When this completes a
    /// row inside the region of interest, gives its line in the frame; the row is then
    /// [`RowMatcher::candidates_px`].
    pub fn push(&mut self, left: &[u8], right: &[u8]) -> Option<u32> {
        self.sampler.push(left, right, &self.kernels);
        let line = self.sampler.next_row(false)?;
        self.recall(line);
        Some(line)
    }

    /// After the last pair: gives the next of the rows still to come inside the region,
    /// `None` when there are no more.
    pub fn flush(&mut self) -> Option<u32> {
        let line = self.sampler.next_row(true)?;
        self.recall(line);
        Some(line)
    }

    /// The row last completed: planes of `region.width` disparities in px; see
    /// [`recall_row`](super::recall_row).
    #[must_use]
    pub fn candidates_px(&self) -> &[i16] {
        self.candidates_px
    }

    fn recall(&mut self, line: u32) {
        let region = &self.config.region;
        let columns = usize::from(region.width);
        let column = usize::from(region.x);
        let width = usize::from(self.config.width);
        // The minimum and the column fit `i16` and `u16`, and so `isize` with room.
        let minimum = self.config.disparities.minimum_px as isize;
        let (first, step) = match self.config.reference {
            Reference::Left => ((width - 1 - column) as isize + minimum, -1),
            Reference::Right => (column as isize + minimum, 1),
        };
        let disparities = usize::from(self.config.disparities.count);
        let used = used_positions(first, step, columns, disparities, width);
        self.sampler.observe(
            line,
            (&mut self.inputs, column..column + columns),
            (&mut self.stored, used.clone()),
            &self.kernels,
        );
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
    }
}

/// The stored positions that `columns` neurons can reach, clamped to the row.
fn used_positions(
    first: isize,
    step: isize,
    columns: usize,
    disparities: usize,
    width: usize,
) -> core::ops::Range<usize> {
    let last = first + step * (columns as isize - 1);
    let clamp = |position: isize| position.max(0).unsigned_abs().min(width);
    clamp(first.min(last))..clamp(first.max(last) + disparities as isize)
}

impl TieBreak {
    /// The same rule with another seed.
    #[must_use]
    pub const fn with_seed(self, seed: u64) -> Self {
        match self {
            Self::Lowest => Self::Lowest,
            Self::Random { .. } => Self::Random { seed },
        }
    }
}
