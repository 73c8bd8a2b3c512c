//! The line-streaming half of the matcher: pairs of lines in, rows of candidates out.

use rand_core::SeedableRng;
use rand_pcg::Pcg32;

use super::{LANES, RowRecall, TieBreak};
use crate::config::{Config, ConfigError};
use crate::disparity::Reference;
use crate::kernel::Kernels;
use crate::memory::{Arena, words};
use crate::minchinton::PatternRow;
use crate::strip::{Order, Strip};
use crate::synapse::{StoredOffset, Synapses};

/// Pairs of lines in, one row of candidate disparities out, `support.y_px` lines later.
#[derive(Debug)]
pub struct RowMatcher<'m, K> {
    kernels: K,
    synapses: Synapses<'m>,
    reference: Strip<'m>,
    other: Strip<'m>,
    inputs: PatternRow<'m>,
    stored: PatternRow<'m>,
    distances: &'m mut [i16],
    candidates_px: &'m mut [i16],
    config: Config,
    next_row: u32,
}

impl RowMatcher<'_, ()> {
    /// Words of memory: the first five parts of the table of [`Config::memory_words`].
    #[must_use]
    pub const fn memory_words(config: &Config) -> usize {
        let parameters = &config.parameters;
        let synapses = parameters.synapses as usize;
        let width = config.width as usize;
        let columns = config.region.width as usize;
        words(synapses, size_of::<StoredOffset>())
            + 2 * Strip::memory_words(width, parameters.support)
            + words(PatternRow::bytes(columns, synapses), 1)
            + words(PatternRow::bytes(width, synapses), 1)
            + words(
                (config.disparities.count as usize).next_multiple_of(LANES),
                size_of::<i16>(),
            )
            + words(parameters.candidates as usize * columns, size_of::<i16>())
    }
}

impl<'m, K: Kernels> RowMatcher<'m, K> {
    /// Draws the synapses and carves the memory.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena is too small.
    pub fn new(config: &Config, kernels: K, arena: &mut Arena<'m>) -> Result<Self, ConfigError> {
        config.validate()?;
        let parameters = &config.parameters;
        let count = usize::from(parameters.synapses);
        let width = usize::from(config.width);
        let columns = usize::from(config.region.width);
        let synapses = Synapses::draw(
            arena.take(count)?,
            parameters.sigma_px,
            parameters.support,
            &mut Pcg32::seed_from_u64(parameters.seed),
        )?;
        // Rising disparities must be rising positions: see the module above.
        let other_order = match config.reference {
            Reference::Left => Order::Mirrored,
            Reference::Right => Order::Columns,
        };
        let support = parameters.support;
        Ok(Self {
            kernels,
            synapses,
            reference: Strip::new(width, support, Order::Columns, arena)?,
            other: Strip::new(width, support, other_order, arena)?,
            inputs: PatternRow::new(columns, count, arena)?,
            stored: PatternRow::new(width, count, arena)?,
            distances: arena.take(usize::from(config.disparities.count).next_multiple_of(LANES))?,
            candidates_px: arena.take(usize::from(parameters.candidates) * columns)?,
            config: *config,
            next_row: 0,
        })
    }

    /// The offsets drawn.
    #[must_use]
    pub fn synapses(&self) -> Synapses<'m> {
        self.synapses
    }

    /// Forgets the frame: the next pair is that of line 0.
    pub fn reset(&mut self) {
        self.reference.clear();
        self.other.clear();
        self.next_row = 0;
    }

    /// Lines of the frame whose rows are done, those outside the region too.
    pub(crate) fn next_row(&self) -> u32 {
        self.next_row
    }

    /// Takes the next pair of lines, grey, `width` pixels each. When this completes a
    /// row inside the region of interest, gives its line in the frame; the row is then
    /// [`RowMatcher::candidates_px`].
    pub fn push(&mut self, left: &[u8], right: &[u8]) -> Option<u32> {
        let (reference, other) = match self.config.reference {
            Reference::Left => (left, right),
            Reference::Right => (right, left),
        };
        self.reference.push(reference);
        self.other.push(other);
        let ready = self.next_row + u32::from(self.config.parameters.support.y_px);
        if self.reference.lines() > ready {
            self.advance()
        } else {
            None
        }
    }

    /// After the last pair: gives the next of the rows still to come inside the region,
    /// `None` when there are no more.
    pub fn flush(&mut self) -> Option<u32> {
        while self.next_row < self.reference.lines() {
            if let Some(line) = self.advance() {
                return Some(line);
            }
        }
        None
    }

    /// The row last completed: planes of `region.width` disparities in px; see
    /// [`recall_row`](super::recall_row).
    #[must_use]
    pub fn candidates_px(&self) -> &[i16] {
        self.candidates_px
    }

    fn advance(&mut self) -> Option<u32> {
        let line = self.next_row;
        self.next_row += 1;
        let region = &self.config.region;
        if !region.contains_line(line) {
            return None;
        }
        let columns = usize::from(region.width);
        let column = usize::from(region.x);
        let width = usize::from(self.config.width);
        let parameters = &self.config.parameters;
        self.inputs.observe(
            &self.reference,
            &self.synapses,
            line,
            column,
            columns,
            &self.kernels,
        );
        // The minimum and the column fit `i16` and `u16`, and so `isize` with room.
        let minimum = self.config.disparities.minimum_px as isize;
        let (first, step) = match self.config.reference {
            Reference::Left => ((width - 1 - column) as isize + minimum, -1),
            Reference::Right => (column as isize + minimum, 1),
        };
        let disparities = usize::from(self.config.disparities.count);
        let used = used_positions(first, step, columns, disparities, width);
        self.stored.observe(
            &self.other,
            &self.synapses,
            line,
            used.start,
            used.len(),
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
            candidates: usize::from(parameters.candidates),
            ties: parameters.ties,
            line,
            column: u32::from(region.x),
        };
        self.kernels
            .recall_row(&row, self.distances, self.candidates_px);
        Some(line)
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
