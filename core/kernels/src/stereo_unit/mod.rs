//! Kernels that a unit in logic computes: the stereo unit of the soft core, `firmware/boards/softcore/rtl/stereo_unit.sv`.
//!
//! The unit reads what it needs from memory by itself, and keeps the costs and the path costs of a row: of its
//! results, those that the pipeline reads are copied out.

mod port;
mod window;

use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::{
    AggregateRow, AttenuateRow, CELLS_PER_BYTE, CostRun, Kernels, LevelConversion, Penalty, Planes,
    Portable, RivalsRow,
};

pub use port::Port;
use window::{PIECE_PX, Window};

// Registers.
const STATUS: usize = 0x00;
const COMMAND: usize = 0x00;
const ADDRESS: usize = 0x04;
const RUN: usize = 0x08;
const SHAPE: usize = 0x0c;
const FIRST: usize = 0x10;
const DIFFERENCE: usize = 0x14;
const PATHS: usize = 0x18;
const RIVALS: usize = 0x1c;
const FOUND: [usize; 2] = [0x20, 0x24];
const SIZE: usize = 0x28;
const PENALTY: usize = 0x2c;
const GAIN: usize = 0x30;
const OFFSET: usize = 0x34;
const DOUBTS: [usize; 2] = [0x38, 0x3c];
const SHIFT: usize = 0x40;
// Commands.
const MAKE_COSTS: u32 = 1;
const FIND_RIVALS: u32 = 2;
const MAKE_PATHS: u32 = 3;
const SMOOTH: u32 = 4;
const TAKE_MEDIANS: u32 = 5;
const PENALISE: u32 = 6;
const CONVERT_TO_LOWEST: u32 = 7;
const CONVERT_TO_HIGHEST: u32 = 1 << 8 | CONVERT_TO_LOWEST;
// Destinations of runs, of which planes and samples have several.
const INPUTS: u32 = 0;
const STORED: u32 = 4;
const LOW: u32 = 8;
const HIGH: u32 = 9;
const LEVELS: u32 = 10;
const TRUNCATIONS: u32 = 11;
const CELL_COSTS: u32 = 12;
const P2_ALONG: u32 = 13;
const P2_DOWN: u32 = 14;
const SAMPLES: u32 = 16;
const LEVEL_ROWS: [u32; 3] = [0, 1, 2];
const NEIGHBOURS: u32 = 1;
const DISPARITY_ROWS: [u32; 3] = [0, 2, 4];

/// Bytes of the patterns that the unit compares.
const PATTERN_BYTES: usize = 4;
/// Largest number of pixels of a row.
const WIDTH_MAX: usize = 160;
/// The largest bound between parabola and lines that the unit knows, larger than every rise.
const LINES_MIN_MAX: u16 = 1023;

/// Kernel set whose costs, penalties, path costs, selection, rivals, cells, smoothed and converted levels and medians a
/// stereo unit makes; all others are the reference.
///
/// The unit is for patterns of 32 cells that all count, for one channel, and for rows that [`StereoUnit::fits`]. What
/// is beyond that is not computed. Costs are not in memory, so that `aggregate_paths` and `select_row`, of which the
/// unit has no parts, are the reference's on costs that are; the pipeline calls neither.
#[derive(Debug, Clone, Copy)]
pub struct StereoUnit<P> {
    port: P,
    /// The base-2 logarithm of the number of costs that are made in a cycle.
    lanes_shift: u32,
    disparities_max: usize,
    costs_max: usize,
}

impl<P: Port> StereoUnit<P> {
    /// The unit behind a port.
    #[must_use]
    pub fn new(port: P) -> Self {
        let size = port.read(SIZE);
        Self {
            port,
            lanes_shift: (size & 0xff).trailing_zeros(),
            disparities_max: (size >> 8 & 0xff) as usize,
            costs_max: (size >> 16) as usize,
        }
    }

    /// Whether the unit has room for rows of so many pixels and disparities.
    #[must_use]
    pub fn fits(&self, width: usize, disparities: usize) -> bool {
        let is_inside = |value: usize, most: usize| (1..=most).contains(&value);
        is_inside(width, WIDTH_MAX)
            && is_inside(disparities, self.disparities_max)
            && width * (self.words(disparities) << self.lanes_shift) <= self.costs_max
    }

    /// Words of the unit that the costs of a pixel take.
    fn words(&self, disparities: usize) -> usize {
        (disparities + (1 << self.lanes_shift) - 1) >> self.lanes_shift
    }

    /// Queues a run of bytes.
    #[inline(always)]
    fn queue(&self, destination: u32, place: u32, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.port.write(ADDRESS, self.port.address(bytes));
            let run = place << 15 | destination << 10 | bytes.len() as u32;
            self.port.write(RUN, run);
        }
    }

    /// Queues `count` patterns from `first` on.
    fn queue_patterns(&self, destination: u32, planes: Planes<'_>, first: usize, count: usize) {
        let mut at = first;
        for destination in (destination..).take(PATTERN_BYTES) {
            self.queue(destination, 0, part(planes.bytes, at, count));
            at += planes.stride;
        }
    }

    /// Waits until the unit has done what it was told.
    #[inline(always)]
    fn wait(&self) {
        while self.port.read(STATUS) & 1 != 0 {}
    }

    fn execute(&self, command: u32) {
        self.port.write(COMMAND, command);
        self.wait();
    }

    /// Has a command make these bytes, of so many pixels.
    #[inline(always)]
    fn make_bytes(&self, command: u32, pixels: usize, bytes: &mut [u8]) {
        if bytes.is_empty() {
            return;
        }
        self.set_shape(pixels, 0);
        let place = Window::place(bytes);
        self.execute(place << 16 | command);
        Window::Results.copy_bytes(self.port, place, bytes);
    }

    fn set_shape(&self, pixels: usize, disparities: usize) {
        self.port
            .write(SHAPE, (disparities as u32) << 8 | pixels as u32);
    }
}

impl<P: Port> Kernels for StereoUnit<P> {
    const FUSES_SELECTION: bool = true;

    forward_kernels!(set => &Portable; luma_row, channel_row, resample_row, recall_row, mask_block, aggregate_paths,
        select_row, check_row, arms_row, weighted_median_row);

    fn pack_cells(&self, samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
        let common = samples.iter().fold(packed.len(), |n, row| n.min(row.len()));
        let packed = packed.get_mut(..common).unwrap_or_default();
        let mut start = 0;
        for piece in packed.chunks_mut(PIECE_PX) {
            // Words of cells are stored as words where the first byte lies as it will in memory.
            let place = Window::place(piece);
            for (row, destination) in samples.iter().zip(SAMPLES..) {
                self.queue(destination, place, part(row, start, piece.len()));
            }
            self.wait();
            Window::Results.copy_bytes(self.port, place, piece);
            start += piece.len();
        }
    }

    fn convert_row(
        &self,
        conversion: &LevelConversion,
        levels: &[u8],
        low: &mut [u8],
        high: &mut [u8],
    ) {
        let gain = u32::from(conversion.dead_zone) << 16 | conversion.gain_q12 as u32 & 0x7fff;
        self.port.write(GAIN, gain);
        self.port.write(OFFSET, conversion.offset_q12 as u32);
        let pieces = low.chunks_mut(PIECE_PX).zip(high.chunks_mut(PIECE_PX));
        for ((low, high), levels) in pieces.zip(levels.chunks(PIECE_PX)) {
            let count = low.len().min(high.len()).min(levels.len());
            self.queue(INPUTS, 0, part(levels, 0, count));
            // The levels stay in the unit.
            for (command, row) in [(CONVERT_TO_LOWEST, low), (CONVERT_TO_HIGHEST, high)] {
                self.make_bytes(command, count, row.get_mut(..count).unwrap_or_default());
            }
        }
    }

    fn penalty_row(&self, penalty: &Penalty, own: &[u8], neighbours: &[u8], p2: &mut [u8]) {
        let Penalty {
            most,
            floor,
            adaptation_q4,
            step_min,
        } = *penalty;
        let word = u32::from_le_bytes([most, floor, adaptation_q4, step_min]);
        self.port.write(PENALTY, word);
        let rows = own.chunks(PIECE_PX).zip(neighbours.chunks(PIECE_PX));
        for (p2, (own, neighbours)) in p2.chunks_mut(PIECE_PX).zip(rows) {
            let count = p2.len().min(own.len()).min(neighbours.len());
            self.queue(INPUTS, 0, part(own, 0, count));
            self.queue(NEIGHBOURS, 0, part(neighbours, 0, count));
            self.make_bytes(PENALISE, count, p2.get_mut(..count).unwrap_or_default());
        }
    }

    fn smooth_row(&self, rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
        let rows = Rows {
            rows,
            destinations: LEVEL_ROWS,
            command: u32::from(step_max) << 8 | SMOOTH,
        };
        rows.filter(self, smoothed, |piece| piece);
    }

    fn median9_row(&self, rows: [&[i16]; 3], output: &mut [i16]) {
        let rows = Rows {
            rows,
            destinations: DISPARITY_ROWS,
            command: TAKE_MEDIANS,
        };
        rows.filter(self, output, bytemuck::must_cast_slice_mut);
    }

    fn cost_run(&self, run: &CostRun<'_>, costs: &mut [u8]) {
        let pixels = run.cell_costs_q8.len().min(run.truncations.len());
        if pixels == 0 || !self.fits(run.start + pixels, run.disparities) || costs.is_empty() {
            return;
        }
        // From the position of the last pixel's lowest disparity to that of the first pixel's highest.
        let lowest = (run.first_position + 1).saturating_sub(pixels);
        let positions = pixels + run.disparities - 1;
        self.queue_patterns(INPUTS, run.inputs, run.start, pixels);
        self.queue_patterns(STORED, run.stored, lowest, positions);
        self.queue(TRUNCATIONS, 0, run.truncations);
        self.queue(CELL_COSTS, 0, bytemuck::must_cast_slice(run.cell_costs_q8));
        if run.difference_weight_q4 > 0 {
            for (destination, [row, ..], first, count) in [
                (LEVELS, run.levels, run.start, pixels),
                (LOW, run.other_low, lowest, positions),
                (HIGH, run.other_high, lowest, positions),
            ] {
                self.queue(destination, 0, part(row, first, count));
            }
        }
        self.set_shape(pixels, run.disparities);
        let first = run.start * self.words(run.disparities);
        self.port.write(FIRST, first as u32);
        let weight = u32::from(run.difference_weight_q4);
        self.port.write(
            DIFFERENCE,
            weight << 8 | u32::from(run.difference_truncation),
        );
        self.execute(MAKE_COSTS);
    }

    fn rivals_row(&self, row: &RivalsRow<'_>, _: &mut [u32], rivals: &mut [u8]) {
        let width = row.width();
        if !self.fits(width, row.disparities) {
            return;
        }
        self.set_shape(width, row.disparities);
        let bytes = [
            row.ratio_q4,
            row.slack,
            row.rise,
            row.reach_px.min(64) as u8,
        ];
        self.port.write(RIVALS, u32::from_le_bytes(bytes));
        self.execute(FIND_RIVALS);
        for (rivals, found) in rivals.chunks_mut(32).zip(FOUND) {
            let mut found = self.port.read(found);
            for rival in rivals {
                *rival = (found & 1) as u8;
                found >>= 1;
            }
        }
    }

    fn attenuate_row(&self, row: &mut AttenuateRow<'_>) {
        self.port.write(SHIFT, row.shift.into());
        for (doubts, register) in row.doubts.chunks(32).zip(DOUBTS) {
            let bits = (0..32).zip(doubts);
            let bits = bits.fold(0, |bits, (block, &doubt)| {
                bits | u32::from(doubt > 0) << block
            });
            self.port.write(register, bits);
        }
    }

    fn aggregate_row(&self, row: &mut AggregateRow<'_>) {
        let width = row.best.len();
        if !self.fits(width, row.disparities) {
            return;
        }
        self.queue(P2_ALONG, 0, row.p2_along);
        self.queue(P2_DOWN, 0, row.p2_down);
        self.set_shape(width, row.disparities);
        let lines_min = row.subpixel.lines_min.min(LINES_MIN_MAX);
        let paths = u32::from(row.is_first) << 26
            | u32::from(lines_min) << 16
            | u32::from(row.subpixel.relief) << 8
            | u32::from(row.p1);
        self.port.write(PATHS, paths);
        self.execute(MAKE_PATHS);
        Window::Others.copy_words(self.port, row.other_best, width + row.disparities - 1);
        let outputs = row
            .best
            .iter_mut()
            .zip(row.refined_index_q4.iter_mut())
            .zip(row.margins.iter_mut());
        let words = Window::Pixels.words(self.port, width);
        for (((best, refined_index_q4), margin), word) in outputs.zip(words) {
            let index = word >> 8 & 0xff;
            *best = index as u16;
            *refined_index_q4 = ((index << 4) as i16).wrapping_add((word as i8).into());
            *margin = (word >> 16) as i16;
        }
    }
}

/// Rows that are filtered by 3 x 3 pixels: those above, of and below the row, each with one pixel more at both ends.
struct Rows<'a, T> {
    rows: [&'a [T]; 3],
    destinations: [u32; 3],
    command: u32,
}

impl<T: bytemuck::NoUninit> Rows<'_, T> {
    /// Writes what the unit makes of the rows; nothing if one is too short.
    #[inline(always)]
    fn filter<P: Port>(
        &self,
        unit: &StereoUnit<P>,
        output: &mut [T],
        bytes_of: impl Fn(&mut [T]) -> &mut [u8],
    ) {
        let needed = output.len().saturating_add(2);
        if self.rows.iter().any(|row| row.len() < needed) {
            return;
        }
        let mut start = 0;
        for piece in output.chunks_mut(PIECE_PX) {
            let count = piece.len();
            for (destination, row) in self.destinations.into_iter().zip(self.rows) {
                let run = row.get(start..start + count + 2).unwrap_or_default();
                unit.queue(destination, 0, bytemuck::cast_slice(run));
            }
            unit.make_bytes(self.command, count, bytes_of(piece));
            start += count;
        }
    }
}

/// `count` bytes from `first` on; none if there are not so many.
fn part(bytes: &[u8], first: usize, count: usize) -> &[u8] {
    let part = bytes.get(first..first.saturating_add(count));
    part.unwrap_or_default()
}
