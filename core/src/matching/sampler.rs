//! Strips of both views, from which the patterns of a row of each are formed.

use core::ops::Range;

use rand_core::SeedableRng;
use rand_pcg::Pcg32;

use super::smoothing::SmoothedStrips;
use crate::config::{Config, ConfigError, Region};
use crate::disparity::Reference;
use crate::kernel::Kernels;
use crate::memory::{Arena, words};
use crate::minchinton::PatternRow;
use crate::strip::{Order, Strip};
use crate::synapse::{StoredOffset, Synapses};

/// Grey lines of both views in; the patterns of a row of neurons out.
#[derive(Debug)]
pub(super) struct Sampler<'m> {
    synapses: Synapses<'m>,
    pub(super) reference: Strip<'m>,
    pub(super) other: Strip<'m>,
    smoothed: Option<SmoothedStrips<'m>>,
    view: Reference,
    region: Region,
    reach_lines: u32,
    next_row: u32,
}

/// What a sampler is sized for.
#[derive(Debug, Clone, Copy)]
pub(super) struct SamplerSize {
    /// Lines kept of the reference view.
    pub(super) reference_depth: usize,
    /// Pixels kept of the reference view on either side of a line.
    pub(super) reference_padding: usize,
    /// Whether lines of the other view are moved; see [`Strip::push_moved`].
    pub(super) other_moving: bool,
    /// Largest step of grey that is smoothed for the first half of the synapses; `None` where
    /// all see lines as they came.
    pub(super) smoothing_step: Option<u8>,
}

impl<'m> Sampler<'m> {
    pub(super) const fn memory_words(config: &Config, size: SamplerSize) -> usize {
        let parameters = &config.parameters;
        let synapses = parameters.synapses as usize;
        let width = config.width as usize;
        let support = parameters.support;
        words(synapses, size_of::<StoredOffset>())
            + Strip::memory_words(width, size.reference_padding, size.reference_depth)
            + Strip::memory_words(width, support.x_px as usize, Strip::depth(support))
            + if size.other_moving {
                Strip::moving_words(width)
            } else {
                0
            }
            + match size.smoothing_step {
                Some(_) => SmoothedStrips::memory_words(config),
                None => 0,
            }
    }

    pub(super) fn new(
        config: &Config,
        size: SamplerSize,
        orders: [Order; 2],
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        let parameters = &config.parameters;
        let support = parameters.support;
        let count = usize::from(parameters.synapses);
        let width = usize::from(config.width);
        let stored_offsets: &'m mut [StoredOffset] = arena.take(count)?;
        let mut generator = Pcg32::seed_from_u64(parameters.seed);
        let (near, far) = stored_offsets.split_at_mut(count / 2);
        for (half, sigma_px) in [near, far].into_iter().zip(parameters.sigmas_px) {
            Synapses::draw(half, sigma_px, support, &mut generator)?;
        }
        let [order, other_order] = orders;
        let (padding, depth) = (support.x_px.into(), Strip::depth(support));
        let other = Strip::new(width, padding, depth, other_order, arena)?;
        Ok(Self {
            synapses: Synapses::from_stored(stored_offsets),
            reference: Strip::new(
                width,
                size.reference_padding,
                size.reference_depth,
                order,
                arena,
            )?,
            other: if size.other_moving {
                other.moving(arena)?
            } else {
                other
            },
            smoothed: match size.smoothing_step {
                Some(step_max) => Some(SmoothedStrips::new(config, step_max, orders, arena)?),
                None => None,
            },
            view: config.reference,
            region: config.region,
            reach_lines: support.y_px.into(),
            next_row: 0,
        })
    }

    /// Rows given so far.
    pub(super) fn rows_out(&self) -> u32 {
        self.next_row
    }

    pub(super) fn synapses(&self) -> Synapses<'m> {
        self.synapses
    }

    /// Forgets the frame.
    pub(super) fn reset(&mut self) {
        self.reference.clear();
        self.other.clear();
        if let Some(smoothed) = &mut self.smoothed {
            smoothed.clear();
        }
        self.next_row = 0;
    }

    /// Takes the next pair of grey lines.
    pub(super) fn push(&mut self, left: &[u8], right: &[u8], kernels: &impl Kernels) {
        let (reference, other) = in_roles(self.view, left, right);
        self.push_roles(reference, other, 0, kernels);
    }

    /// The same, the reference view's line first; the other's lies too low.
    pub(super) fn push_roles(
        &mut self,
        reference: &[u8],
        other: &[u8],
        other_offset_q4: i8,
        kernels: &impl Kernels,
    ) {
        self.reference.push(reference);
        self.other.push_moved(other, other_offset_q4);
        if let Some(smoothed) = &mut self.smoothed {
            smoothed.follow(&self.reference, &self.other, kernels);
        }
    }

    /// The next row inside the region whose lines below are all there; with `finishing`,
    /// the next inside the region.
    pub(super) fn next_row(&mut self, finishing: bool) -> Option<u32> {
        let reach = if finishing { 0 } else { self.reach_lines };
        while self.reference.lines() > self.next_row + reach {
            let row = self.next_row;
            self.next_row += 1;
            if self.region.contains_line(row) {
                return Some(row);
            }
        }
        None
    }

    /// Forms the patterns of row `line`: into `inputs` those of positions of the reference
    /// view, into `stored` those of the other, each from position 0 on.
    pub(super) fn observe<'p>(
        &self,
        line: u32,
        (inputs, input_positions): (&mut PatternRow<'p>, Range<usize>),
        (stored, stored_positions): (&mut PatternRow<'p>, Range<usize>),
        kernels: &impl Kernels,
    ) {
        let [reference, other] = [&self.reference, &self.other];
        // Smoothed or not, and as they came.
        let (references, others) = match &self.smoothed {
            Some(smoothed) => ([&smoothed.reference, reference], [&smoothed.other, other]),
            None => ([reference; 2], [other; 2]),
        };
        for (patterns, strips, positions) in [
            (inputs, references, input_positions),
            (stored, others, stored_positions),
        ] {
            let (first, count) = (positions.start, positions.len());
            patterns.observe(strips, &self.synapses, line, first, count, kernels);
        }
    }
}

/// The pair as (reference, other).
pub(super) fn in_roles<T>(view: Reference, left: T, right: T) -> (T, T) {
    match view {
        Reference::Left => (left, right),
        Reference::Right => (right, left),
    }
}
