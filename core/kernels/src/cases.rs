//! Random tasks for every kernel, for test suites, benches and fuzzers.
//!
//! A case owns all that a kernel reads and writes. Its `random` returns a task within the bounds
//! that the kernel documents; values at the ends of their ranges and equal values are far more
//! frequent than in images. Fields may be changed afterwards, within the same bounds.

use alloc::vec;
use alloc::vec::Vec;
use core::array::from_fn;
use core::fmt::Debug;
use core::num::NonZeroU8;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::disparity::INVALID;
use vgstereo_core::kernel::{
    AggregateRow, ArmsRow, AttenuateRow, CELLS_PER_BYTE, CheckRow, CostRun, Interpolation, Kernels,
    LANES, LevelConversion, MASK_LANES, MAX_CHANNELS, MAX_TAP_ROWS, MaskBlock, NO_COST, Penalty,
    PixelFormat, Planes, RIVAL_BLOCK_PX, ResampleRow, RivalsRow, RowRecall, SubpixelStep, TieBreak,
    WeightedMedianRow, arms_scratch_bytes, cost_stride, path_scratch_bytes,
};

/// A task for one kernel.
pub trait Case: Clone + Debug {
    /// Output of the kernel, without scratch.
    type Output: PartialEq + Debug;

    /// Calls the kernel of a set. A case may be run more than once.
    fn run(&mut self, kernels: impl Kernels);

    /// Returns the output of the last run.
    fn output(&self) -> Self::Output;
}

/// Returns a generator of random numbers.
#[must_use]
pub fn generator(seed: u64) -> Pcg32 {
    Pcg32::seed_from_u64(seed)
}

/// Returns a number below `bound`, which is at least 1.
pub fn below(random: &mut Pcg32, bound: usize) -> usize {
    random.next_u32() as usize % bound
}

/// Returns any byte.
pub fn byte(random: &mut Pcg32) -> u8 {
    random.next_u32() as u8
}

/// Returns levels of a random range, often a narrow one, so that many are equal.
pub fn levels(random: &mut Pcg32, count: usize) -> Vec<u8> {
    let low = below(random, 256);
    let most = [2, 20, 256][below(random, 3)].min(256 - low);
    let levels = 1 + below(random, most);
    levels_below(random, count, levels)
        .into_iter()
        .map(|level| low as u8 + level)
        .collect()
}

/// Returns levels below `bound`, which is 1 to 256.
pub fn levels_below(random: &mut Pcg32, count: usize, bound: usize) -> Vec<u8> {
    (0..count).map(|_| below(random, bound) as u8).collect()
}

/// Returns disparities, 1/16 px: of any value, within 39 of each other, or at the ends of the
/// range. A random share of them, from none to all, is [`INVALID`].
pub fn disparities_q4(random: &mut Pcg32, count: usize) -> Vec<i16> {
    let (kind, low, missing) = (below(random, 3), random.next_u32() as i16, below(random, 5));
    let mut disparity = || match kind {
        _ if below(random, 4) < missing => INVALID,
        0 => random.next_u32() as i16,
        1 => low.wrapping_add(below(random, 40) as i16),
        _ => [INVALID + 1, -1, 0, 1, i16::MAX - 1, i16::MAX][below(random, 6)],
    };
    (0..count).map(|_| disparity()).collect()
}

/// Borrows the rows of up to three channels.
fn channel_rows(rows: &[Vec<u8>]) -> [&[u8]; MAX_CHANNELS] {
    from_fn(|channel| rows.get(channel).map_or(&[][..], Vec::as_slice))
}

/// Returns a row of levels for each channel.
fn channels_of(random: &mut Pcg32, channels: usize, count: usize) -> Vec<Vec<u8>> {
    (0..channels).map(|_| levels(random, count)).collect()
}

/// Owned bit planes of patterns; see [`Planes`].
#[derive(Debug, Clone)]
pub struct OwnPlanes {
    /// Planes one after another, each with [`LANES`] bytes of slack.
    pub bytes: Vec<u8>,
    /// Number of patterns, without the slack.
    pub positions: usize,
    /// Number of planes: bytes per pattern.
    pub count: usize,
}

impl OwnPlanes {
    /// Random patterns of `count` bytes at `positions` positions.
    pub fn random(random: &mut Pcg32, positions: usize, count: usize) -> Self {
        let bytes = (0..count * (positions + LANES)).map(|_| byte(random));
        Self {
            bytes: bytes.collect(),
            positions,
            count,
        }
    }

    /// Patterns like those of [`Self::random`], but often equal, as at times only one or two cells
    /// of each byte vary.
    fn alike(random: &mut Pcg32, positions: usize, count: usize) -> Self {
        let mut planes = Self::random(random, positions, count);
        let cells = [0x01, 0x81, 0xff][below(random, 3)];
        for byte in &mut planes.bytes {
            *byte &= cells;
        }
        planes
    }

    fn planes(&self) -> Planes<'_> {
        Planes {
            bytes: &self.bytes,
            stride: self.positions + LANES,
            count: self.count,
        }
    }
}

/// Task for [`Kernels::luma_row`].
#[derive(Debug, Clone)]
pub struct LumaCase {
    pub format: PixelFormat,
    pub line: Vec<u8>,
    pub grey: Vec<u8>,
}

impl LumaCase {
    /// A line of `pixels` pixels, for an output of `width` pixels.
    pub fn random(random: &mut Pcg32, format: PixelFormat, pixels: usize, width: usize) -> Self {
        Self {
            format,
            line: levels(random, pixels * format.bytes_per_pixel()),
            grey: vec![1; width],
        }
    }
}

impl Case for LumaCase {
    type Output = Vec<u8>;

    fn run(&mut self, kernels: impl Kernels) {
        kernels.luma_row(self.format, &self.line, &mut self.grey);
    }

    fn output(&self) -> Vec<u8> {
        self.grey.clone()
    }
}

/// Task for [`Kernels::channel_row`].
#[derive(Debug, Clone)]
pub struct ChannelCase {
    pub format: PixelFormat,
    pub line: Vec<u8>,
    pub channel: usize,
    pub row: Vec<u8>,
}

impl ChannelCase {
    /// A line of `pixels` pixels, for an output of `width` pixels. In one case in four, the channel
    /// is number 3, which does not exist.
    pub fn random(random: &mut Pcg32, format: PixelFormat, pixels: usize, width: usize) -> Self {
        Self {
            format,
            line: levels(random, pixels * format.bytes_per_pixel()),
            channel: below(random, 1 + MAX_CHANNELS),
            row: vec![1; width],
        }
    }
}

impl Case for ChannelCase {
    type Output = Vec<u8>;

    fn run(&mut self, kernels: impl Kernels) {
        kernels.channel_row(self.format, &self.line, self.channel, &mut self.row);
    }

    fn output(&self) -> Vec<u8> {
        self.row.clone()
    }
}

/// Task for [`Kernels::resample_row`].
#[derive(Debug, Clone)]
pub struct ResampleCase {
    pub levels: Vec<u8>,
    pub starts: Vec<u32>,
    pub first_line: u16,
    pub width: usize,
    pub knots: Vec<[i32; 2]>,
    pub step_shift: u32,
    pub interpolation: Interpolation,
    pub output: Vec<u8>,
}

impl ResampleCase {
    /// A row of `pixels` pixels from `lines` lines of `width` pixels. Most positions lie inside the
    /// lines, and knots of most tasks are as far apart as pixels.
    pub fn random(random: &mut Pcg32, pixels: usize, width: usize, lines: usize) -> Self {
        let step_shift = 2 + below(random, 5) as u32;
        let step = 1 << step_shift;
        let unit = 64 << step_shift;
        let first_line = below(random, 1000);
        let scale = [1, 1, 1, 2][below(random, 4)];
        // Slants of up to half a line per pixel.
        let slant = below(random, 1 + unit as usize) as i32 - unit / 2;
        let mut at = [
            (below(random, width + 8) as i32 - 8) * unit,
            (first_line + below(random, lines + 2)) as i32 * unit - unit,
        ];
        let knots = (0..pixels.div_ceil(step) + 1).map(|_| {
            let knot = at;
            let rough = |random: &mut Pcg32| below(random, 4 * unit as usize) as i32 - 2 * unit;
            at = [
                at[0] + scale * step as i32 * unit + rough(random) / 4,
                at[1] + slant * step as i32 / 8 + rough(random) / 8,
            ];
            knot
        });
        let knots = knots.collect();
        Self {
            levels: levels(random, width * lines),
            starts: (0..lines).map(|line| (line * width) as u32).collect(),
            first_line: first_line as u16,
            width,
            knots,
            step_shift,
            interpolation: [Interpolation::Bilinear, Interpolation::Cubic][below(random, 8) / 7],
            output: vec![1; pixels],
        }
    }
}

impl Case for ResampleCase {
    type Output = Vec<u8>;

    fn run(&mut self, kernels: impl Kernels) {
        let row = ResampleRow {
            levels: &self.levels,
            starts: &self.starts,
            first_line: self.first_line,
            width: self.width,
            knots: &self.knots,
            step_shift: self.step_shift,
            interpolation: self.interpolation,
        };
        kernels.resample_row(&row, &mut self.output);
    }

    fn output(&self) -> Vec<u8> {
        self.output.clone()
    }
}

/// Task for [`Kernels::convert_row`].
#[derive(Debug, Clone)]
pub struct ConvertCase {
    pub conversion: LevelConversion,
    pub levels: Vec<u8>,
    pub low: Vec<u8>,
    pub high: Vec<u8>,
}

impl ConvertCase {
    /// A row of `width` pixels, of which some are 0 and 255.
    pub fn random(random: &mut Pcg32, width: usize) -> Self {
        let conversion = LevelConversion {
            gain_q12: (1 << 10) + below(random, 15 << 10) as i32,
            offset_q12: below(random, 1 << 22) as i32 - (1 << 21),
            dead_zone: byte(random) >> below(random, 8),
        };
        let mut levels = levels(random, width);
        for end in [0, u8::MAX] {
            levels[below(random, width)] = end;
        }
        Self {
            conversion,
            levels,
            low: vec![1; width],
            high: vec![2; width],
        }
    }
}

impl Case for ConvertCase {
    type Output = [Vec<u8>; 2];

    fn run(&mut self, kernels: impl Kernels) {
        kernels.convert_row(
            &self.conversion,
            &self.levels,
            &mut self.low,
            &mut self.high,
        );
    }

    fn output(&self) -> [Vec<u8>; 2] {
        [self.low.clone(), self.high.clone()]
    }
}

/// Task for [`Kernels::penalty_row`].
#[derive(Debug, Clone)]
pub struct PenaltyCase {
    pub penalty: Penalty,
    pub own: Vec<u8>,
    pub neighbours: Vec<u8>,
    pub p2: Vec<u8>,
}

impl PenaltyCase {
    /// Penalties of a row of `width` pixels.
    pub fn random(random: &mut Pcg32, width: usize) -> Self {
        let mut any = || byte(random) >> below(random, 8);
        Self {
            penalty: Penalty {
                most: any(),
                floor: any(),
                adaptation_q4: any(),
                step_min: any(),
            },
            own: levels(random, width),
            neighbours: levels(random, width),
            p2: vec![1; width],
        }
    }
}

impl Case for PenaltyCase {
    type Output = Vec<u8>;

    fn run(&mut self, kernels: impl Kernels) {
        kernels.penalty_row(&self.penalty, &self.own, &self.neighbours, &mut self.p2);
    }

    fn output(&self) -> Vec<u8> {
        self.p2.clone()
    }
}

/// Task for [`Kernels::check_row`].
#[derive(Debug, Clone)]
pub struct CheckCase {
    pub best: Vec<u16>,
    pub refined_index_q4: Vec<i16>,
    pub margins: Vec<i16>,
    pub others: Vec<u32>,
    pub first: u32,
    pub tolerance_px: u8,
    pub margin: i16,
    pub found: Vec<i16>,
    pub confidences: Vec<u8>,
}

impl CheckCase {
    /// A row of `width` pixels, of which most have a match; about half of the matches agree.
    pub fn random(random: &mut Pcg32, width: usize) -> Self {
        let disparities = 1 + below(random, 64);
        let best: Vec<_> = (0..width)
            .map(|_| below(random, disparities) as u16)
            .collect();
        let others = (0..width + disparities).map(|_| match below(random, 9) {
            0 => u32::MAX,
            _ => random.next_u32() << 16 | below(random, disparities) as u32,
        });
        let others = others.collect();
        let margins = (0..width).map(|_| match below(random, 9) {
            0 => i16::MAX,
            1 => random.next_u32() as i16,
            _ => below(random, 300) as i16,
        });
        let margins = margins.collect();
        Self {
            refined_index_q4: best.iter().map(|&best| best as i16 * 16 + 5).collect(),
            best,
            margins,
            others,
            first: (width + below(random, 9)).wrapping_sub(5) as u32,
            tolerance_px: [0, 1, 1, 2, 255][below(random, 5)],
            margin: below(random, 200) as i16 - 20,
            found: vec![1; width],
            confidences: vec![1; width],
        }
    }
}

impl Case for CheckCase {
    type Output = (Vec<i16>, Vec<u8>);

    fn run(&mut self, kernels: impl Kernels) {
        let row = CheckRow {
            best: &self.best,
            refined_index_q4: &self.refined_index_q4,
            margins: &self.margins,
            others: &self.others,
            first: self.first,
            tolerance_px: self.tolerance_px,
            margin: self.margin,
        };
        kernels.check_row(&row, &mut self.found, &mut self.confidences);
    }

    fn output(&self) -> (Vec<i16>, Vec<u8>) {
        (self.found.clone(), self.confidences.clone())
    }
}

/// Task for [`Kernels::rivals_row`].
#[derive(Debug, Clone)]
pub struct RivalsCase {
    pub costs: Vec<u8>,
    pub disparities: usize,
    pub reach_px: usize,
    pub ratio_q4: u8,
    pub slack: u8,
    pub rise: u8,
    pub sums: Vec<u32>,
    pub rivals: Vec<u8>,
}

impl RivalsCase {
    /// A row of `width` pixels of `disparities`, which fit two valleys of random depths everywhere or not.
    pub fn random(random: &mut Pcg32, width: usize, disparities: usize) -> Self {
        let stride = cost_stride(disparities);
        let high = [255, 60][below(random, 2)];
        let mut costs: Vec<_> = (0..width * stride)
            .map(|_| (high - below(random, 40)) as u8)
            .collect();
        for _ in 0..2 {
            let (valley, depth) = (below(random, disparities), below(random, high));
            for costs in costs.chunks_mut(stride) {
                costs[valley] = (high - depth) as u8;
            }
        }
        Self {
            costs,
            disparities,
            reach_px: below(random, 65),
            ratio_q4: 16 + below(random, 16) as u8,
            slack: below(random, 60) as u8,
            rise: [0, 5, 17, 255][below(random, 4)],
            sums: vec![7; disparities / 2 + below(random, 3)],
            rivals: vec![7; width.div_ceil(RIVAL_BLOCK_PX)],
        }
    }
}

impl RivalsCase {
    fn row(&self) -> RivalsRow<'_> {
        RivalsRow {
            costs: &self.costs,
            stride: cost_stride(self.disparities),
            disparities: self.disparities,
            reach_px: self.reach_px,
            ratio_q4: self.ratio_q4,
            slack: self.slack,
            rise: self.rise,
        }
    }
}

impl Case for RivalsCase {
    type Output = Vec<u8>;

    fn run(&mut self, kernels: impl Kernels) {
        let mut sums = core::mem::take(&mut self.sums);
        let mut rivals = core::mem::take(&mut self.rivals);
        kernels.rivals_row(&self.row(), &mut sums, &mut rivals);
        (self.sums, self.rivals) = (sums, rivals);
    }

    fn output(&self) -> Vec<u8> {
        self.rivals.clone()
    }
}

/// Task for [`Kernels::attenuate_row`].
#[derive(Debug, Clone)]
pub struct AttenuateCase {
    pub costs: Vec<u8>,
    pub disparities: usize,
    pub doubts: Vec<u8>,
    pub shift: u8,
}

impl AttenuateCase {
    /// A row of `width` pixels of `disparities`, of which some blocks are in doubt, none or all.
    pub fn random(random: &mut Pcg32, width: usize, disparities: usize) -> Self {
        let stride = cost_stride(disparities);
        let mut costs = vec![0; width * stride];
        fill_costs(random, &mut costs, stride, disparities, 255);
        let marks = [[0, 0], [0, 1], [2, 1]][below(random, 3)];
        let blocks = width.div_ceil(RIVAL_BLOCK_PX);
        Self {
            costs,
            disparities,
            doubts: (0..blocks).map(|_| marks[below(random, 2)]).collect(),
            shift: below(random, 8) as u8,
        }
    }
}

impl Case for AttenuateCase {
    type Output = Vec<u8>;

    fn run(&mut self, kernels: impl Kernels) {
        kernels.attenuate_row(&mut AttenuateRow {
            costs: &mut self.costs,
            stride: cost_stride(self.disparities),
            disparities: self.disparities,
            doubts: &self.doubts,
            shift: self.shift,
        });
    }

    fn output(&self) -> Vec<u8> {
        self.costs.clone()
    }
}

/// Task for [`Kernels::smooth_row`].
#[derive(Debug, Clone)]
pub struct SmoothCase {
    pub rows: [Vec<u8>; 3],
    pub step_max: u8,
    pub smoothed: Vec<u8>,
}

impl SmoothCase {
    /// Three rows for an output of `width` pixels, each `missing` levels too short.
    pub fn random(random: &mut Pcg32, width: usize, missing: usize) -> Self {
        Self {
            rows: from_fn(|_| levels(random, (width + 2).saturating_sub(missing))),
            step_max: byte(random),
            smoothed: vec![1; width],
        }
    }
}

impl Case for SmoothCase {
    type Output = Vec<u8>;

    fn run(&mut self, kernels: impl Kernels) {
        let rows = self.rows.each_ref().map(Vec::as_slice);
        kernels.smooth_row(rows, self.step_max, &mut self.smoothed);
    }

    fn output(&self) -> Vec<u8> {
        self.smoothed.clone()
    }
}

/// Task for [`Kernels::pack_cells`].
#[derive(Debug, Clone)]
pub struct PackCase {
    pub samples: [Vec<u8>; CELLS_PER_BYTE + 1],
    pub packed: Vec<u8>,
}

impl PackCase {
    /// Samples of `width` neurons; in some cases one row is shorter.
    pub fn random(random: &mut Pcg32, width: usize) -> Self {
        let mut samples = from_fn(|_| levels(random, width));
        if below(random, 3) == 0 {
            let row = below(random, samples.len());
            samples[row].truncate(below(random, width));
        }
        Self {
            samples,
            packed: vec![1; width],
        }
    }
}

impl Case for PackCase {
    type Output = Vec<u8>;

    fn run(&mut self, kernels: impl Kernels) {
        let samples = self.samples.each_ref().map(Vec::as_slice);
        kernels.pack_cells(&samples, &mut self.packed);
    }

    fn output(&self) -> Vec<u8> {
        self.packed.clone()
    }
}

/// Task for [`Kernels::recall_row`].
#[derive(Debug, Clone)]
pub struct RecallCase {
    pub inputs: OwnPlanes,
    pub stored: OwnPlanes,
    pub first: isize,
    pub step: isize,
    pub minimum_px: i16,
    pub disparities: usize,
    pub candidates: usize,
    pub ties: TieBreak,
    pub line: u32,
    pub column: u32,
    pub distances: Vec<i16>,
    pub candidates_px: Vec<i16>,
}

impl RecallCase {
    /// A row of `width` neurons and as many stored patterns, of `bytes` bytes each. The stored
    /// patterns of the first neuron may begin before or after them.
    pub fn random(random: &mut Pcg32, width: usize, disparities: usize, bytes: usize) -> Self {
        let outside = disparities as isize + 3;
        let first = below(random, width + 2 * outside as usize) as isize - outside;
        let candidates = 1 + below(random, 4);
        let minimum_end = i16::MAX as usize - disparities;
        Self {
            inputs: OwnPlanes::alike(random, width, bytes),
            stored: OwnPlanes::alike(random, width, bytes),
            first,
            step: [-1, 1][below(random, 2)],
            minimum_px: below(random, minimum_end) as i16 - below(random, 300) as i16,
            disparities,
            candidates,
            ties: match below(random, 2) {
                0 => TieBreak::Lowest,
                _ => TieBreak::Random {
                    seed: random.next_u64(),
                },
            },
            line: random.next_u32() >> 8,
            column: random.next_u32() >> 8,
            distances: vec![1; disparities.next_multiple_of(LANES)],
            candidates_px: vec![2; candidates * width],
        }
    }
}

impl Case for RecallCase {
    type Output = Vec<i16>;

    fn run(&mut self, kernels: impl Kernels) {
        let row = RowRecall {
            inputs: self.inputs.planes(),
            count: self.inputs.positions,
            stored: self.stored.planes(),
            stored_count: self.stored.positions,
            first: self.first,
            step: self.step,
            minimum_px: self.minimum_px,
            disparities: self.disparities,
            candidates: self.candidates,
            ties: self.ties,
            line: self.line,
            column: self.column,
        };
        kernels.recall_row(&row, &mut self.distances, &mut self.candidates_px);
    }

    fn output(&self) -> Vec<i16> {
        self.candidates_px.clone()
    }
}

/// Task for [`Kernels::mask_block`].
#[derive(Debug, Clone)]
pub struct MaskCase {
    pub levels: Vec<Vec<u8>>,
    pub centre: usize,
    pub starts: Vec<u32>,
    pub first: usize,
    pub lanes: usize,
    pub kept: u16,
    pub floor: u8,
    pub step: NonZeroU8,
    pub cells: Vec<u8>,
    /// Bytes of `cells` before those that the kernel gets, so that these are aligned or not.
    pub skipped: usize,
    pub masks: Vec<u8>,
    pub counts: [u16; MASK_LANES],
}

impl MaskCase {
    /// A block of `lanes` pixels, with masks of `bytes` bytes.
    pub fn random(random: &mut Pcg32, lanes: usize, bytes: usize, channels: usize) -> Self {
        const PIXELS: usize = 300;
        let cells = bytes * CELLS_PER_BYTE;
        let levels = channels_of(random, channels, PIXELS);
        let first = below(random, 100);
        let mut start = |first| below(random, PIXELS - first - lanes + 1);
        let centre = start(0);
        let starts = (0..cells).map(|_| start(first) as u32).collect();
        // In half of the cases as low as the thresholds of presets.
        let shift = [0, 3][below(random, 2)];
        let skipped = [0, 0, 1, 2][below(random, 4)];
        Self {
            levels,
            centre,
            starts,
            first,
            lanes,
            kept: 1 + below(random, cells) as u16,
            floor: byte(random) >> shift,
            step: NonZeroU8::MIN.saturating_add(byte(random) >> shift),
            cells: vec![3; skipped + cells * lanes],
            skipped,
            masks: vec![1; bytes * lanes],
            counts: [2; MASK_LANES],
        }
    }
}

impl Case for MaskCase {
    /// Masks, and the number of cells in each.
    type Output = (Vec<u8>, Vec<u16>);

    fn run(&mut self, kernels: impl Kernels) {
        let mut block = MaskBlock {
            levels: channel_rows(&self.levels),
            channels: self.levels.len(),
            centre: self.centre,
            starts: &self.starts,
            first: self.first,
            lanes: self.lanes,
            kept: self.kept,
            floor: self.floor,
            step: self.step,
            cells: self.cells.get_mut(self.skipped..).unwrap_or_default(),
            masks: &mut self.masks,
            counts: self.counts,
        };
        kernels.mask_block(&mut block);
        self.counts = block.counts;
    }

    fn output(&self) -> Self::Output {
        (
            self.masks.clone(),
            self.counts[..self.lanes.min(MASK_LANES)].to_vec(),
        )
    }
}

/// Task for [`Kernels::cost_run`].
#[derive(Debug, Clone)]
pub struct CostCase {
    pub start: usize,
    pub inputs: OwnPlanes,
    /// Masks of the run's pixels; `None` if every cell counts.
    pub masks: Option<OwnPlanes>,
    pub cell_costs_q8: Vec<u16>,
    pub truncations: Vec<u8>,
    pub stored: OwnPlanes,
    pub first_position: usize,
    pub disparities: usize,
    pub hamming_truncation: u8,
    pub levels: Vec<Vec<u8>>,
    pub other_low: Vec<Vec<u8>>,
    pub other_high: Vec<Vec<u8>>,
    pub difference_truncation: u8,
    pub difference_weight_q4: u8,
    pub costs: Vec<u8>,
}

impl CostCase {
    /// A run of `width` pixels, with patterns of `bytes` bytes. At least a third of the runs have a
    /// weight of 0 for levels, and a third have no masks.
    pub fn random(
        random: &mut Pcg32,
        width: usize,
        disparities: usize,
        bytes: usize,
        channels: usize,
    ) -> Self {
        let stride = cost_stride(disparities);
        let (start, spare) = (below(random, 3), below(random, 3));
        let first_position = width - 1 + spare;
        let positions = first_position + stride;
        // The bound of `CostRun::cell_costs_q8`.
        let cell_cost_max = ((1 << 16) - 129) / (bytes * CELLS_PER_BYTE);
        // Whole costs in half of the cases, as in runs without masks.
        let whole = [!0, !0xff][below(random, 2)];
        let mut cell_cost = || below(random, cell_cost_max + 1) as u16 & whole;
        let cell_costs_q8 = (0..width).map(|_| cell_cost()).collect();
        let other = channels_of(random, channels, positions + LANES);
        let dead_zone = below(random, 9) as u8;
        let moved = |change: fn(u8, u8) -> u8| -> Vec<Vec<u8>> {
            let row = |row: &Vec<u8>| row.iter().map(|&level| change(level, dead_zone)).collect();
            other.iter().map(row).collect()
        };
        let hamming_truncation = byte(random) >> below(random, 4);
        let difference_truncation = byte(random) >> below(random, 5);
        // The largest sum of both terms fits 8 bits.
        let rest = usize::from(u8::MAX - hamming_truncation) * 16;
        let weight_max = (rest / usize::from(difference_truncation.max(1))).min(255);
        let weight_max = weight_max * below(random, 3).min(1);
        // In most cases a multiple of a power of two.
        let multiple = u8::MAX << below(random, 5);
        Self {
            start,
            inputs: OwnPlanes::random(random, start + width, bytes),
            masks: (below(random, 3) > 0).then(|| OwnPlanes::random(random, width, bytes)),
            cell_costs_q8,
            truncations: (0..width)
                .map(|_| below(random, usize::from(hamming_truncation) + 1) as u8)
                .collect(),
            stored: OwnPlanes::random(random, positions, bytes),
            first_position,
            disparities,
            hamming_truncation,
            levels: channels_of(random, channels, start + width),
            other_low: moved(u8::saturating_sub),
            other_high: moved(u8::saturating_add),
            difference_truncation,
            difference_weight_q4: below(random, weight_max + 1) as u8 & multiple,
            costs: vec![1; width * stride],
        }
    }
}

impl CostCase {
    /// Bounds the costs, as a configuration does that leaves room for penalties.
    fn bound(&mut self, cost_max: u8) {
        self.hamming_truncation = self.hamming_truncation.min(cost_max);
        for truncation in &mut self.truncations {
            *truncation = self.hamming_truncation.min(*truncation);
        }
        let rest = u16::from(cost_max - self.hamming_truncation) * 16;
        let weight_max = rest / u16::from(self.difference_truncation.max(1));
        let weight = weight_max.min(self.difference_weight_q4.into());
        self.difference_weight_q4 = weight as u8;
    }

    /// `count` pixels from pixel `first` of the run on.
    fn part(&self, first: usize, count: usize) -> CostRun<'_> {
        CostRun {
            start: self.start + first,
            inputs: self.inputs.planes(),
            masks: self.masks.as_ref().map_or(Planes::NONE, OwnPlanes::planes),
            cell_costs_q8: &self.cell_costs_q8[first..][..count],
            truncations: &self.truncations[first..(first + count).min(self.truncations.len())],
            stored: self.stored.planes(),
            first_position: self.first_position - first,
            disparities: self.disparities,
            hamming_truncation: self.hamming_truncation,
            levels: channel_rows(&self.levels),
            other_low: channel_rows(&self.other_low),
            other_high: channel_rows(&self.other_high),
            channels: self.levels.len(),
            difference_truncation: self.difference_truncation,
            difference_weight_q4: self.difference_weight_q4,
        }
    }
}

impl Case for CostCase {
    type Output = Vec<u8>;

    fn run(&mut self, kernels: impl Kernels) {
        let mut costs = core::mem::take(&mut self.costs);
        kernels.cost_run(&self.part(0, self.cell_costs_q8.len()), &mut costs);
        self.costs = costs;
    }

    fn output(&self) -> Vec<u8> {
        self.costs.clone()
    }
}

/// Task for [`Kernels::aggregate_row`]: SGM aggregation and selection of a row.
#[derive(Debug, Clone)]
pub struct AggregateCase {
    pub costs: Vec<u8>,
    pub from_right: Vec<u8>,
    pub from_above: Vec<u8>,
    pub stride: usize,
    pub disparities: usize,
    pub is_first: bool,
    pub p1: u8,
    pub subpixel: SubpixelStep,
    pub p2_along: Vec<u8>,
    pub p2_down: Vec<u8>,
    pub paths: Vec<u8>,
    pub sums: Vec<i16>,
    pub other_best: Vec<u32>,
    pub best: Vec<u16>,
    pub refined_index_q4: Vec<i16>,
    pub margins: Vec<i16>,
}

impl AggregateCase {
    /// The first row of a frame of `width` pixels, with costs of at most `cost_max`.
    pub fn random(random: &mut Pcg32, width: usize, disparities: usize, cost_max: u8) -> Self {
        let stride = cost_stride(disparities);
        let mut case = Self {
            costs: vec![0; width * stride],
            from_right: vec![1; width * stride],
            from_above: vec![0; width * stride],
            stride,
            disparities,
            is_first: true,
            p1: 0,
            subpixel: SubpixelStep::PARABOLA,
            p2_along: vec![0; width],
            p2_down: vec![0; width],
            paths: vec![2; path_scratch_bytes(stride)],
            sums: vec![3; stride],
            other_best: vec![0; width + stride],
            best: vec![u16::MAX; width],
            refined_index_q4: vec![-1; width],
            margins: vec![-1; width],
        };
        case.next_row(random, cost_max);
        case.is_first = true;
        case
    }

    /// Proceeds to the next row of the frame: replaces costs and penalties, and keeps the path
    /// costs from above.
    pub fn next_row(&mut self, random: &mut Pcg32, cost_max: u8) {
        let (stride, disparities) = (self.stride, self.disparities);
        let bound = cost_bound(random, cost_max);
        fill_costs(random, &mut self.costs, stride, disparities, bound);
        let p2_max = usize::from(u8::MAX - cost_max);
        let p1 = below(random, p2_max + 1);
        for p2 in self.p2_along.iter_mut().chain(&mut self.p2_down) {
            *p2 = (p1 + below(random, p2_max - p1 + 1)) as u8;
        }
        self.p1 = p1 as u8;
        self.subpixel = random_subpixel(random);
        self.is_first = false;
    }

    fn row(&mut self) -> AggregateRow<'_> {
        AggregateRow {
            costs: &mut self.costs,
            from_right: &mut self.from_right,
            from_above: &mut self.from_above,
            stride: self.stride,
            disparities: self.disparities,
            is_first: self.is_first,
            p1: self.p1,
            subpixel: self.subpixel,
            p2_along: &self.p2_along,
            p2_down: &self.p2_down,
            paths: &mut self.paths,
            sums: &mut self.sums,
            other_best: &mut self.other_best,
            best: &mut self.best,
            refined_index_q4: &mut self.refined_index_q4,
            margins: &mut self.margins,
        }
    }

    fn selection(&self) -> Selection {
        Selection {
            best: self.best.clone(),
            refined_index_q4: self.refined_index_q4.clone(),
            margins: self.margins.clone(),
            other_best: self.other_best.clone(),
        }
    }
}

/// Task for rows as the matcher has them: of each its costs, run by run, then [`Kernels::rivals_row`],
/// [`Kernels::attenuate_row`] in most of them, and [`Kernels::aggregate_row`]. A set may keep costs and paths elsewhere than in memory.
#[derive(Debug, Clone)]
pub struct RowsCase {
    costs: Vec<CostCase>,
    rivals: Vec<RivalsCase>,
    attenuate: Vec<Option<AttenuateCase>>,
    aggregate: Vec<AggregateCase>,
}

impl RowsCase {
    /// The first `rows` rows of a frame of `width` pixels, with patterns of `bytes` bytes that all count.
    pub fn random(
        random: &mut Pcg32,
        width: usize,
        rows: usize,
        disparities: usize,
        bytes: usize,
    ) -> Self {
        let cost_max = byte(random);
        let mut aggregate = AggregateCase::random(random, width, disparities, cost_max);
        let mut case = Self {
            costs: vec![],
            rivals: vec![],
            attenuate: vec![],
            aggregate: vec![],
        };
        for _ in 0..rows {
            let mut costs = CostCase::random(random, width, disparities, bytes, 1);
            costs.bound(cost_max);
            costs.masks = None;
            costs.start = 0;
            costs.inputs = OwnPlanes::alike(random, width, bytes);
            costs.stored = OwnPlanes::alike(random, costs.stored.positions, bytes);
            case.costs.push(costs);
            case.rivals
                .push(RivalsCase::random(random, width, disparities));
            let attenuated = AttenuateCase::random(random, width, disparities);
            let is_attenuated = below(random, 4) > 0;
            case.attenuate.push(is_attenuated.then_some(attenuated));
            case.aggregate.push(aggregate.clone());
            aggregate.next_row(random, cost_max);
        }
        case
    }
}

impl Case for RowsCase {
    /// Rivals of each row, and its selection.
    type Output = Vec<(Vec<u8>, Selection)>;

    fn run(&mut self, kernels: impl Kernels) {
        const RUN: usize = 128;
        let mut from_above = vec![];
        let rows = self.costs.iter().zip(&mut self.rivals);
        let rows = rows.zip(&self.attenuate).zip(&mut self.aggregate);
        for (((inputs, rivals), attenuate), aggregate) in rows {
            if !aggregate.is_first {
                aggregate.from_above = from_above;
            }
            let (width, stride) = (aggregate.best.len(), aggregate.stride);
            for start in (0..width).step_by(RUN) {
                let pixels = RUN.min(width - start);
                let costs = &mut aggregate.costs[start * stride..(start + pixels) * stride];
                kernels.cost_run(&inputs.part(start, pixels), costs);
            }
            let row = RivalsRow {
                costs: &aggregate.costs,
                ..rivals.row()
            };
            let mut found = rivals.rivals.clone();
            kernels.rivals_row(&row, &mut rivals.sums.clone(), &mut found);
            rivals.rivals = found;
            if let Some(attenuate) = attenuate {
                kernels.attenuate_row(&mut AttenuateRow {
                    costs: &mut aggregate.costs,
                    stride,
                    disparities: rivals.disparities,
                    doubts: &attenuate.doubts,
                    shift: attenuate.shift,
                });
            }
            aggregate.run(kernels);
            from_above = aggregate.from_above.clone();
        }
    }

    fn output(&self) -> Self::Output {
        let rows = self.rivals.iter().zip(&self.aggregate);
        rows.map(|(rivals, row)| (rivals.output(), row.selection()))
            .collect()
    }
}

/// Any relief, and any bound between parabola and lines, within the range of rises and beyond.
fn random_subpixel(random: &mut Pcg32) -> SubpixelStep {
    SubpixelStep {
        relief: below(random, 256) as u8,
        lines_min: below(random, 1000) as u16,
    }
}

/// Writes costs below `bound`, and [`NO_COST`] beyond the `disparities` of each pixel.
pub fn fill_costs(
    random: &mut Pcg32,
    costs: &mut [u8],
    stride: usize,
    disparities: usize,
    bound: usize,
) {
    for pixel in costs.chunks_exact_mut(stride) {
        let (inside, beyond) = pixel.split_at_mut(disparities);
        inside.fill_with(|| below(random, bound) as u8);
        beyond.fill(NO_COST);
    }
}

/// Returns a random bound for costs up to `cost_max`; if it is low, many costs are equal.
fn cost_bound(random: &mut Pcg32, cost_max: u8) -> usize {
    1 + below(random, usize::from(cost_max) + 1)
}

/// Result of the selection for a row; the fields are those of [`AggregateRow`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Selection {
    pub best: Vec<u16>,
    pub refined_index_q4: Vec<i16>,
    pub margins: Vec<i16>,
    pub other_best: Vec<u32>,
}

impl Case for AggregateCase {
    /// Path costs from above, which the next row needs, and the selection.
    type Output = (Vec<u8>, Selection);

    fn run(&mut self, kernels: impl Kernels) {
        kernels.aggregate_row(&mut self.row());
    }

    fn output(&self) -> Self::Output {
        (self.from_above.clone(), self.selection())
    }
}

/// Task for [`Kernels::aggregate_paths`].
#[derive(Debug, Clone)]
pub struct PathsCase(pub AggregateCase);

impl Case for PathsCase {
    /// Path costs from the left, from the right and from above.
    type Output = [Vec<u8>; 3];

    fn run(&mut self, kernels: impl Kernels) {
        kernels.aggregate_paths(&mut self.0.row());
    }

    fn output(&self) -> Self::Output {
        let AggregateCase {
            costs,
            from_right,
            from_above,
            ..
        } = &self.0;
        [costs, from_right, from_above].map(Vec::clone)
    }
}

/// Task for [`Kernels::select_row`].
#[derive(Debug, Clone)]
pub struct SelectCase(pub AggregateCase);

impl SelectCase {
    /// A row of `width` pixels, with path costs of at most `cost_max`.
    pub fn random(random: &mut Pcg32, width: usize, disparities: usize, cost_max: u8) -> Self {
        let mut case = AggregateCase::random(random, width, disparities, cost_max);
        let stride = case.stride;
        for paths in [&mut case.from_right, &mut case.from_above] {
            let bound = cost_bound(random, cost_max);
            fill_costs(random, paths, stride, disparities, bound);
        }
        Self(case)
    }
}

impl Case for SelectCase {
    type Output = Selection;

    fn run(&mut self, kernels: impl Kernels) {
        kernels.select_row(&mut self.0.row());
    }

    fn output(&self) -> Selection {
        self.0.selection()
    }
}

/// Task for [`Kernels::arms_row`].
#[derive(Debug, Clone)]
pub struct ArmsCase {
    pub levels: Vec<Vec<u8>>,
    pub reach: u8,
    pub near_step: u8,
    pub far_step: u8,
    pub scratch: Vec<u8>,
    pub arms: Vec<i16>,
}

impl ArmsCase {
    /// A line of `width` pixels.
    pub fn random(random: &mut Pcg32, width: usize, reach: u8, channels: usize) -> Self {
        Self {
            levels: channels_of(random, channels, width),
            reach,
            near_step: byte(random),
            far_step: byte(random),
            scratch: vec![2; arms_scratch_bytes(width)],
            arms: vec![-1; width],
        }
    }
}

impl Case for ArmsCase {
    type Output = Vec<i16>;

    fn run(&mut self, kernels: impl Kernels) {
        let row = ArmsRow {
            levels: channel_rows(&self.levels),
            channels: self.levels.len(),
            reach: self.reach,
            near_step: self.near_step,
            far_step: self.far_step,
        };
        kernels.arms_row(&row, &mut self.scratch, &mut self.arms);
    }

    fn output(&self) -> Vec<i16> {
        self.arms.clone()
    }
}

/// Task for [`Kernels::median9_row`].
#[derive(Debug, Clone)]
pub struct Median9Case {
    pub rows: [Vec<i16>; 3],
    pub output: Vec<i16>,
}

impl Median9Case {
    /// A row of `width` pixels.
    pub fn random(random: &mut Pcg32, width: usize) -> Self {
        Self {
            rows: from_fn(|_| disparities_q4(random, width + 2)),
            output: vec![1; width],
        }
    }
}

impl Case for Median9Case {
    type Output = Vec<i16>;

    fn run(&mut self, kernels: impl Kernels) {
        let rows = self.rows.each_ref().map(Vec::as_slice);
        kernels.median9_row(rows, &mut self.output);
    }

    fn output(&self) -> Vec<i16> {
        self.output.clone()
    }
}

/// Task for [`Kernels::weighted_median_row`].
#[derive(Debug, Clone)]
pub struct WeightedMedianCase {
    /// Disparities of each row of the window, 1/16 px.
    pub values: Vec<Vec<i16>>,
    /// Levels of each channel and each row of the window.
    pub levels: Vec<Vec<Vec<u8>>>,
    /// Levels of each channel at the filtered row.
    pub centres: Vec<Vec<u8>>,
    pub rows: usize,
    pub centre: usize,
    pub window_width: usize,
    pub places: Vec<u8>,
    pub colour_reach: u8,
    pub weights: Scratch,
    pub output: Vec<i16>,
}

/// Bytes aligned to words, as the pipeline's scratch is.
#[derive(Debug, Clone)]
pub struct Scratch(Vec<u32>);

impl WeightedMedianCase {
    /// A row of `width` pixels, with a window of `rows` rows of taps that reaches `reach_x` columns
    /// to either side.
    pub fn random(
        random: &mut Pcg32,
        width: usize,
        reach_x: usize,
        rows: usize,
        channels: usize,
    ) -> Self {
        let padded = width + 2 * reach_x;
        let values = (0..rows).map(|_| disparities_q4(random, padded)).collect();
        let plane = |random: &mut Pcg32| -> Vec<Vec<u8>> {
            let plane = levels(random, rows * padded);
            plane.chunks_exact(padded).map(<[u8]>::to_vec).collect()
        };
        let taps = rows * (reach_x + 1);
        let levels: Vec<_> = (0..channels).map(|_| plane(random)).collect();
        let centre = below(random, rows);
        let inside = |plane: &Vec<Vec<u8>>| plane[centre][reach_x..][..width].to_vec();
        Self {
            values,
            centres: levels.iter().map(inside).collect(),
            levels,
            rows,
            centre,
            window_width: 2 * reach_x + 1,
            places: (0..taps).map(|_| 1 + below(random, 20) as u8).collect(),
            colour_reach: 4 + below(random, 45) as u8,
            weights: Scratch(vec![0x0202_0202; 4 * taps]),
            output: vec![1; width],
        }
    }
}

impl Case for WeightedMedianCase {
    type Output = Vec<i16>;

    fn run(&mut self, kernels: impl Kernels) {
        let mut row = WeightedMedianRow {
            values: [&[]; MAX_TAP_ROWS],
            levels: [[&[]; MAX_TAP_ROWS]; MAX_CHANNELS],
            centres: channel_rows(&self.centres),
            rows: self.rows,
            centre: self.centre,
            channels: self.levels.len(),
            window_width: self.window_width,
            places: &self.places,
            colour_reach: self.colour_reach,
        };
        for (to, values) in row.values.iter_mut().zip(&self.values) {
            *to = values;
        }
        for (to, rows) in row.levels.iter_mut().zip(&self.levels) {
            for (to, levels) in to.iter_mut().zip(rows) {
                *to = levels;
            }
        }
        let weights = bytemuck::must_cast_slice_mut(&mut self.weights.0);
        kernels.weighted_median_row(&row, weights, &mut self.output);
    }

    fn output(&self) -> Vec<i16> {
        self.output.clone()
    }
}
