//! The medians at the end of the refinement: of 3 x 3 pixels, and weighted by colour.
//!
//! Rows are disparities counted from the lowest, 1/16 px.

use super::surroundings::Surroundings;
use crate::config::WeightedMedianParameters;
use crate::kernel::{Kernels, MAX_CHANNELS, MAX_TAP_ROWS, WeightedMedianRow};
use crate::rows::{Arena, OutOfMemory, Part, RowStage, RowWindow, words};

/// Number of pixels whose weights are in memory at a time.
const LANES: usize = 16;

/// A median of 3 x 3 pixels over a ring of three rows.
///
/// At the edges, the nearest pixel stands in for one outside. A pixel without a disparity counts as
/// the smallest value.
#[derive(Debug)]
pub(super) struct Median9<'m, K> {
    kernels: K,
    window: RowWindow<'m>,
}

impl Median9<'_, ()> {
    /// Demand of the median: three rows, and a line of latency.
    pub(super) const fn part(width: usize) -> Part {
        Part {
            name: "median of 3 x 3",
            words: RowWindow::words(width, 1, 1),
            look_back_lines: 0,
            latency_lines: 1,
        }
    }
}

impl<'m, K: Kernels> Median9<'m, K> {
    /// A median for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has less left than [`Median9::part`] says.
    pub(super) fn new(
        width: usize,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        Ok(Self {
            kernels,
            window: RowWindow::new(width, 1, 1, arena)?,
        })
    }

    /// Writes the medians of row `line` to `output`, if there is such a row; returns whether there
    /// is.
    fn filter(&mut self, line: Option<u32>, output: &mut [i16]) -> bool {
        let (Some(line), Some(output)) = (line, output.get_mut(..self.window.rows.width())) else {
            return false;
        };
        let kept = &self.window.rows;
        let rows = [line.saturating_sub(1), line, line + 1].map(|line| kept.padded(line));
        self.kernels.median9_row(rows, output);
        true
    }
}

impl<C, K: Kernels> RowStage<C> for Median9<'_, K> {
    fn reset(&mut self) {
        self.window.clear();
    }

    fn push(&mut self, row: &mut [i16], _: &mut C) -> bool {
        let newest = self.window.rows.rows_in();
        let due = self.window.push(row);
        self.window.rows.replicate_edges(newest);
        self.filter(due, row)
    }

    fn flush(&mut self, row: &mut [i16], _: &mut C) -> bool {
        let next = self.window.flush();
        self.filter(next, row)
    }
}

/// A weighted median over a ring of `2 reach_y + 1` rows: see
/// [`weighted_median_row`](crate::kernel::weighted_median_row).
#[derive(Debug)]
pub(super) struct WeightedMedian<'m, K> {
    kernels: K,
    window: RowWindow<'m>,
    /// Weight of each tap by its distance, row by row.
    places: &'m mut [u8],
    /// Scratch: the weights of the taps of `LANES` pixels.
    weights: &'m mut [u8],
    parameters: WeightedMedianParameters,
}

impl WeightedMedian<'_, ()> {
    /// Demand of the median: `2 y + 1` rows and 17 bytes per tap. It reads back over its window of
    /// `2 y + 1` lines, and has a latency of `y` lines.
    pub(super) const fn part(width: usize, parameters: &WeightedMedianParameters) -> Part {
        let reach = parameters.reach_y_px as u32;
        let padding = parameters.reach_x_px as usize;
        Part {
            name: "weighted median",
            words: RowWindow::words(width, padding, parameters.reach_y_px)
                + words(parameters.tap_count(), 1)
                + words(parameters.tap_count() * LANES, 1),
            look_back_lines: 2 * reach,
            latency_lines: reach,
        }
    }
}

impl<'m, K: Kernels> WeightedMedian<'m, K> {
    /// A weighted median for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has less left than [`WeightedMedian::part`] says.
    pub(super) fn new(
        width: usize,
        parameters: WeightedMedianParameters,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let padding = parameters.reach_x_px.into();
        let window = RowWindow::new(width, padding, parameters.reach_y_px, arena)?;
        let places: &'m mut [u8] = arena.take(parameters.tap_count())?;
        for (place, offset) in places.iter_mut().zip(parameters.taps()) {
            *place = WeightedMedianParameters::place_weight(offset);
        }
        Ok(Self {
            kernels,
            window,
            places,
            weights: arena.take(parameters.tap_count() * LANES)?,
            parameters,
        })
    }

    /// Writes the medians of row `line` to `output`, if there is such a row; returns whether there
    /// is.
    fn filter(
        &mut self,
        line: Option<u32>,
        output: &mut [i16],
        around: &Surroundings<'_, '_, '_>,
    ) -> bool {
        let Some(line) = line else { return false };
        let (channels, first_line) = (around.channels, around.first_line);
        let reach_x = usize::from(self.parameters.reach_x_px);
        let width = output.len();
        // Rows of taps; the first ones of the window may lie above the frame.
        let most = u32::from(self.parameters.reach_y_px / 2);
        let above = most.min(line / 2);
        let below = most.min((self.window.rows.rows_in() - 1 - line) / 2);
        let rows = (line - 2 * above..=line + 2 * below).step_by(2);
        let skipped = (most - above) as usize * self.parameters.taps_per_row();
        let mut row = WeightedMedianRow {
            values: [&[]; MAX_TAP_ROWS],
            levels: [[&[]; MAX_TAP_ROWS]; MAX_CHANNELS],
            centres: [&[]; MAX_CHANNELS],
            rows: rows.clone().count().min(MAX_TAP_ROWS),
            channels: K::SCOPE.channels(channels.len()).min(MAX_CHANNELS),
            centre: above as usize,
            window_width: 2 * reach_x + 1,
            places: self.places.get(skipped..).unwrap_or_default(),
            colour_reach: self.parameters.colour_reach,
        };
        for (values, line) in row.values.iter_mut().zip(rows.clone()) {
            *values = self.window.rows.padded(line);
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

impl<K: Kernels> RowStage<Surroundings<'_, '_, '_>> for WeightedMedian<'_, K> {
    const IS_IN_SCOPE: bool = K::SCOPE.weighted_median;

    fn reset(&mut self) {
        self.window.clear();
    }

    fn push(&mut self, row: &mut [i16], around: &mut Surroundings<'_, '_, '_>) -> bool {
        let due = self.window.push(row);
        self.filter(due, row, around)
    }

    fn flush(&mut self, row: &mut [i16], around: &mut Surroundings<'_, '_, '_>) -> bool {
        let next = self.window.flush();
        self.filter(next, row, around)
    }
}
