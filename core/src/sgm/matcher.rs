//! The streaming matcher of the SGM method: takes lines of both views, returns rows of checked
//! disparities.

use core::ops::Range;

use super::alignment::{Alignment, GreyRows, Match};
use super::check::RowCheck;
use super::evidence::{self, Evidence};
use super::exposure::Exposure;
use super::line_gain::LineGain;
use super::masks::{RowMasks, SgmMasks, block_first};
use super::plan::SgmPlan;
use super::rivals::Rivals;
use crate::config::{Config, ConfigError, SgmParameters, Support};
use crate::disparity::{DisparityRange, Reference, STEPS_PER_PX};
use crate::kernel::{
    AggregateRow, CELLS_PER_BYTE, CostRun, Kernels, LevelConversion, MASK_LANES, MAX_CHANNELS,
    Penalty, Planes, cost_stride, path_scratch_bytes,
};
use crate::pattern::{PatternRow, Sampler, Synapses};
use crate::rows::{Arena, Line, LineOffsets, NewestRows, Order, Strip, ViewPair, extend_run};

/// Largest number of pixels of a run of costs without masks.
const RUN_LANES: usize = evidence::MAX_LANES;

/// Noise at which differences of levels count half, levels.
const NOISE_HALVING: u16 = 8;

/// Takes pairs of lines and returns one row of checked disparities for each, `support.y_px` lines
/// later, in the order in which the reference view is stored.
#[derive(Debug)]
pub struct SgmMatcher<'m, K, M = SgmMasks<'m, K>> {
    kernels: K,
    sampler: Sampler<'m>,
    views: ViewPair<'m>,
    exposure: Exposure,
    alignment: Alignment,
    line_gain: LineGain,
    /// Source of masks; `None` if every cell counts.
    masks: Option<M>,
    /// Cost of one differing cell, 1/256 of a cost, by the number of unmasked cells.
    cell_costs_q8: &'m mut [u16],
    costs: &'m mut [u8],
    /// Path costs from the right; before they are computed, [`CostInputs`].
    from_right: &'m mut [u8],
    from_above: &'m mut [u8],
    p2_along: &'m mut [u8],
    p2_down: &'m mut [u8],
    paths: &'m mut [u8],
    sums: &'m mut [i16],
    other_best: &'m mut [u32],
    best: &'m mut [u16],
    refined_index_q4: &'m mut [i16],
    margins: &'m mut [i16],
    found: &'m mut [i16],
    confidences: &'m mut [u8],
    rivals: Option<Rivals<'m>>,
    parameters: SgmParameters,
    synapses: u16,
    support: Support,
    disparities: DisparityRange,
    reference: Reference,
    /// The first line of the region.
    first_line: u32,
    plan: SgmPlan,
}

/// Inputs of the matching costs of a row.
#[derive(Debug)]
struct CostInputs<'s> {
    /// Lowest levels of the reference view that equal those of the other view, by stored
    /// position, channel by channel.
    low: &'s mut [u8],
    /// Highest levels of the reference view that equal those of the other view, likewise.
    high: &'s mut [u8],
    /// Patterns of the reference view.
    own: PatternRow<'s>,
    /// Patterns of the other view, by stored position.
    stored: PatternRow<'s>,
    /// Scratch of the masks.
    cells: &'s mut [u8],
}

impl<'s> CostInputs<'s> {
    /// Places the inputs in `scratch`, of [`SgmPlan::right_path_bytes`] and any content.
    fn over(scratch: &'s mut [u8], plan: &SgmPlan, synapses: u16) -> Self {
        let synapses = usize::from(synapses);
        let mut rest = scratch;
        let mut part = |bytes: usize| rest.split_off_mut(..bytes).unwrap_or_default();
        let mut patterns =
            |width| PatternRow::over(part(PatternRow::bytes(width, synapses)), width, synapses);
        let (own, stored) = (patterns(plan.width), patterns(plan.positions));
        Self {
            own,
            stored,
            low: part(plan.level_bytes),
            high: part(plan.level_bytes),
            cells: rest,
        }
    }
}

impl<'m, K: Kernels> SgmMatcher<'m, K> {
    /// Words of memory; the largest parts are three bytes per pixel of a line and disparity, the
    /// number of disparities rounded up to 16.
    #[must_use]
    pub const fn words(config: &Config, sgm: &SgmParameters) -> usize {
        SgmPlan::new(config, sgm).parts(config, sgm).words()
    }

    /// Draws the synapses and carves the memory.
    ///
    /// # Errors
    /// [`ConfigError`] when `config` is not valid or the arena has fewer than
    /// [`SgmMatcher::words`] left.
    pub fn new(
        config: &Config,
        sgm: &SgmParameters,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        let mut matcher = Self::with_masks(config, sgm, kernels, None, arena)?;
        let synapses = matcher.synapses();
        matcher.masks = SgmMasks::new(config, sgm, synapses, kernels, arena)?;
        Ok(matcher)
    }
}

impl<'m, K: Kernels, M: RowMasks> SgmMatcher<'m, K, M> {
    /// Builds a matcher with another source of masks; `None` if every cell counts. It takes
    /// [`SgmMatcher::words`] less [`SgmMasks::words`].
    ///
    /// # Errors
    /// [`ConfigError`] if `config` is not valid or the arena is too small.
    pub fn with_masks(
        config: &Config,
        sgm: &SgmParameters,
        kernels: K,
        masks: Option<M>,
        arena: &mut Arena<'m>,
    ) -> Result<Self, ConfigError> {
        config.validate_for::<K>()?;
        let plan = SgmPlan::new(config, sgm);
        let synapses = usize::from(config.parameters.synapses);
        let (width, stride) = (plan.width, plan.stride);
        let lines_ahead = SgmPlan::lines_ahead(config, sgm);
        Ok(Self {
            kernels,
            sampler: Sampler::new::<K>(config, lines_ahead, arena)?,
            views: ViewPair::new(
                config.reference,
                [plan.reference, plan.other],
                SgmPlan::orders(config.reference),
                arena,
            )?,
            exposure: Exposure::new(),
            alignment: Alignment::new(
                width,
                sgm.moving_lines(),
                lines_ahead,
                stored(config.line_offsets, width, config.reference),
            ),
            line_gain: LineGain::new(sgm.line_gain_max_q8, config.disparities),
            masks,
            cell_costs_q8: cell_costs(sgm, arena.take(synapses + 1)?),
            costs: arena.take(width * stride)?,
            from_right: arena.take(plan.right_path_bytes)?,
            from_above: arena.take(width * stride)?,
            p2_along: arena.take(width)?,
            p2_down: arena.take(width)?,
            paths: arena.take(path_scratch_bytes(stride))?,
            sums: arena.take(stride)?,
            other_best: arena.take(width + stride)?,
            best: arena.take(width)?,
            refined_index_q4: arena.take(width)?,
            margins: arena.take(width)?,
            found: arena.take(width)?,
            confidences: arena.take(width)?,
            rivals: match sgm.rivals {
                Some(_) => Some(Rivals::new(width, arena)?),
                None => None,
            },
            parameters: *sgm,
            synapses: config.parameters.synapses,
            support: config.parameters.support,
            disparities: config.disparities,
            reference: config.reference,
            first_line: config.region.y,
            plan,
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
        self.exposure = Exposure::new();
        self.alignment.reset();
        self.line_gain.reset();
        self.views.clear();
    }

    /// What the last whole frame taught of the offsets of lines, or else what frames begin with.
    #[must_use]
    pub fn line_offsets(&self) -> LineOffsets {
        let learned = self.alignment.learned();
        stored(learned, self.plan.width, self.reference)
    }

    /// Lets frames begin with these offsets, after a reset.
    pub(crate) fn set_line_offsets(&mut self, offsets: LineOffsets) {
        let offsets = stored(offsets, self.plan.width, self.reference);
        self.alignment.begin_with(offsets);
    }

    /// Takes what the frame taught, whose rows are all done.
    pub fn end_frame(&mut self) {
        self.alignment.end_frame();
    }

    /// Takes the checks of these parameters, which differ in nothing else.
    pub(crate) fn set_checks(&mut self, sgm: &SgmParameters) {
        self.parameters = *sgm;
    }

    /// Number of lines of the frame whose rows are done, those outside the region included.
    pub(crate) fn rows_out(&self) -> u32 {
        self.sampler.rows_out()
    }

    /// Takes the next pair of lines, of the configured width. If this completes a row inside the
    /// region of interest, returns its line in the frame; the row is then [`SgmMatcher::found`].
    pub fn push(
        &mut self,
        left: &(impl Line + ?Sized),
        right: &(impl Line + ?Sized),
    ) -> Option<u32> {
        let offsets = self.alignment.offsets(self.views.lines());
        self.views.set_smoothing_step(self.smoothing_step());
        let exposure = self.grey_exposure();
        let line_gain = &mut self.line_gain;
        let conversion = |rows: NewestRows<'_>| line_gain.conversion(&rows, exposure.gain_q12);
        self.views
            .push_mended(left, right, offsets, conversion, &self.kernels);
        self.match_next(false)
    }

    /// Number of synapses, which the compiler knows if the scope has only one.
    fn synapse_count(&self) -> u16 {
        K::SCOPE.synapses.unwrap_or(self.synapses)
    }

    /// Number of disparities, which the compiler knows if the scope has only one.
    fn disparity_count(&self) -> usize {
        K::SCOPE
            .disparities
            .unwrap_or(self.disparities.count)
            .into()
    }

    /// Number of channels of a view, which the compiler knows if the scope has no colour.
    fn channel_count(&self) -> usize {
        K::SCOPE.channels(self.plan.reference.channels())
    }

    /// The exposure of green, which is the largest part of grey; without colour, that of grey.
    fn grey_exposure(&self) -> LevelConversion {
        self.exposure.conversion(self.channel_count() / 2)
    }

    /// By how much matched levels differ more than where there is hardly any noise, levels.
    fn noise(&self) -> u8 {
        self.exposure.noise(self.parameters.usual_difference_max)
    }

    /// The largest step that is smoothed: the more noise, the larger.
    fn smoothing_step(&self) -> u8 {
        let step = self.parameters.smoothing_step;
        step.saturating_add(self.noise().saturating_mul(4))
    }

    /// What a difference of one level costs, 1/16: the more noise, the less, in steps of 1/2 down to
    /// 1/2, as kernels take halves.
    fn difference_weight_q4(&self) -> u8 {
        let weight_q4 = self.parameters.difference_weight_q4;
        let noise = u16::from(self.noise());
        if noise == 0 {
            return weight_q4;
        }
        let reduced_q4 = u16::from(weight_q4) * NOISE_HALVING / (NOISE_HALVING + noise);
        let rounded_q4 = ((reduced_q4 + 4) & !7).clamp(8, 248) as u8;
        rounded_q4.min(weight_q4)
    }

    /// The largest step of the image that noise alone may make, levels.
    fn noise_step(&self) -> u8 {
        (u16::from(self.noise()) * 3 / 2).min(255) as u8
    }

    /// Completes the next row inside the region after the last pair and returns its line, or `None`
    /// if there are no more.
    pub fn flush(&mut self) -> Option<u32> {
        self.match_next(true)
    }

    /// Matches the next row if its lines have come, or no others will, and returns its line. Apart, so
    /// that it is compiled once, whatever kinds of lines are pushed.
    fn match_next(&mut self, is_last: bool) -> Option<u32> {
        let line = self.sampler.next_row(self.views.lines(), is_last)?;
        self.match_row(line);
        Some(line)
    }

    /// The row last completed, of the whole width; see [`RowCheck::write`].
    #[must_use]
    pub fn found(&self) -> &[i16] {
        self.found
    }

    /// Confidences of the row last completed: 1 to 255; 0 where rejected or in doubt.
    #[must_use]
    pub fn confidences(&self) -> &[u8] {
        self.confidences
    }

    /// Positions of the row last completed that the reference camera saw, and of the other view's row
    /// that the other camera saw, each in the stored order of its view.
    #[must_use]
    pub fn valid(&self) -> [Range<usize>; 2] {
        let line = self.rows_out().saturating_sub(1);
        [&self.views.reference, &self.views.other].map(|view| view.valid(line))
    }

    /// Channels of the reference view, for the refinement.
    #[must_use]
    pub fn channels(&self) -> &[Strip<'m>] {
        self.views.reference.channels()
    }

    fn match_row(&mut self, line: u32) {
        let is_first = line == self.first_line;
        if is_first && self.parameters.difference_weight_q4 > 0 {
            self.bootstrap_exposure(line);
        }
        self.match_levels_and_patterns(line, is_first);
        self.check(line);
        // Last, so that exposure and alignment are learned from these pixels as well.
        if let Some(rivals) = &self.rivals {
            rivals.fill(self.confidences, 0);
        }
    }

    /// Matches the first row by its patterns alone, because the exposure is not known yet. From its
    /// matches follow first the conversion of levels, then the difference that remains.
    fn bootstrap_exposure(&mut self, line: u32) {
        self.match_levels_and_patterns(line, true);
        self.check(line);
        self.check(line);
    }

    /// Computes the costs of a row, aggregates them and selects.
    fn match_levels_and_patterns(&mut self, line: u32, is_first: bool) {
        let scratch = core::mem::take(&mut self.from_right);
        let synapses = self.synapse_count();
        let mut inputs = CostInputs::over(scratch, &self.plan, synapses);
        self.observe(line, &mut inputs);
        self.convert_levels(line, &mut inputs);
        self.compute_costs(line, inputs);
        self.from_right = scratch;
        let disparities = self.disparity_count();
        if let (Some(rivals), Some(parameters)) = (&mut self.rivals, &self.parameters.rivals) {
            if is_first {
                rivals.reset();
            }
            // The aggregation writes its other view's best anew.
            let scratch = &mut *self.other_best;
            let stride = cost_stride(disparities);
            let kernels = &self.kernels;
            rivals.observe(
                self.costs,
                stride,
                disparities,
                scratch,
                parameters,
                kernels,
            );
            rivals.attenuate(self.costs, stride, disparities, parameters, kernels);
        }
        self.aggregate(line, is_first);
    }

    /// Forms the patterns of both views, those of the other by stored position.
    fn observe(&self, line: u32, inputs: &mut CostInputs<'_>) {
        let plan = &self.plan;
        for (view, patterns) in [
            (&self.views.reference, &mut inputs.own),
            (&self.views.other, &mut inputs.stored),
        ] {
            let positions = 0..plan.width;
            self.sampler
                .observe(view, line, positions, patterns, &self.kernels);
        }
        inputs.stored.extend(plan.width, plan.front, plan.positions);
    }

    /// Converts the levels of the other view to the reference camera's exposure, by stored
    /// position.
    fn convert_levels(&self, line: u32, inputs: &mut CostInputs<'_>) {
        if self.parameters.difference_weight_q4 == 0 {
            return;
        }
        let plan = &self.plan;
        let (mut lows, mut highs) = (&mut *inputs.low, &mut *inputs.high);
        for (channel, other) in self.views.other.channels().iter().enumerate() {
            let length = ..plan.positions;
            let (Some(low), Some(high)) = (lows.split_off_mut(length), highs.split_off_mut(length))
            else {
                return;
            };
            let levels = other.row(line);
            let inside = plan.front..plan.front + plan.width;
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

    /// Computes the matching costs run by run: first the masks, if there are any, then the costs.
    fn compute_costs(&mut self, line: u32, inputs: CostInputs<'_>) {
        let difference_weight_q4 = self.difference_weight_q4();
        let channel_count = self.channel_count();
        let (parameters, plan) = (&self.parameters, &self.plan);
        let synapses = self.synapse_count();
        let planes = usize::from(synapses) / CELLS_PER_BYTE;
        let disparities = self.disparity_count();
        let stride = cost_stride(disparities);
        let channels = self.views.reference.channels();
        let levels = self.views.reference.rows(line);
        if let Some(masks) = &mut self.masks
            && K::SCOPE.masks
        {
            masks.begin(channels, line);
        }
        let cost_of = |count: u16| self.cell_costs_q8.get(usize::from(count)).copied();
        let mut cell_costs_q8 = [cost_of(synapses).unwrap_or(0); RUN_LANES];
        let mut evidence = Evidence::new(parameters);
        let mut truncations = [parameters.hamming_truncation; RUN_LANES];
        let longest = match self.masks {
            Some(_) if K::SCOPE.masks => MASK_LANES,
            _ => RUN_LANES,
        };
        for start in (0..plan.width).step_by(longest) {
            let lanes = longest.min(plan.width - start);
            let first = block_first(start, plan.width);
            let skipped = start - first;
            let mut masks = Planes::NONE;
            if let Some(source) = &mut self.masks
                && K::SCOPE.masks
            {
                let block = source.block(channels, first, inputs.cells);
                let counts = block.counts.iter().skip(skipped);
                for (cost, &count) in cell_costs_q8.iter_mut().zip(counts) {
                    *cost = cost_of(count).unwrap_or(0);
                }
                masks = Planes {
                    bytes: block.masks.get(skipped..).unwrap_or_default(),
                    stride: MASK_LANES.min(plan.width),
                    count: planes,
                };
            }
            let cell_costs_q8 = cell_costs_q8.get(..lanes).unwrap_or_default();
            if let Some(evidence) = &mut evidence {
                let inputs = (inputs.own.planes(), start);
                evidence.truncate(inputs, masks, cell_costs_q8, &mut truncations);
            }
            let run = CostRun {
                start,
                inputs: Planes {
                    count: planes,
                    ..inputs.own.planes()
                },
                masks,
                cell_costs_q8,
                stored: Planes {
                    count: planes,
                    ..inputs.stored.planes()
                },
                first_position: plan.last_position + plan.width - 1 - start,
                disparities,
                truncations: truncations.get(..lanes).unwrap_or_default(),
                hamming_truncation: parameters.hamming_truncation,
                levels,
                other_low: planes_of(inputs.low, plan.positions),
                other_high: planes_of(inputs.high, plan.positions),
                channels: channel_count,
                difference_truncation: parameters.difference_truncation,
                difference_weight_q4,
            };
            if let Some(costs) = self.costs.get_mut(start * stride..(start + lanes) * stride) {
                self.kernels.cost_run(&run, costs);
            }
        }
    }

    /// Aggregates the costs of a row and selects the best disparities of both views.
    fn aggregate(&mut self, line: u32, is_first: bool) {
        let disparities = self.disparity_count();
        let stride = cost_stride(disparities);
        let (parameters, plan) = (&self.parameters, &self.plan);
        let penalty = Penalty {
            most: parameters.p2,
            floor: parameters.p2_floor,
            adaptation_q4: parameters.p2_adaptation_q4,
            step_min: self.noise_step(),
        };
        let grey = self.views.reference.grey().row(line);
        let above = self.views.reference.grey().row(line.saturating_sub(1));
        if let Some((first, after)) = self.p2_along.split_first_mut() {
            *first = parameters.p2;
            let others = grey.get(1..).unwrap_or_default();
            self.kernels.penalty_row(&penalty, others, grey, after);
        }
        self.kernels
            .penalty_row(&penalty, grey, above, self.p2_down);
        if let (Some(rivals), Some(parameters)) = (&self.rivals, &parameters.rivals)
            && parameters.p2_min > 0
        {
            let p2 = parameters.p2_min.max(penalty.most);
            rivals.fill(self.p2_along, p2);
            rivals.fill(self.p2_down, p2);
        }
        self.kernels.aggregate_row(&mut AggregateRow {
            costs: self.costs,
            from_right: self
                .from_right
                .get_mut(..plan.width * stride)
                .unwrap_or_default(),
            from_above: self.from_above,
            stride,
            disparities,
            is_first,
            p1: parameters.p1,
            subpixel: parameters.subpixel,
            p2_along: self.p2_along,
            p2_down: self.p2_down,
            paths: self.paths,
            sums: self.sums,
            other_best: self.other_best,
            best: self.best,
            refined_index_q4: self.refined_index_q4,
            margins: self.margins,
        });
    }

    /// Checks the row, and learns exposure and alignment from the disparities that hold.
    fn check(&mut self, line: u32) {
        let reach = usize::from(self.support.x_px);
        let grey = self.views.reference.grey();
        let check = RowCheck {
            best: self.best,
            refined_index_q4: self.refined_index_q4,
            margins: self.margins,
            other_best: self.other_best,
            minimum_px: self.disparities.minimum_px,
            tolerance_px: self.parameters.left_right_tolerance_px,
            margin: self.parameters.margin,
            valid: self.views.reference.valid(line),
            other_valid: self.views.other.valid(line),
            // The padding of the strip is at least the support.
            grey: grey.run(line, -(reach as isize), self.plan.width + 2 * reach),
            reach,
            texture_min: self.parameters.texture_min,
        };
        check.write(&self.kernels, self.found, self.confidences);
        if self.parameters.difference_weight_q4 == 0 {
            return;
        }
        // The gradient is taken from the lines above and below.
        let channels = self.channel_count();
        if self.plan.other.moving_lines > 0 && line > 0 && line + 1 < self.views.other.lines() {
            let other = self.views.other.grey();
            let rows = GreyRows {
                own: grey.row(line),
                others: [line - 1, line, line + 1].map(|line| other.row(line)),
            };
            let conversion = self.grey_exposure();
            // Every fourth pixel suffices.
            let matches = check.matches::<4>(self.confidences);
            let matches = matches.map(|(position, other_position)| {
                let at = |values: &[i16]| values.get(position).copied().unwrap_or(0);
                let best = check.best.get(position).copied().unwrap_or(0);
                Match {
                    position,
                    other_position,
                    // The step is at most half a disparity.
                    subpixel_q4: at(check.refined_index_q4) - best as i16 * STEPS_PER_PX,
                }
            });
            if conversion.is_known() {
                self.alignment.learn(line, matches, rows, &conversion);
            }
        }
        let levels = self.views.reference.rows(line);
        let others = self.views.other.rows(line);
        // Every other pixel suffices.
        let matches = check.matches::<2>(self.confidences);
        if channels == 1 {
            self.exposure.learn::<1>(matches, levels, others);
        } else {
            self.exposure.learn::<MAX_CHANNELS>(matches, levels, others);
        }
    }
}

/// Offsets of columns in the order in which the other view stores them, and back.
fn stored(offsets: LineOffsets, width: usize, reference: Reference) -> LineOffsets {
    let [_, other] = SgmPlan::orders(reference);
    match other {
        Order::Columns => offsets,
        Order::Mirrored => offsets.mirrored(width),
    }
}

/// Fills the table of the cost of one cell by the number of unmasked cells, so that there is no
/// division per pixel.
fn cell_costs<'m>(parameters: &SgmParameters, costs_q8: &'m mut [u16]) -> &'m mut [u16] {
    let scale_q8 = u32::from(parameters.hamming_scale) << 8;
    for (cost, count) in costs_q8.iter_mut().zip(0_u32..).skip(1) {
        // The scale is bounded so that the product with the count fits 16 bits.
        *cost = (scale_q8 + count / 2).checked_div(count).unwrap_or(0) as u16;
    }
    costs_q8
}

/// Splits a row into channels of `length` bytes each; empty for channels that do not exist.
fn planes_of(row: &[u8], length: usize) -> [&[u8]; MAX_CHANNELS] {
    core::array::from_fn(|index| {
        row.get(index * length..(index + 1) * length)
            .unwrap_or_default()
    })
}
