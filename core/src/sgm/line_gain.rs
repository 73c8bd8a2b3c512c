//! Line gain: the brightness of single lines of the other view, against that of the reference view.
//!
//! Mains light flickers while the lines of a rolling shutter are exposed, one after another: dark and
//! bright bands lie across the picture, elsewhere in either view unless both shutters run in step. Noise
//! of whole rows looks alike. Exposure, which is learned from the matches above, comes too late for
//! either. The mean level of a line is known before it is matched, and the two cameras see nearly the
//! same in a line, so that their means move together from line to line. What moves one of them alone is
//! taken for brightness, and the levels of the other view's line are converted by it.
//!
//! A difference of exposure must not be taken for that. Where one view is a gain times the other, the
//! ratio of the means stays; where an offset is added, their difference does; and under both, the
//! difference of one mean from the learned gain times the other. So a line must deviate in the ratio and
//! in that difference, in the same sense, and counts with the smaller of the two deviations. Both must
//! also change quickly from line to line, unlike what is seen by one camera alone.
//!
//! Light multiplies levels, noise of rows is added to them. Which of the two it is, the spread of the
//! levels of a line about their mean tells, which the one changes and the other does not.

use core::ops::Range;

use crate::disparity::DisparityRange;
use crate::kernel::LevelConversion;
use crate::kernel::lanes::{LANES, Lanes, add, in_order, lanes_of};
use crate::rows::NewestRows;

/// Smallest number of pixels that are compared.
const PIXELS_MIN: usize = 16;
/// Running means of lines: they move by 1/128 of the difference with every line.
const MEAN_SHIFT: u32 = 7;
/// Running means of the steps from line to line: they move by 1/8.
const STEP_SHIFT: u32 = 3;
/// Fading of the sums of products: they lose 1/32 with every line.
const FADING_SHIFT: u32 = 5;
/// Deviations up to this, 1/65536, are as views differ without any disturbance: 2 %. From twice that on
/// a deviation counts whole.
const DEAD_ZONE_Q16: i32 = 1311;
/// Mean step from line to line, 1/65536, below which nothing is mended: 1.2 %. Without any disturbance
/// it is 0.3 to 0.8 %.
const STEP_MIN_Q16: i32 = 786;
/// Means and spreads are not taken for less than this, 1/256 level, so that ratios stay bounded.
const LEVEL_MIN_Q8: u32 = 1 << 8;
/// One, 1/65536.
const ONE_Q16: i32 = 1 << 16;

/// The running estimate of how bright the lines of both views are.
#[derive(Debug)]
pub(super) struct LineGain {
    /// Largest deviation that is mended, 1/65536; 0 mends nothing.
    deviation_max_q16: i32,
    /// Stored positions that are left out of both views, as the other one is not likely to show what is
    /// there: at the beginning of a line if above 0, else at its end.
    left_out: isize,
    seen: Option<Seen>,
}

/// Means over the lines of a frame that have come, of which there is at least one.
#[derive(Debug)]
struct Seen {
    /// Running mean of the means of lines.
    mean: Levels,
    /// Running mean of that. It lags behind as much again, so that a steady change can be followed.
    mean_again: Levels,
    /// Running mean of the spreads of lines.
    spread: Levels,
    /// Means of the line above.
    above: Levels,
    /// Running means of the magnitudes of the steps from line to line.
    steps: Deviation,
    /// Faded sum of the squares of the deviations of the ratio of the means, 1/2^24.
    squares_q24: i64,
    /// Faded sum of their products with those of the ratio of the spreads, likewise.
    products_q24: i64,
}

/// A value of the reference view and one of the other view, 1/256 level, at least [`LEVEL_MIN_Q8`].
#[derive(Debug, Clone, Copy)]
struct Levels {
    own_q8: u32,
    other_q8: u32,
}

/// How much brighter a line is in the reference view than the other view's line lets expect, measured in
/// two ways, 1/65536, from -2 to 2. A line that is `r` times as bright as expected has the deviation
/// `2 (r - 1) / (r + 1)`, and one that is `1 / r` times as bright the negative of that.
#[derive(Debug, Clone, Copy)]
struct Deviation {
    /// Deviation of the ratio of the reference view's mean level to the other view's.
    ratio_q16: i32,
    /// Deviation of the mean level of the reference view, where the other view's mean level times the
    /// learned gain tells by how much it should have changed.
    difference_q16: i32,
}

impl LineGain {
    /// An estimate before any line has come. Gains are at most `1 + gain_max_q8 / 256`, and at least the
    /// inverse of that; 0 mends nothing.
    pub(super) const fn new(gain_max_q8: u8, disparities: DisparityRange) -> Self {
        let most = gain_max_q8 as i32;
        Self {
            deviation_max_q16: (most << 17) / (512 + most),
            // Most of a scene is farther away than a quarter of the search range.
            left_out: disparities.minimum_px as isize + disparities.count as isize / 4,
            seen: None,
        }
    }

    /// Forgets the frame.
    pub(super) fn reset(&mut self) {
        self.seen = None;
    }

    /// How the levels of the other view's newest line are to be converted; `None` if they are to stay.
    /// `exposure_gain_q12` is the learned gain of the other camera's levels to the reference camera's,
    /// 1/4096.
    pub(super) fn conversion(
        &mut self,
        rows: &NewestRows<'_>,
        exposure_gain_q12: i32,
    ) -> Option<LevelConversion> {
        if self.deviation_max_q16 == 0 {
            return None;
        }
        let (mean, spread) = measure(self.parts(rows))?;
        let Some(seen) = &mut self.seen else {
            self.seen = Some(Seen::new(mean, spread));
            return None;
        };
        let deviation = seen.learn(mean, spread, exposure_gain_q12);
        if seen.steps.least_q16() < STEP_MIN_Q16 {
            return None;
        }
        let most = self.deviation_max_q16;
        // Not `clamp`, which would have to be proved not to panic.
        let deviation_q16 = deviation.common_q16().max(-most).min(most);
        // The ratio whose deviation this is, 1/2 to 2.
        let (above, below) = (2 * ONE_Q16 + deviation_q16, 2 * ONE_Q16 - deviation_q16);
        let ratio_q12 = ((above << 12) as u32 / (below as u32).max(1)) as i32;
        // The share of it that multiplies; the rest is added, as much as it is at the mean level.
        let gain_q12 = 4096 + (((ratio_q12 - 4096) * seen.gain_share_q8()) >> 8);
        let offset_q12 = ((ratio_q12 - gain_q12) * mean.other_q8 as i32) >> 8;
        Some(LevelConversion {
            gain_q12,
            offset_q12,
            dead_zone: 0,
        })
    }

    /// The parts of both rows that show what the other view is likely to show too.
    fn parts<'a>(&self, rows: &NewestRows<'a>) -> [&'a [u8]; 2] {
        let width = rows.levels[0].len();
        // The views are stored against each other, so that the same positions are left out of both.
        let kept = match usize::try_from(self.left_out) {
            Ok(first) => first..width,
            Err(_) => 0..width.saturating_sub(self.left_out.unsigned_abs()),
        };
        let part = |row: &'a [u8], valid: &Range<usize>| {
            let part = row.get(kept.start.max(valid.start)..kept.end.min(valid.end));
            part.unwrap_or_default()
        };
        let [own, other] = rows.levels;
        let [own_valid, other_valid] = &rows.valid;
        [part(own, own_valid), part(other, other_valid)]
    }
}

impl Seen {
    /// The means after the first line, which are its own.
    fn new(mean: Levels, spread: Levels) -> Self {
        Self {
            mean,
            mean_again: mean,
            spread,
            above: mean,
            steps: Deviation {
                ratio_q16: 0,
                difference_q16: 0,
            },
            squares_q24: 0,
            products_q24: 0,
        }
    }

    /// Learns from the mean and the spread of a line, and returns the deviation of its mean.
    fn learn(&mut self, mean: Levels, spread: Levels, exposure_gain_q12: i32) -> Deviation {
        let expected = self.mean.ahead_of(&self.mean_again);
        let deviation = mean.deviation(&expected, exposure_gain_q12);
        let step = mean.deviation(&self.above, exposure_gain_q12);
        self.above = mean;
        self.mean.approach(&mean);
        self.mean_again.approach(&self.mean);
        self.steps.approach(&step);

        let of_means = i64::from(deviation.ratio_q16);
        let of_spreads = i64::from(spread.ratio_deviation_q16(&self.spread));
        self.spread.approach(&spread);
        self.squares_q24 += ((of_means * of_means) >> 8) - (self.squares_q24 >> FADING_SHIFT);
        self.products_q24 += ((of_means * of_spreads) >> 8) - (self.products_q24 >> FADING_SHIFT);
        deviation
    }

    /// The share of deviations that spreads follow, as if levels were multiplied, 0 to 256.
    fn gain_share_q8(&self) -> i32 {
        let share_q8 = (self.products_q24 << 8).checked_div(self.squares_q24);
        share_q8.unwrap_or(256).clamp(0, 256) as i32
    }
}

impl Levels {
    /// How much brighter these mean levels are in the reference view than the other view lets expect by
    /// those `before`.
    fn deviation(&self, before: &Self, exposure_gain_q12: i32) -> Deviation {
        let change = |now_q8: u32, before_q8: u32| i64::from(now_q8) - i64::from(before_q8);
        let other_change = change(self.other_q8, before.other_q8);
        let difference = change(self.own_q8, before.own_q8)
            - ((i64::from(exposure_gain_q12) * other_change) >> 12);
        Deviation {
            ratio_q16: self.ratio_deviation_q16(before),
            // Less the difference is what the level would be without it.
            difference_q16: relative_q16(difference, 2 * i64::from(self.own_q8) - difference),
        }
    }

    /// The deviation of the ratio of both values from that `before`, 1/65536; see [`Deviation`].
    fn ratio_deviation_q16(&self, before: &Self) -> i32 {
        let product = |a_q8: u32, b_q8: u32| i64::from(a_q8) * i64::from(b_q8);
        let own = product(self.own_q8, before.other_q8);
        let other = product(self.other_q8, before.own_q8);
        relative_q16(own - other, own + other)
    }

    /// Moves these running means towards the values of a line.
    fn approach(&mut self, line: &Self) {
        let towards = |mean_q8: u32, line_q8: u32| {
            // Values fit 16 bits, and a mean stays between them.
            mean_q8.wrapping_add_signed((line_q8 as i32 - mean_q8 as i32) >> MEAN_SHIFT)
        };
        self.own_q8 = towards(self.own_q8, line.own_q8);
        self.other_q8 = towards(self.other_q8, line.other_q8);
    }

    /// As far beyond these running means as they are beyond `again`, the running means of them.
    fn ahead_of(&self, again: &Self) -> Self {
        let ahead = |mean_q8: u32, again_q8: u32| {
            let ahead_q8 = (2 * mean_q8).saturating_sub(again_q8);
            ahead_q8.max(LEVEL_MIN_Q8)
        };
        Self {
            own_q8: ahead(self.own_q8, again.own_q8),
            other_q8: ahead(self.other_q8, again.other_q8),
        }
    }
}

impl Deviation {
    /// Moves these running means of magnitudes towards that of a step.
    fn approach(&mut self, step: &Self) {
        self.ratio_q16 += (step.ratio_q16.abs() - self.ratio_q16) >> STEP_SHIFT;
        self.difference_q16 += (step.difference_q16.abs() - self.difference_q16) >> STEP_SHIFT;
    }

    /// The smaller of both magnitudes.
    fn least_q16(&self) -> i32 {
        self.ratio_q16.abs().min(self.difference_q16.abs())
    }

    /// What both measures have in common and the dead zone does not explain.
    fn common_q16(&self) -> i32 {
        let beyond_q16 = self.least_q16() - DEAD_ZONE_Q16;
        let counted_q16 = self.least_q16().min(2 * beyond_q16.max(0));
        match (self.ratio_q16 > 0, self.difference_q16 > 0) {
            (true, true) => counted_q16,
            (false, false) => -counted_q16,
            _ => 0,
        }
    }
}

/// Twice the share of `part` in `whole`, 1/65536, limited to -2 to 2.
fn relative_q16(part: i64, whole: i64) -> i32 {
    // A part has at most 34 bits.
    let share_q16 = (part << 17).checked_div(whole).unwrap_or(0);
    let most = i64::from(2 * ONE_Q16);
    share_q16.clamp(-most, most) as i32
}

/// Mean and spread of both rows, without as large a share of the brightest pixels as is clipped in
/// either, and so lost there; `None` if too few are left.
fn measure([own, other]: [&[u8]; 2]) -> Option<(Levels, Levels)> {
    let clipped = count_highest(own);
    let other_clipped = count_highest(other);
    let (own_q8, own_spread_q8) = measure_row(
        own,
        clipped.max((other_clipped * own.len()).checked_div(other.len())?),
    )?;
    let (other_q8, other_spread_q8) = measure_row(
        other,
        other_clipped.max((clipped * other.len()).checked_div(own.len())?),
    )?;
    let levels = |own_q8: u32, other_q8: u32| Levels {
        own_q8: own_q8.max(LEVEL_MIN_Q8),
        other_q8: other_q8.max(LEVEL_MIN_Q8),
    };
    Some((
        levels(own_q8, other_q8),
        levels(own_spread_q8, other_spread_q8),
    ))
}

/// Mean and spread of a row without its `left_out` brightest pixels, 1/256 level; `None` if too few are
/// left. The spread is the mean distance of every fourth pixel from the mean.
fn measure_row(row: &[u8], left_out: usize) -> Option<(u32, u32)> {
    let kept = row.len().checked_sub(left_out)?;
    if kept < PIXELS_MIN {
        return None;
    }
    // A line has less than 2^16 pixels, so that sums over it fit 24 bits.
    let (sum, top) = match left_out {
        0 => (sum(row), u8::MAX),
        _ => sum_without_brightest(row, left_out),
    };
    let mean_q8 = (sum << 8) / (kept as u32).max(1);
    let (mut distances_q4, mut count) = (0_u32, 0_u32);
    for &level in row.iter().step_by(4) {
        if level <= top {
            distances_q4 += (u32::from(level) << 8).abs_diff(mean_q8) >> 4;
            count += 1;
        }
    }
    Some((mean_q8, (distances_q4 << 4) / count.max(1)))
}

/// Sum of a row without its `left_out` brightest pixels, and the highest level that is left.
fn sum_without_brightest(row: &[u8], left_out: usize) -> (u32, u8) {
    // The lowest level that at most so many pixels are above.
    let (mut low, mut high) = (0, u8::MAX);
    while low < high {
        let middle = low + (high - low) / 2;
        if count_above(row, middle) <= left_out {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    let sums = row.iter().filter(|&&level| level <= low);
    let sum: u32 = sums.map(|&level| u32::from(level)).sum();
    // Of the highest level, some may have to be left out too.
    let too_many = left_out.saturating_sub(count_above(row, low)) as u32;
    (sum.wrapping_sub(too_many * u32::from(low)), low)
}

/// Sum of a row, four pixels at a time.
fn sum(row: &[u8]) -> u32 {
    let (words, rest) = row.as_chunks::<LANES>();
    let rest: u32 = rest.iter().map(|&level| u32::from(level)).sum();
    // Two sums of 16 bits in each, which 257 levels fit.
    let of_words = words.chunks(256).map(|words| {
        let mut sums = Lanes::default();
        for word in words {
            add(&mut sums, lanes_of(u32::from_le_bytes(*word)));
        }
        in_order(sums).into_iter().sum::<u32>()
    });
    rest + of_words.sum::<u32>()
}

/// Number of pixels of a row at the highest level, of which there mostly are none.
fn count_highest(row: &[u8]) -> usize {
    let (words, rest) = row.as_chunks::<LANES>();
    // A byte of the highest level is 0 in the complement. The lowest of these borrows, and so its top bit
    // becomes 1.
    let borrows = words.iter().fold(0, |borrows, word| {
        let word = u32::from_le_bytes(*word);
        borrows | (!word).wrapping_sub(0x0101_0101) & word
    });
    if borrows & 0x8080_8080 == 0 && !rest.contains(&u8::MAX) {
        return 0;
    }
    count_above(row, u8::MAX - 1)
}

/// Number of pixels of a row above a level.
fn count_above(row: &[u8], level: u8) -> usize {
    row.iter().filter(|&&pixel| pixel > level).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec::Vec;

    const WIDTH: usize = 200;
    const DISPARITIES: DisparityRange = DisparityRange {
        minimum_px: 0,
        count: 32,
    };

    /// Lines of a scene whose brightness changes along and down, as either camera sees them without any
    /// disturbance: with another noise each.
    fn scene(lines: usize, seed: u64) -> Vec<[Vec<f64>; 2]> {
        let mut random = Pcg32::seed_from_u64(seed);
        let mut noise = || f64::from(random.next_u32() % 7) - 3.0;
        (0..lines)
            .map(|y| {
                let level = |x: usize| {
                    let (x, y) = (x as f64, y as f64);
                    110.0 + 40.0 * (x * 0.3).sin() * (y * 0.05).cos() + 20.0 * (y * 0.02).sin()
                };
                [0, 1].map(|_| (0..WIDTH).map(|x| level(x) + noise()).collect())
            })
            .collect()
    }

    /// What each line of the other view is converted by, where `disturb` returns gain and offset of a line
    /// of the reference view and of the other view.
    fn conversions(
        disturb: impl Fn(usize) -> [(f64, f64); 2],
        exposure_gain: f64,
        gain_max_q8: u8,
    ) -> Vec<Option<LevelConversion>> {
        let mut line_gain = LineGain::new(gain_max_q8, DISPARITIES);
        let lines = scene(300, 1);
        let lines = lines.iter().enumerate().map(|(y, views)| {
            let seen = |view: usize| -> Vec<u8> {
                let (gain, offset) = disturb(y)[view];
                let levels = views[view].iter();
                levels.map(|level| (level * gain + offset) as u8).collect()
            };
            let (own, other) = (seen(0), seen(1));
            let rows = NewestRows {
                levels: [&own, &other],
                valid: [0..WIDTH, 0..WIDTH],
            };
            line_gain.conversion(&rows, (exposure_gain * 4096.0) as i32)
        });
        lines.collect()
    }

    /// Brightness of mains light at a line: 20 % up and down within 16 lines.
    fn band(y: usize, phase: f64) -> f64 {
        1.0 + 0.2 * (y as f64 * core::f64::consts::TAU / 16.0 + phase).sin()
    }

    /// Asserts that after the first lines, levels of the other view are converted to what the reference
    /// view shows, but for an error, levels, of which the first is the mean and the second the largest.
    fn assert_mended(disturb: impl Fn(usize) -> [(f64, f64); 2], [mean, largest]: [f64; 2]) {
        let found = conversions(&disturb, 1.0, 255);
        let errors = found.iter().enumerate().skip(100).flat_map(|(y, found)| {
            let [own, other] = disturb(y);
            [60.0, 110.0, 160.0].map(|level| {
                let [expected, seen] = [own, other].map(|(gain, offset)| level * gain + offset);
                let converted = match found {
                    Some(conversion) => conversion.apply(seen as u8).into(),
                    None => seen,
                };
                (converted - expected).abs()
            })
        });
        let errors: Vec<f64> = errors.collect();
        let found = errors.iter().sum::<f64>() / errors.len() as f64;
        let most = errors.iter().copied().fold(0.0, f64::max);
        assert!(
            found < mean && most < largest,
            "{found:.2}, at most {most:.2}"
        );
    }

    /// They differ by 16 % in the mean, and at most 29 %.
    #[test]
    fn bands_of_light_are_divided_out() {
        assert_mended(|y| [(band(y, 0.0), 0.0), (band(y, 1.6), 0.0)], [4.0, 12.0]);
    }

    /// It differs by 13 levels in the mean, and at most 40.
    #[test]
    fn noise_of_rows_is_subtracted() {
        let row_noise = |y: usize| {
            let mut random = Pcg32::seed_from_u64(y as u64);
            [0, 1].map(|_| (1.0, f64::from(random.next_u32() % 41) - 20.0))
        };
        assert_mended(row_noise, [2.5, 8.0]);
    }

    /// Neither is what another exposure is, whether it stays or changes slowly.
    #[test]
    fn exposure_is_left_alone() {
        let exposures: [fn(f64) -> (f64, f64); 5] = [
            |_| (1.0, 0.0),
            |_| (1.25, -30.0),
            |_| (0.6, 30.0),
            |y| (1.4 - 0.8 * y / 300.0, 0.0),
            |y| (1.0, 60.0 * y / 300.0 - 30.0),
        ];
        for (index, exposure) in exposures.into_iter().enumerate() {
            let gain = 1.0 / exposure(150.0).0;
            let found = conversions(|y| [(1.0, 0.0), exposure(y as f64)], gain, 255);
            assert!(found.iter().all(Option::is_none), "exposure {index}");
        }
    }

    #[test]
    fn gains_stay_within_their_bound() {
        let bands = |y: usize| [(band(y, 0.0), 0.0), (band(y, 1.6), 0.0)];
        let found = conversions(bands, 1.0, 26);
        let gains = found.iter().flatten().map(|found| {
            // Gain and offset together, at a level of 128.
            f64::from(found.gain_q12 * 128 + found.offset_q12) / 4096.0 / 128.0
        });
        let gains: Vec<f64> = gains.collect();
        let most = 1.0 + 26.0 / 256.0 + 0.01;
        assert!(gains.iter().any(|&gain| gain > most - 0.02));
        assert!(gains.iter().all(|gain| (1.0 / most..=most).contains(gain)));
        assert!(conversions(bands, 1.0, 0).iter().all(Option::is_none));
    }

    #[test]
    fn pixels_at_the_highest_level_are_counted_wherever_they_are() {
        for length in 0..14 {
            for bits in 0..1_u32 << length {
                // Beside them are levels whose bits are all 0 or nearly all 1.
                let level = |x: u32| match (bits >> x & 1, x % 3) {
                    (1, _) => 255,
                    (_, 0) => 254,
                    (_, 1) => 0,
                    _ => 128,
                };
                let row: Vec<u8> = (0..length).map(level).collect();
                assert_eq!(count_highest(&row), bits.count_ones() as usize, "{row:?}");
            }
        }
    }

    /// The brightest pixels that one view has lost count in neither.
    #[test]
    fn clipped_pixels_are_left_out_of_both_rows() {
        let own: Vec<u8> = (0..200).map(|x| (x * 37 % 200) as u8 + 20).collect();
        let other: Vec<u8> = own.iter().map(|&level| level.saturating_add(90)).collect();
        let (mean, spread) = measure([&own, &other]).unwrap();
        let kept = own.iter().filter(|&&level| level < 165);
        let kept: Vec<f64> = kept.map(|&level| level.into()).collect();
        let expected = kept.iter().sum::<f64>() / kept.len() as f64;
        let sampled = own.iter().step_by(4).filter(|&&level| level < 165);
        let distances: Vec<f64> = sampled
            .map(|&level| (f64::from(level) - expected).abs())
            .collect();
        let expected_spread = distances.iter().sum::<f64>() / distances.len() as f64;
        for (found_q8, expected) in [
            (mean.own_q8, expected),
            (mean.other_q8, expected + 90.0),
            (spread.own_q8, expected_spread),
            (spread.other_q8, expected_spread),
        ] {
            let found = f64::from(found_q8) / 256.0;
            assert!((found - expected).abs() < 0.2, "{found} for {expected}");
        }
        assert!(measure([&own, &[255; 200]]).is_none());
        assert!(measure([&own[..10], &own[..10]]).is_none());
        assert!(measure([&[], &own]).is_none());
    }
}
