//! Weighted median over a wide, flat window: moves edges of disparity to edges of colour.
//!
//! Every other pixel of every other row of the window is a tap. The weight of a tap is the greater,
//! the more similar its colour is to the centre's and the nearer it is. The result is the smallest
//! disparity at or below which lies at least half of the weight. Taps outside the image or without
//! a disparity have no weight.

use super::unpack::MAX_CHANNELS;
use crate::disparity::INVALID;

/// Largest number of rows of taps of a window.
pub const MAX_TAP_ROWS: usize = 7;

/// Pixels filtered side by side.
const LANES: usize = 16;

/// A row to filter, and the rows around it.
#[derive(Debug, Clone, Copy)]
pub struct WeightedMedianRow<'a> {
    /// Rows of disparities that have taps, from the top. Each has as many values more at both
    /// ends as the window reaches, [`INVALID`] outside the image.
    pub values: [&'a [i16]; MAX_TAP_ROWS],
    /// Levels of each channel at these rows, padded likewise.
    pub levels: [[&'a [u8]; MAX_TAP_ROWS]; MAX_CHANNELS],
    /// Levels of each channel at the filtered row, without padding.
    pub centres: [&'a [u8]; MAX_CHANNELS],
    /// Number of rows in use.
    pub rows: usize,
    /// Index of the filtered row among them.
    pub centre: usize,
    /// Number of channels in use: 1 or 3.
    pub channels: usize,
    /// Number of columns of the window.
    pub window_width: usize,
    /// Weight of each tap by its distance from the centre, row by row, 1/16.
    pub places: &'a [u8],
    /// Difference of colour, summed over three channels, from which on a tap has no weight.
    pub colour_reach: u8,
}

impl WeightedMedianRow<'_> {
    /// Columns of the taps, counted from the window's first.
    #[inline(always)]
    pub fn tap_columns(&self) -> impl ExactSizeIterator<Item = usize> + use<> {
        (0..self.window_width).step_by(2)
    }
}

/// Writes the weighted median of each pixel of `row` to `output`, or [`INVALID`] if no tap has a
/// weight. `weights` is scratch of 16 bytes per tap.
#[inline(always)]
pub fn weighted_median_row(row: &WeightedMedianRow<'_>, weights: &mut [u8], output: &mut [i16]) {
    let width = output.len();
    if width < LANES {
        for x in 0..width {
            filter_block::<1>(row, x, weights, output);
        }
        return;
    }
    // The last block overlaps the one before it, so that nothing remains.
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
                // A likeness is at most 48, its square divided by 16 at most 144, and a weight at
                // most 180.
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
    // Bisection for the smallest value at or below which lies at least half of the weight.
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec;
    use std::vec::Vec;

    /// Compared with sorting the taps of each pixel and summing their weights.
    #[test]
    fn half_of_the_weight_lies_at_or_below_the_median() {
        for seed in 0..60 {
            let mut random = Pcg32::seed_from_u64(seed);
            let mut below = |bound: usize| random.next_u32() as usize % bound;
            let (width, reach) = (1 + below(40), 2 * below(4));
            let rows = 1 + below(MAX_TAP_ROWS);
            let (centre, channels) = (below(rows), [1, 3][below(2)]);
            let padded = width + 2 * reach;
            let values: Vec<Vec<i16>> = (0..rows)
                .map(|_| {
                    (0..padded)
                        .map(|_| [INVALID, 0, 3, 50, 51][below(5)])
                        .collect()
                })
                .collect();
            let levels: Vec<Vec<Vec<u8>>> = (0..channels)
                .map(|_| {
                    (0..rows)
                        .map(|_| (0..padded).map(|_| below(20) as u8).collect())
                        .collect()
                })
                .collect();
            let taps = rows * (reach + 1);
            let places: Vec<u8> = (0..taps).map(|_| 1 + below(20) as u8).collect();
            let mut row = WeightedMedianRow {
                values: [&[]; MAX_TAP_ROWS],
                levels: [[&[]; MAX_TAP_ROWS]; MAX_CHANNELS],
                centres: [&[]; MAX_CHANNELS],
                rows,
                centre,
                channels,
                window_width: 2 * reach + 1,
                places: &places,
                colour_reach: 4 + below(45) as u8,
            };
            for (to, values) in row.values.iter_mut().zip(&values) {
                *to = values;
            }
            for (channel, levels) in levels.iter().enumerate() {
                for (to, levels) in row.levels[channel].iter_mut().zip(levels) {
                    *to = levels;
                }
                row.centres[channel] = &levels[centre][reach..reach + width];
            }
            let mut output = vec![9; width];
            weighted_median_row(&row, &mut vec![1; 16 * taps], &mut output);
            for (x, &found) in output.iter().enumerate() {
                let mut weighed = vec![];
                for (tap, &place) in places.iter().enumerate() {
                    let (line, column) = (tap / (reach + 1), x + tap % (reach + 1) * 2);
                    let difference: i32 = levels
                        .iter()
                        .map(|levels| {
                            let own = i32::from(levels[centre][x + reach]);
                            (own - i32::from(levels[line][column])).abs()
                        })
                        .sum::<i32>()
                        * if channels == 1 { 3 } else { 1 };
                    let likeness = (i32::from(row.colour_reach) - difference).max(0);
                    let weight = likeness * likeness / 16 * i32::from(place) / 16;
                    if values[line][column] != INVALID && weight > 0 {
                        weighed.push((values[line][column], weight));
                    }
                }
                weighed.sort_unstable();
                let total: i32 = weighed.iter().map(|&(_, weight)| weight).sum();
                let mut sum = 0;
                let half = weighed.iter().find(|&&(_, weight)| {
                    sum += weight;
                    2 * sum >= total
                });
                let expected = half.map_or(INVALID, |&(value, _)| value);
                assert_eq!(found, expected, "seed {seed}, column {x}");
            }
        }
    }
}
