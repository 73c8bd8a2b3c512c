//! Sampler: determines when all lines of a row of neurons are there, and forms its patterns.

use core::ops::Range;

use rand_core::SeedableRng;
use rand_pcg::Pcg32;

use super::planes::PatternRow;
use super::synapse::{OffsetLaw, StoredOffset, Synapses};
use crate::config::{Config, ConfigError, Region};
use crate::kernel::Kernels;
use crate::rows::{Arena, View, copy_common, words};

/// Forms the patterns of both views, row by row of the region of interest.
#[derive(Debug)]
pub struct Sampler<'m> {
    synapses: Synapses<'m>,
    region: Region,
    lines_ahead: u32,
    next_row: u32,
}

impl<'m> Sampler<'m> {
    /// Words of memory: two bytes per synapse.
    #[must_use]
    pub const fn words(synapses: u16) -> usize {
        words(synapses as usize, size_of::<StoredOffset>())
    }

    /// Number of lines of a view that patterns sample.
    #[must_use]
    pub const fn window_lines(support_y_px: u8) -> usize {
        2 * support_y_px as usize + 1
    }

    /// Draws the synapses of `config`: the first half with the first sigma, then the second half
    /// with the second; or takes those that the scope of the kernels `K` has. A row is given when the `lines_ahead`
    /// lines below it have come.
    ///
    /// # Errors
    /// [`ConfigError`] when sigma or support are out of their range, or the arena has fewer than
    /// [`Sampler::words`] left.
    pub fn new<K: Kernels>(
        config: &Config,
        lines_ahead: u32,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        let parameters = &config.parameters;
        let count = usize::from(parameters.synapses);
        let stored_offsets: &'m mut [StoredOffset] = arena.take(count)?;
        if let Some(drawn) = K::SCOPE.drawn {
            copy_common(stored_offsets, drawn.offsets);
        } else {
            let mut generator = Pcg32::seed_from_u64(parameters.seed);
            let (first, second) = stored_offsets.split_at_mut(count / 2);
            for (half, law) in [first, second]
                .into_iter()
                .zip(OffsetLaw::halves(parameters))
            {
                Synapses::draw(half, law, &mut generator)?;
            }
        }
        Ok(Self {
            synapses: Synapses::from_stored(stored_offsets),
            region: config.region,
            lines_ahead,
            next_row: 0,
        })
    }

    /// Lines of the frame whose rows were given, those outside the region included.
    #[must_use]
    pub fn rows_out(&self) -> u32 {
        self.next_row
    }

    /// The synapses drawn.
    #[must_use]
    pub fn synapses(&self) -> Synapses<'m> {
        self.synapses
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        self.next_row = 0;
    }

    /// Returns the next row inside the region if all of its lines are among the `lines_in` that
    /// have come. If no more come (`finishing`), returns the next row inside the region.
    pub fn next_row(&mut self, lines_in: u32, finishing: bool) -> Option<u32> {
        let ahead = if finishing { 0 } else { self.lines_ahead };
        while lines_in > self.next_row + ahead {
            let row = self.next_row;
            self.next_row += 1;
            if self.region.contains_line(row) {
                return Some(row);
            }
        }
        None
    }

    /// Forms the patterns of row `line` of a view, for the neurons at stored positions `positions`,
    /// and writes them to `patterns` from position 0 on. The first half of the synapses samples
    /// smoothed grey, the second half grey as it came.
    pub fn observe(
        &self,
        view: &View<'_>,
        line: u32,
        positions: Range<usize>,
        patterns: &mut PatternRow<'_>,
        kernels: &impl Kernels,
    ) {
        let strips = [view.smoothed(), view.grey()];
        let (first, count) = (positions.start, positions.len());
        patterns.observe(strips, &self.synapses, line, first, count, kernels);
    }
}
