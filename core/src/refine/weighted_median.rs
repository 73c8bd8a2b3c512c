//! Weighted median over a wide, flat window: edges of disparity move to edges of colour.
//!
//! Every other pixel of every other row of the window is a tap. It weighs the more, the more
//! its colour is like the centre's and the nearer it is; the result is the smallest disparity at
//! or below which lies half of the weight. Taps outside the image or without a disparity weigh
//! nothing.

use super::ring::RowRing;
use crate::config::WeightedMedianParameters;
use crate::disparity::INVALID;
use crate::kernel::Kernels;
use crate::matching::MAX_CHANNELS;
use crate::memory::{Arena, OutOfMemory, words};
use crate::strip::Strip;

/// Most rows of taps.
const MAX_ROWS: usize = WeightedMedianParameters::MAX_ROWS;

/// Pixels filtered side by side.
const LANES: usize = 16;

/// A weighted median over a ring of `2 reach_y + 1` rows.
#[derive(Debug)]
pub struct WeightedMedian<'m, K> {
    kernels: K,
    rows: RowRing<'m>,
    /// Weight by place, one per tap, row by row.
    places: &'m mut [u8],
    /// Weights of the taps, `LANES` centres side by side.
    weights: &'m mut [u8],
    parameters: WeightedMedianParameters,
}

impl WeightedMedian<'_, ()> {
    /// Words of memory: `2 y + 1` rows and 17 bytes per tap.
    #[must_use]
    pub const fn memory_words(width: usize, parameters: WeightedMedianParameters) -> usize {
        let depth = 2 * parameters.reach_y_px as usize + 1;
        RowRing::memory_words(width, parameters.reach_x_px as usize, depth)
            + words(parameters.tap_count(), 1)
            + words(parameters.tap_count() * LANES, 1)
    }
}

impl<'m, K: Kernels> WeightedMedian<'m, K> {
    /// A weighted median for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`WeightedMedian::memory_words`] left.
    pub fn new(
        width: usize,
        parameters: WeightedMedianParameters,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let padding = parameters.reach_x_px.into();
        let depth = 2 * usize::from(parameters.reach_y_px) + 1;
        let ahead = parameters.reach_y_px;
        let rows = RowRing::new(width, padding, depth, ahead, INVALID, arena)?;
        let places: &'m mut [u8] = arena.take(parameters.tap_count())?;
        for (place, offset) in places.iter_mut().zip(parameters.taps()) {
            *place = WeightedMedianParameters::place_weight(offset);
        }
        Ok(Self {
            kernels,
            rows,
            places,
            weights: arena.take(parameters.tap_count() * LANES)?,
            parameters,
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        self.rows.reset();
    }

    /// Takes a row; when this completes one, puts that in its place and returns true.
    /// `channels` are the reference view's, with the rows of the window still there; row
    /// 0 of the rings is line `first_line` of theirs.
    pub fn push(&mut self, row: &mut [i16], channels: &[Strip<'_>], first_line: u32) -> bool {
        let line = self.rows.push(row);
        self.filter(line, row, channels, first_line)
    }

    /// After the last row: completes the next of the rows still to come; false when
    /// there are no more.
    pub fn flush(&mut self, row: &mut [i16], channels: &[Strip<'_>], first_line: u32) -> bool {
        let line = self.rows.flush();
        self.filter(line, row, channels, first_line)
    }

    fn filter(
        &mut self,
        line: Option<u32>,
        output: &mut [i16],
        channels: &[Strip<'_>],
        first_line: u32,
    ) -> bool {
        let Some(line) = line else { return false };
        let reach_x = usize::from(self.parameters.reach_x_px);
        let width = output.len();
        // Rows of taps; the window's first ones may lie above the frame.
        let most = u32::from(self.parameters.reach_y_px / 2);
        let above = most.min(line / 2);
        let below = most.min((self.rows.rows_in() - 1 - line) / 2);
        let rows = (line - 2 * above..=line + 2 * below).step_by(2);
        let skipped = (most - above) as usize * self.parameters.taps_per_row();
        let mut row = WeightedMedianRow {
            values: [&[]; MAX_ROWS],
            levels: [[&[]; MAX_ROWS]; MAX_CHANNELS],
            centres: [&[]; MAX_CHANNELS],
            rows: rows.clone().count().min(MAX_ROWS),
            channels: channels.len().min(MAX_CHANNELS),
            centre: above as usize,
            window_width: 2 * reach_x + 1,
            places: self.places.get(skipped..).unwrap_or_default(),
            colour_reach: self.parameters.colour_reach,
        };
        for (values, line) in row.values.iter_mut().zip(rows.clone()) {
            *values = self.rows.padded(line);
        }
        for (channel, (levels, centre)) in channels
            .iter()
            .zip(row.levels.iter_mut().zip(&mut row.centres))
        {
            *centre = channel.row(first_line + line);
            for (levels, line) in levels.iter_mut().zip(rows.clone()) {
                *levels = channel.run(first_line + line, -(reach_x as isize), width + 2 * reach_x);
            }
        }
        self.kernels.weighted_median_row(&row, self.weights, output);
        true
    }
}

/// A row to filter, and the rows around it.
#[derive(Debug, Clone, Copy)]
pub struct WeightedMedianRow<'a> {
    /// The rows of disparities that have taps, from the top, each with the window's reach of
    /// padding on both sides, [`INVALID`] outside.
    pub values: [&'a [i16]; MAX_ROWS],
    /// The same rows of each channel, padded likewise.
    pub levels: [[&'a [u8]; MAX_ROWS]; MAX_CHANNELS],
    /// The filtered row of each channel, without padding.
    pub centres: [&'a [u8]; MAX_CHANNELS],
    /// Rows in use.
    pub rows: usize,
    /// Which of them is the filtered one.
    pub centre: usize,
    /// Channels in use: 1 or 3.
    pub channels: usize,
    /// Columns of the window.
    pub window_width: usize,
    /// Weight by place of each tap, row by row, 1/16.
    pub places: &'a [u8],
    /// Difference of colour at which nothing weighs any more.
    pub colour_reach: u8,
}

impl WeightedMedianRow<'_> {
    /// Columns of the taps, from the window's first.
    #[inline(always)]
    pub fn tap_columns(&self) -> impl ExactSizeIterator<Item = usize> + use<> {
        (0..self.window_width).step_by(2)
    }
}

/// Filters a row into `output`; inlined so that a caller may compile it for its own
/// instruction set. `weights` is scratch of 16 bytes per tap.
///
/// A pixel without any weight around it, its own included, stays without a disparity.
#[inline(always)]
pub fn weighted_median_row(row: &WeightedMedianRow<'_>, weights: &mut [u8], output: &mut [i16]) {
    let width = output.len();
    if width < LANES {
        for x in 0..width {
            filter_block::<1>(row, x, weights, output);
        }
        return;
    }
    // The last block overlaps the one before rather than leave a rest.
    for x in (0..width).step_by(LANES) {
        filter_block::<LANES>(row, x.min(width - LANES), weights, output);
    }
}

/// Filters `N` pixels from `x` on.
#[inline(always)]
fn filter_block<const N: usize>(
    row: &WeightedMedianRow<'_>,
    x: usize,
    weights: &mut [u8],
    output: &mut [i16],
) {
    let mut centres = [[0_u8; N]; MAX_CHANNELS];
    for (centre, levels) in centres.iter_mut().zip(row.centres).take(row.channels) {
        if let Some(run) = run_at(levels, x) {
            *centre = *run;
        }
    }
    // Grey counts as three equal channels.
    let times = if row.channels == 1 { 3 } else { 1 };
    let mut totals = [0_u16; N];
    let mut low = [i16::MAX; N];
    let mut high = [i16::MIN; N];
    let (weights, _) = weights.as_chunks_mut::<N>();
    let mut taps = weights.iter_mut().zip(row.places);
    for (index, values) in row.values.iter().enumerate().take(row.rows) {
        for dx in row.tap_columns() {
            let (Some((weights, &place)), Some(values)) =
                (taps.next(), run_at::<_, N>(values, x + dx))
            else {
                return;
            };
            let mut differences = [0_u8; N];
            for (levels, centre) in row.levels.iter().zip(&centres).take(row.channels) {
                let Some(levels) = levels
                    .get(index)
                    .and_then(|levels| run_at::<_, N>(levels, x + dx))
                else {
                    return;
                };
                for lane in 0..N {
                    differences[lane] =
                        differences[lane].saturating_add(centre[lane].abs_diff(levels[lane]));
                }
            }
            for lane in 0..N {
                // At most 48, squared and divided 144, by place 180.
                let difference = u16::from(differences[lane]) * times;
                let likeness = u16::from(row.colour_reach).saturating_sub(difference);
                let weight = (((likeness * likeness) >> 4) * u16::from(place)) >> 4;
                let weight = if values[lane] == INVALID { 0 } else { weight };
                totals[lane] += weight;
                weights[lane] = weight as u8;
                let weighs = weight > 0;
                low[lane] = low[lane].min(if weighs { values[lane] } else { i16::MAX });
                high[lane] = high[lane].max(if weighs { values[lane] } else { i16::MIN });
            }
        }
    }
    // Bisection: the smallest value at or below which lies half of the weight.
    while low.iter().zip(&high).any(|(low, high)| low < high) {
        let mut middle = [0_i16; N];
        for lane in 0..N {
            // Rounded down, without overflow.
            middle[lane] = (low[lane] & high[lane]) + ((low[lane] ^ high[lane]) >> 1);
        }
        let mut below = [0_u16; N];
        let mut taps = weights.iter();
        for values in row.values.iter().take(row.rows) {
            for dx in row.tap_columns() {
                let (Some(weights), Some(values)) = (taps.next(), run_at::<_, N>(values, x + dx))
                else {
                    return;
                };
                for lane in 0..N {
                    let counts = u16::from(values[lane] <= middle[lane]);
                    below[lane] += u16::from(weights[lane]) & counts.wrapping_neg();
                }
            }
        }
        for lane in 0..N {
            let is_open = low[lane] < high[lane];
            let at_or_below = below[lane] >= totals[lane] - below[lane];
            high[lane] = if is_open && at_or_below {
                middle[lane]
            } else {
                high[lane]
            };
            low[lane] = if is_open && !at_or_below {
                middle[lane] + 1
            } else {
                low[lane]
            };
        }
    }
    if let Some(output) = output.get_mut(x..x + N) {
        for lane in 0..N {
            output[lane] = if totals[lane] == 0 {
                INVALID
            } else {
                low[lane]
            };
        }
    }
}

/// `N` values from `start` on.
#[inline(always)]
fn run_at<T, const N: usize>(values: &[T], start: usize) -> Option<&[T; N]> {
    values.get(start..)?.first_chunk()
}
