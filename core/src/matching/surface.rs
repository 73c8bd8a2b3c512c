//! The aggregating half of the matcher: pairs of lines in, rows of checked disparities out.

use super::alignment::{Alignment, GreyRows, Match};
use super::channels::{ChannelStrips, ChannelsSize};
use super::cost::{CostRun, MAX_CHANNELS, cost_stride};
use super::exposure::Exposure;
use super::mask::MASK_LANES;
use super::row_masks::{RowMasks, SurfaceMasks, block_first};
use super::sampler::{Sampler, SamplerSize, in_roles};
use crate::aggregation::{AggregateRow, RowCheck, path_scratch_bytes};
use crate::config::{Aggregation, Config, ConfigError};
use crate::disparity::{Reference, STEPS_PER_PX};
use crate::kernel::Kernels;
use crate::memory::{Arena, OutOfMemory, words};
use crate::minchinton::{CELLS_PER_BYTE, PatternRow, Planes};
use crate::strip::{Order, Strip};
use crate::synapse::Synapses;

/// Most pixels of a run of costs without masks.
const RUN_LANES: usize = 128;

/// Pairs of lines in, one row of disparities out, `support.y_px` lines later; in the order
/// in which the reference view is stored.
#[derive(Debug)]
pub struct SurfaceMatcher<'m, K, M = SurfaceMasks<'m, K>> {
    kernels: K,
    sampler: Sampler<'m>,
    /// Without strips where grey is the only channel: those of the sampler serve.
    reference: ChannelStrips<'m>,
    other: ChannelStrips<'m>,
    exposure: Exposure,
    alignment: Alignment,
    /// `None` where every cell counts.
    masks: Option<M>,
    /// By the number of cells that count, the cost of one of them, 1/256.
    cell_costs_q8: &'m mut [u16],
    costs: &'m mut [u8],
    /// Path costs from the right; before that, [`CostInputs`].
    from_right: &'m mut [u8],
    from_above: &'m mut [u8],
    p2_along: &'m mut [u8],
    p2_down: &'m mut [u8],
    paths: &'m mut [u8],
    sums: &'m mut [i16],
    other_best: &'m mut [u32],
    best: &'m mut [u16],
    refined_q4: &'m mut [i16],
    margins: &'m mut [i16],
    found_q4: &'m mut [i16],
    confidences: &'m mut [u8],
    parameters: Aggregation,
    config: Config,
}

/// Geometry derived from a configuration.
#[derive(Debug, Clone, Copy)]
struct Sizes {
    width: usize,
    stride: usize,
    /// Stored positions before the other view's first pixel, for negative disparities.
    front: usize,
    /// Stored positions in all: whatever disparity of whatever pixel.
    positions: usize,
    pattern_depth: usize,
    depth: usize,
    padding: usize,
    colour: bool,
    /// Whether lines of the other view are moved to where those of the reference view are.
    aligned: bool,
    smoothing_step: Option<u8>,
}

impl Sizes {
    const fn new(config: &Config, parameters: &Aggregation) -> Self {
        let support = config.parameters.support;
        let width = config.width as usize;
        let stride = cost_stride(config.disparities.count as usize);
        let minimum = config.disparities.minimum_px as isize;
        let front = if minimum < 0 {
            minimum.unsigned_abs()
        } else {
            0
        };
        let behind = if minimum > 0 {
            minimum.unsigned_abs()
        } else {
            0
        };
        let ahead = support.y_px as usize;
        let (speckle, vote, median_x, median_y) = (
            match &parameters.speckle {
                Some(speckle) => speckle.reach_y_px as usize,
                None => 0,
            },
            match &parameters.vote {
                Some(vote) => vote.reach_y_px as usize,
                None => 0,
            },
            match &parameters.weighted_median {
                Some(median) => median.reach_x_px as usize,
                None => 0,
            },
            match &parameters.weighted_median {
                Some(median) => median.reach_y_px as usize,
                None => 0,
            },
        );
        // Lines from the newest to the oldest that each stage still looks at.
        // The line above a row is still there for the penalties of the path down.
        let pattern_depth = max(2 * ahead + 1, ahead + 2);
        // Below a region, the first line is still there when the last is due.
        let waiting_depth = ahead + parameters.refinement_lines() as usize + 1;
        let vote_depth = ahead + speckle + 2 * vote + 1;
        let median_depth = ahead + speckle + vote + 1 + 2 * median_y + 1;
        Self {
            width,
            stride,
            front,
            positions: front + width + behind + stride,
            pattern_depth,
            depth: max(
                max(pattern_depth, vote_depth),
                max(median_depth, waiting_depth),
            ),
            padding: max(support.x_px as usize, median_x),
            colour: parameters.colour && !config.format.is_grey(),
            aligned: parameters.aligns_lines(),
            // Without a line below or a pixel beside it in the support, there is nothing to see.
            smoothing_step: if parameters.smoothing_step > 0 && support.x_px > 0 && support.y_px > 0
            {
                Some(parameters.smoothing_step)
            } else {
                None
            },
        }
    }

    const fn sampler(&self, config: &Config) -> SamplerSize {
        SamplerSize {
            reference_depth: if self.colour {
                self.pattern_depth
            } else {
                self.depth
            },
            reference_padding: if self.colour {
                config.parameters.support.x_px as usize
            } else {
                self.padding
            },
            other_moving: self.aligned,
            smoothing_step: self.smoothing_step,
        }
    }

    /// The reference view's channels, as deep as the refinement looks back.
    const fn reference(&self, config: &Config) -> ChannelsSize {
        ChannelsSize {
            count: self.channels(),
            width: self.width,
            padding: self.padding,
            depth: self.depth,
            format: config.format,
            moving: false,
        }
    }

    const fn other(&self, config: &Config) -> ChannelsSize {
        ChannelsSize {
            padding: 0,
            depth: config.parameters.support.y_px as usize + 1,
            moving: self.aligned,
            ..self.reference(config)
        }
    }

    /// Without the strips where the sampler has them.
    const fn beside_sampler(&self, size: ChannelsSize) -> ChannelsSize {
        ChannelsSize {
            count: if self.colour { MAX_CHANNELS } else { 0 },
            ..size
        }
    }

    const fn channels(&self) -> usize {
        if self.colour { MAX_CHANNELS } else { 1 }
    }

    /// Bytes of one of the two rows of levels of the other view, all channels.
    const fn level_bytes(&self, parameters: &Aggregation) -> usize {
        if parameters.difference_weight_q4 > 0 {
            self.channels() * self.positions
        } else {
            0
        }
    }

    /// Bytes of [`CostInputs`].
    const fn cost_input_bytes(&self, config: &Config, parameters: &Aggregation) -> usize {
        let synapses = config.parameters.synapses as usize;
        2 * self.level_bytes(parameters)
            + PatternRow::bytes(self.width, synapses)
            + PatternRow::bytes(self.positions, synapses)
            + SurfaceMasks::scratch_bytes(config, parameters)
    }

    /// Bytes that the path costs from the right share with [`CostInputs`].
    const fn right_path_bytes(&self, config: &Config, parameters: &Aggregation) -> usize {
        let path_bytes = self.width * self.stride;
        max(path_bytes, self.cost_input_bytes(config, parameters))
    }

    /// Position of the last pixel's lowest disparity.
    const fn last_position(&self, config: &Config) -> usize {
        self.front
            .saturating_add_signed(config.disparities.minimum_px as isize)
    }
}

/// What the costs of a row are computed from.
#[derive(Debug)]
struct CostInputs<'s> {
    /// Levels of the other view by stored position, channel by channel, less the dead zone.
    low: &'s mut [u8],
    /// The same, more the dead zone.
    high: &'s mut [u8],
    /// Patterns of the reference view.
    own: PatternRow<'s>,
    /// Patterns of the other view, by stored position.
    stored: PatternRow<'s>,
    /// Scratch of the masks.
    cells: &'s mut [u8],
}

impl<'s> CostInputs<'s> {
    /// In scratch of [`Sizes::cost_input_bytes`], whatever it holds.
    fn over(
        scratch: &'s mut [u8],
        sizes: &Sizes,
        config: &Config,
        parameters: &Aggregation,
    ) -> Self {
        let synapses = usize::from(config.parameters.synapses);
        let mut rest = scratch;
        let mut part = |bytes: usize| rest.split_off_mut(..bytes).unwrap_or_default();
        let level_bytes = sizes.level_bytes(parameters);
        let mut patterns =
            |width| PatternRow::over(part(PatternRow::bytes(width, synapses)), width, synapses);
        let (own, stored) = (patterns(sizes.width), patterns(sizes.positions));
        Self {
            own,
            stored,
            low: part(level_bytes),
            high: part(level_bytes),
            cells: rest,
        }
    }
}

/// Orders in which the reference view and the other are stored: rising disparities must be
/// rising positions, so that the views run against each other.
const fn orders(reference: Reference) -> [Order; 2] {
    match reference {
        Reference::Left => [Order::Columns, Order::Mirrored],
        Reference::Right => [Order::Mirrored, Order::Columns],
    }
}

const fn max(a: usize, b: usize) -> usize {
    if a > b { a } else { b }
}

impl SurfaceMatcher<'_, ()> {
    /// Words of memory; the largest parts are three bytes per pixel of a line and
    /// disparity, the number of disparities rounded up to 16.
    #[must_use]
    pub const fn memory_words(config: &Config, parameters: &Aggregation) -> usize {
        let sizes = Sizes::new(config, parameters);
        let synapses = config.parameters.synapses as usize;
        let width = sizes.width;
        Sampler::memory_words(config, sizes.sampler(config))
            + ChannelStrips::memory_words(sizes.beside_sampler(sizes.reference(config)))
            + ChannelStrips::memory_words(sizes.beside_sampler(sizes.other(config)))
            + SurfaceMasks::memory_words(config, parameters)
            + words(synapses + 1, size_of::<u16>())
            + 2 * words(width * sizes.stride, 1)
            + words(sizes.right_path_bytes(config, parameters), 1)
            + 2 * words(width, 1)
            + words(path_scratch_bytes(sizes.stride), 1)
            + words(sizes.stride, size_of::<i16>())
            + words(width + sizes.stride, size_of::<u32>())
            + 4 * words(width, size_of::<i16>())
            + words(width, 1)
    }
}

impl<'m> SurfaceMatcher<'m, ()> {
    /// Words of memory for [`SurfaceMatcher::reference_channels`].
    #[must_use]
    pub const fn reference_channels_words(config: &Config, parameters: &Aggregation) -> usize {
        ChannelStrips::memory_words(Sizes::new(config, parameters).reference(config))
    }

    /// Strips like those of [`SurfaceMatcher::channels`], for a refinement that runs apart
    /// from the matcher and is given the reference view's lines itself.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena is too small.
    pub fn reference_channels(
        config: &Config,
        parameters: &Aggregation,
        arena: &mut Arena<'m>,
    ) -> Result<ChannelStrips<'m>, OutOfMemory> {
        let size = Sizes::new(config, parameters).reference(config);
        ChannelStrips::new(size, orders(config.reference)[0], arena)
    }
}

impl<'m, K: Kernels> SurfaceMatcher<'m, K> {
    /// Draws the synapses and carves the memory.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena is too small.
    pub fn new(
        config: &Config,
        parameters: &Aggregation,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        let mut matcher = Self::with_masks(config, parameters, kernels, None, arena)?;
        let synapses = matcher.synapses();
        matcher.masks = SurfaceMasks::new(config, parameters, synapses, kernels, arena)?;
        Ok(matcher)
    }
}

impl<'m, K: Kernels, M: RowMasks> SurfaceMatcher<'m, K, M> {
    /// The same as `new`, but with masks from elsewhere, for which no memory but their scratch
    /// is taken; `None` where every cell counts.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena is too small.
    pub fn with_masks(
        config: &Config,
        parameters: &Aggregation,
        kernels: K,
        masks: Option<M>,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        config.validate()?;
        let sizes = Sizes::new(config, parameters);
        let synapses = usize::from(config.parameters.synapses);
        let width = sizes.width;
        let [order, other_order] = orders(config.reference);
        let sampler = Sampler::new(config, sizes.sampler(config), [order, other_order], arena)?;
        let reference = sizes.beside_sampler(sizes.reference(config));
        let reference = ChannelStrips::new(reference, order, arena)?;
        let other = sizes.beside_sampler(sizes.other(config));
        let other = ChannelStrips::new(other, other_order, arena)?;
        Ok(Self {
            kernels,
            sampler,
            reference,
            other,
            exposure: Exposure::new(),
            alignment: Alignment::new(parameters.line_offset_max_q4, config.parameters.support),
            masks,
            cell_costs_q8: cell_costs(parameters, arena.take(synapses + 1)?),
            costs: arena.take(width * sizes.stride)?,
            from_right: arena.take(sizes.right_path_bytes(config, parameters))?,
            from_above: arena.take(width * sizes.stride)?,
            p2_along: arena.take(width)?,
            p2_down: arena.take(width)?,
            paths: arena.take(path_scratch_bytes(sizes.stride))?,
            sums: arena.take(sizes.stride)?,
            other_best: arena.take(width + sizes.stride)?,
            best: arena.take(width)?,
            refined_q4: arena.take(width)?,
            margins: arena.take(width)?,
            found_q4: arena.take(width)?,
            confidences: arena.take(width)?,
            parameters: *parameters,
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
        self.exposure = Exposure::new();
        self.alignment.reset();
        self.reference.clear();
        self.other.clear();
    }

    /// Lines of the frame whose rows are done, those outside the region too.
    pub(crate) fn rows_out(&self) -> u32 {
        self.sampler.rows_out()
    }

    /// Takes the next pair of lines, in the configured pixel format. When this completes
    /// a row inside the region of interest, gives its line in the frame; the row is then
    /// [`SurfaceMatcher::found_q4`].
    pub fn push(&mut self, left: &[u8], right: &[u8]) -> Option<u32> {
        let (reference, other) = in_roles(self.config.reference, left, right);
        let reference = self.reference.push(reference, &self.kernels);
        let offset_q4 = self.alignment.offset_q4();
        let other = self.other.push_moved(other, offset_q4, &self.kernels);
        self.sampler
            .push_roles(reference, other, offset_q4, &self.kernels);
        let line = self.sampler.next_row(false)?;
        self.match_row(line);
        Some(line)
    }

    /// After the last pair: gives the next of the rows still to come inside the region,
    /// `None` when there are no more.
    pub fn flush(&mut self) -> Option<u32> {
        let line = self.sampler.next_row(true)?;
        self.match_row(line);
        Some(line)
    }

    /// The row last completed, of the whole width; see [`RowCheck::write`].
    #[must_use]
    pub fn found_q4(&self) -> &[i16] {
        self.found_q4
    }

    /// Confidences of the row last completed: 1 to 255, 0 where rejected or in doubt.
    #[must_use]
    pub fn confidences(&self) -> &[u8] {
        self.confidences
    }

    /// The reference view's channels, for what follows.
    #[must_use]
    pub fn channels(&self) -> &[Strip<'m>] {
        channels_of(&self.reference, &self.sampler.reference)
    }

    fn match_row(&mut self, line: u32) {
        let is_first = line == self.config.region.y;
        let sizes = Sizes::new(&self.config, &self.parameters);
        if is_first && self.parameters.difference_weight_q4 > 0 {
            self.rehearse(line, &sizes);
        }
        self.match_levels_and_patterns(line, is_first, &sizes);
        self.check(line, &sizes);
    }

    /// Matches the first line by its patterns alone, no exposure being known, for one to
    /// match it in: its matches tell the conversion, and then how far levels still differ.
    fn rehearse(&mut self, line: u32, sizes: &Sizes) {
        self.match_levels_and_patterns(line, true, sizes);
        self.check(line, sizes);
        self.check(line, sizes);
    }

    fn match_levels_and_patterns(&mut self, line: u32, is_first: bool, sizes: &Sizes) {
        let scratch = core::mem::take(&mut self.from_right);
        let mut inputs = CostInputs::over(scratch, sizes, &self.config, &self.parameters);
        self.observe(line, &mut inputs, sizes);
        self.convert_levels(line, &mut inputs, sizes);
        self.compute_costs(line, inputs, sizes);
        self.from_right = scratch;
        self.aggregate(line, is_first, sizes);
    }

    /// The patterns of both views; those of the other by stored position.
    fn observe(&self, line: u32, inputs: &mut CostInputs<'_>, sizes: &Sizes) {
        let (own, stored) = (&mut inputs.own, &mut inputs.stored);
        let positions = 0..sizes.width;
        self.sampler.observe(
            line,
            (own, positions.clone()),
            (&mut *stored, positions),
            &self.kernels,
        );
        stored.extend(sizes.width, sizes.front, sizes.positions);
    }

    /// The other view's levels in the reference camera's exposure, by stored position.
    fn convert_levels(&self, line: u32, inputs: &mut CostInputs<'_>, sizes: &Sizes) {
        if self.parameters.difference_weight_q4 == 0 {
            return;
        }
        let others = channels_of(&self.other, &self.sampler.other);
        let lows = inputs.low.chunks_exact_mut(sizes.positions.max(1));
        let highs = inputs.high.chunks_exact_mut(sizes.positions.max(1));
        for ((channel, (low, high)), other) in lows.zip(highs).enumerate().zip(others) {
            let levels = other.row(line);
            let inside = sizes.front..sizes.front + sizes.width;
            if let (Some(low), Some(high)) =
                (low.get_mut(inside.clone()), high.get_mut(inside.clone()))
            {
                let conversion = self.exposure.conversion(channel);
                self.kernels.convert_row(&conversion, levels, low, high);
            }
            for row in [low, high] {
                extend_run(row, inside.clone());
            }
        }
    }

    /// Run by run: the masks, if there are any, then the costs.
    fn compute_costs(&mut self, line: u32, inputs: CostInputs<'_>, sizes: &Sizes) {
        let parameters = &self.parameters;
        let synapses = self.config.parameters.synapses;
        let channels = channels_of(&self.reference, &self.sampler.reference);
        let levels = rows_of(channels, line);
        if let Some(masks) = &mut self.masks {
            masks.begin(channels, line);
        }
        let cost_of = |count: u16| self.cell_costs_q8.get(usize::from(count)).copied();
        let mut cell_costs_q8 = [cost_of(synapses).unwrap_or(0); RUN_LANES];
        let longest = match self.masks {
            Some(_) => MASK_LANES,
            None => RUN_LANES,
        };
        for start in (0..sizes.width).step_by(longest) {
            let lanes = longest.min(sizes.width - start);
            let first = block_first(start, sizes.width);
            let skipped = start - first;
            let mut masks = Planes::NONE;
            if let Some(source) = &mut self.masks {
                let block = source.block(channels, first, inputs.cells);
                let counts = block.counts.iter().skip(skipped);
                for (cost, &count) in cell_costs_q8.iter_mut().zip(counts) {
                    *cost = cost_of(count).unwrap_or(0);
                }
                masks = Planes {
                    bytes: block.masks.get(skipped..).unwrap_or_default(),
                    stride: MASK_LANES.min(sizes.width),
                    count: usize::from(synapses) / CELLS_PER_BYTE,
                };
            }
            let run = CostRun {
                start,
                inputs: inputs.own.planes(),
                masks,
                cell_costs_q8: cell_costs_q8.get(..lanes).unwrap_or_default(),
                stored: inputs.stored.planes(),
                first_position: sizes.last_position(&self.config) + sizes.width - 1 - start,
                disparities: self.config.disparities.count.into(),
                hamming_truncation: parameters.hamming_truncation,
                levels,
                other_low: planes_of(inputs.low, sizes.positions),
                other_high: planes_of(inputs.high, sizes.positions),
                channels: sizes.channels(),
                difference_truncation: parameters.difference_truncation,
                difference_weight_q4: parameters.difference_weight_q4,
            };
            if let Some(costs) = self
                .costs
                .get_mut(start * sizes.stride..(start + lanes) * sizes.stride)
            {
                self.kernels.cost_run(&run, costs);
            }
        }
    }

    fn aggregate(&mut self, line: u32, is_first: bool, sizes: &Sizes) {
        let parameters = &self.parameters;
        let grey = self.sampler.reference.row(line);
        let above = self.sampler.reference.row(line.saturating_sub(1));
        if let Some((first, after)) = self.p2_along.split_first_mut() {
            *first = parameters.p2;
            write_penalties(parameters, grey.get(1..).unwrap_or_default(), grey, after);
        }
        write_penalties(parameters, grey, above, self.p2_down);
        self.kernels.aggregate_row(&mut AggregateRow {
            costs: self.costs,
            from_right: self
                .from_right
                .get_mut(..sizes.width * sizes.stride)
                .unwrap_or_default(),
            from_above: self.from_above,
            stride: sizes.stride,
            disparities: self.config.disparities.count.into(),
            is_first,
            p1: parameters.p1,
            p2_along: self.p2_along,
            p2_down: self.p2_down,
            paths: self.paths,
            sums: self.sums,
            other_best: self.other_best,
            best: self.best,
            refined_q4: self.refined_q4,
            margins: self.margins,
        });
    }

    /// Rejects what does not hold, and learns the exposure from what does.
    fn check(&mut self, line: u32, sizes: &Sizes) {
        let reach = usize::from(self.config.parameters.support.x_px);
        let grey = &self.sampler.reference;
        let check = RowCheck {
            best: self.best,
            refined_q4: self.refined_q4,
            margins: self.margins,
            other_best: self.other_best,
            minimum_px: self.config.disparities.minimum_px,
            tolerance_px: self.parameters.left_right_tolerance_px,
            margin: self.parameters.margin,
            // The padding of the strip is at least the support.
            grey: grey.run(line, -(reach as isize), sizes.width + 2 * reach),
            reach,
            texture_min: self.parameters.texture_min,
        };
        check.write(self.found_q4, self.confidences);
        if self.parameters.difference_weight_q4 == 0 {
            return;
        }
        // The lines above and below tell the gradient.
        if sizes.aligned && line > 0 && line + 1 < self.sampler.other.lines() {
            let other = &self.sampler.other;
            let rows = GreyRows {
                own: self.sampler.reference.row(line),
                others: [line - 1, line, line + 1].map(|line| other.row(line)),
            };
            // Green, where there is colour, is most of grey.
            let conversion = self.exposure.conversion(sizes.channels() / 2);
            // Every fourth pixel tells enough of that.
            let matches = matches_of::<4>(&check, self.confidences);
            let matches = matches.map(|(position, other_position)| {
                let at = |values: &[i16]| values.get(position).copied().unwrap_or(0);
                let best = check.best.get(position).copied().unwrap_or(0);
                Match {
                    position,
                    other_position,
                    // Within half a disparity.
                    beyond_q4: at(check.refined_q4) - best as i16 * STEPS_PER_PX,
                }
            });
            if conversion.is_known() {
                self.alignment.learn(matches, rows, &conversion);
            }
        }
        let levels = rows_of(channels_of(&self.reference, &self.sampler.reference), line);
        let others = rows_of(channels_of(&self.other, &self.sampler.other), line);
        // Every other pixel tells enough.
        let matches = matches_of::<2>(&check, self.confidences);
        if sizes.channels() == 1 {
            self.exposure.learn::<1>(matches, levels, others);
        } else {
            self.exposure.learn::<MAX_CHANNELS>(matches, levels, others);
        }
    }
}

/// The matches that hold of every `STEP`th pixel: its position and that in the other view.
fn matches_of<const STEP: usize>(
    check: &RowCheck<'_>,
    confidences: &[u8],
) -> impl Iterator<Item = (usize, usize)> {
    let pixels = confidences.chunks(STEP).zip(check.best.chunks(STEP));
    let pixels = (0..).step_by(STEP).zip(pixels);
    pixels.filter_map(|(x, (confidences, best))| {
        let (&confidence, &best) = confidences.first().zip(best.first())?;
        let position = check.position(x, best).filter(|_| confidence > 0)?;
        Some((x, position))
    })
}

/// Writes the penalties of larger steps between levels and their neighbours.
fn write_penalties(parameters: &Aggregation, own: &[u8], neighbours: &[u8], p2: &mut [u8]) {
    let (most, floor) = (i16::from(parameters.p2), i16::from(parameters.p2_floor));
    let adaptation_q4 = u16::from(parameters.p2_adaptation_q4);
    for ((p2, &own), &neighbour) in p2.iter_mut().zip(own).zip(neighbours) {
        // At most 255 * 255 / 16.
        let fall = (adaptation_q4 * u16::from(own.abs_diff(neighbour))) >> 4;
        *p2 = (most - fall as i16).max(floor) as u8;
    }
}

/// Fills the table of costs by count; so that there is no division per pixel.
fn cell_costs<'m>(parameters: &Aggregation, costs_q8: &'m mut [u16]) -> &'m mut [u16] {
    let scale_q8 = u32::from(parameters.hamming_scale) << 8;
    for (cost, count) in costs_q8.iter_mut().zip(0_u32..).skip(1) {
        // The scale is bounded so that times the count this fits 16 bits.
        *cost = ((scale_q8 + count / 2) / count) as u16;
    }
    costs_q8
}

/// A view's channels: red, green and blue, or grey alone, which the sampler has.
fn channels_of<'a, 'm>(channels: &'a ChannelStrips<'m>, grey: &'a Strip<'m>) -> &'a [Strip<'m>] {
    match channels.strips() {
        [] => core::slice::from_ref(grey),
        strips => strips,
    }
}

/// A line of each channel; empty where there is no channel.
fn rows_of<'a>(channels: &'a [Strip<'_>], line: u32) -> [&'a [u8]; MAX_CHANNELS] {
    core::array::from_fn(|index| {
        channels
            .get(index)
            .map_or(&[][..], |channel| channel.row(line))
    })
}

/// A row's planes, one per channel; empty where there is none.
fn planes_of(row: &[u8], length: usize) -> [&[u8]; MAX_CHANNELS] {
    core::array::from_fn(|index| {
        row.get(index * length..(index + 1) * length)
            .unwrap_or_default()
    })
}

/// The first and last value of a run repeated to the ends of the row.
fn extend_run(row: &mut [u8], inside: core::ops::Range<usize>) {
    let (before, rest) = row.split_at_mut(inside.start.min(row.len()));
    let (inside, after) = rest.split_at_mut(inside.len().min(rest.len()));
    if let (Some(&first), Some(&last)) = (inside.first(), inside.last()) {
        before.fill(first);
        after.fill(last);
    }
}
