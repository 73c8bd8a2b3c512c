//! Weighted medians of four pixels side by side: two halfwords in a word.
//!
//! The taps that weigh are listed once; the median is then searched for from the pixel's
//! own disparity outwards, in steps that double, which is near where it lies.

use vgstereo_core::disparity::INVALID;
use vgstereo_core::refine::{self, WeightedMedianRow};

use crate::simd::{
    add_saturating_i16x2, add_saturating_u8x4, distance_u8x4, halve_sum_i16x2, halve_sum_u16x2,
    load, max_i16x2, min_i16x2, pair_of, select_ge_i16x2, select_ge_u16x2, splat_u8, splat_u16,
    sub_saturating_i16x2, sub_saturating_u8x4,
};

/// Pixels filtered side by side.
const LANES: usize = 4;
/// Weights by place are below this, 1/16.
const PLACES: usize = 32;
/// Largest likeness, as an index of six bits.
const LIKENESSES: usize = 64;

/// Weights by place and likeness.
static WEIGHTS: [[u8; LIKENESSES]; PLACES] = weights();

const fn weights() -> [[u8; LIKENESSES]; PLACES] {
    let mut weights = [[0; LIKENESSES]; PLACES];
    let mut place = 0;
    while place < PLACES {
        let mut likeness = 0;
        while likeness < LIKENESSES {
            let weight = (((likeness * likeness) >> 4) * place) >> 4;
            weights[place][likeness] = if weight < 255 { weight as u8 } else { 255 };
            likeness += 1;
        }
        place += 1;
    }
    weights
}

/// A tap of four pixels: their values and weights, two to a word.
type Tap = [u32; 4];

/// The same as core's `weighted_median_row`.
#[inline(never)]
pub fn weighted_median_row(row: &WeightedMedianRow<'_>, weights: &mut [u8], output: &mut [i16]) {
    let width = output.len();
    let taps = bytemuck::try_cast_slice_mut::<u8, Tap>(weights);
    let (true, Ok(taps)) = (width >= LANES, taps) else {
        refine::weighted_median_row(row, weights, output);
        return;
    };
    let clear = clear_columns(row);
    let window = row.window_width - 1 + LANES;
    // The last block overlaps the one before rather than leave a rest.
    for x in (0..width).step_by(LANES) {
        let x = x.min(width - LANES);
        let is_clear = clear.start <= x && x + window <= clear.end;
        let medians = match (row.channels, is_clear) {
            (1, true) => filter_block::<1, true>(row, x, taps),
            (1, false) => filter_block::<1, false>(row, x, taps),
            _ => filter_block::<3, false>(row, x, taps),
        };
        if let (Some(medians), Some(output)) = (medians, output.get_mut(x..x + LANES)) {
            output.copy_from_slice(&medians);
        }
    }
}

/// Columns of the window's rows that have a disparity of 0 or more in all of them, as those
/// of the pipeline have within the image; none where they are no run.
fn clear_columns(row: &WeightedMedianRow<'_>) -> core::ops::Range<usize> {
    let mut clear = 0..usize::MAX;
    for values in row.values.iter().take(row.rows) {
        let start = values.iter().take_while(|&&value| value < 0).count();
        let rest = values.get(start..).unwrap_or_default();
        let behind = rest.iter().rev().take_while(|&&value| value < 0).count();
        let inside = rest.get(..rest.len() - behind).unwrap_or_default();
        let (pairs, odd) = inside.as_chunks::<2>();
        let signs = pairs.iter().fold(0, |signs, pair| signs | pair_of(pair));
        let odd = odd.iter().fold(0, |signs, &value| signs | value);
        if signs & 0x8000_8000 != 0 || odd < 0 {
            return 0..0;
        }
        clear.start = clear.start.max(start);
        clear.end = clear.end.min(start + inside.len());
    }
    clear
}

/// The medians of [`LANES`] pixels from `x` on.
#[inline(always)]
fn filter_block<const CHANNELS: usize, const CLEAR: bool>(
    row: &WeightedMedianRow<'_>,
    x: usize,
    list: &mut [Tap],
) -> Option<[i16; LANES]> {
    let reach = splat_u8(row.colour_reach);
    let mut centres = [0; CHANNELS];
    for (centre, levels) in centres.iter_mut().zip(row.centres) {
        *centre = load(run_at(levels, x)?);
    }
    let own = words_of(run_at(
        row.values.get(row.centre)?,
        x + row.window_width / 2,
    )?);
    let mut places = row.places;
    let mut listed = 0;
    let mut totals = [0; 2];
    for (index, values) in row.values.iter().enumerate().take(row.rows) {
        let count = row.tap_columns(index).len();
        let start = x + row.first_tap(index);
        // Four pixels from a tap on are two pairs from its own on.
        let mut levels = [&[][..]; CHANNELS];
        for (levels, rows) in levels.iter_mut().zip(&row.levels) {
            let pairs = rows.get(index)?.get(start..)?.as_chunks().0;
            *levels = pairs.get(..count + 1)?;
        }
        let values = values.get(start..)?.as_chunks().0.get(..count + 1)?;
        let (row_places, rest) = places.split_at_checked(count)?;
        places = rest;
        let taps = TapsRow {
            levels,
            values,
            places: row_places,
            centres,
            reach,
        };
        listed += list_row::<CHANNELS, CLEAR>(&taps, list.get_mut(listed..)?, &mut totals)?;
    }
    let listed = list.get(..listed)?;
    let medians = search(listed, own, totals);
    let mut found = [INVALID; LANES];
    for (lane, found) in found.iter_mut().enumerate() {
        let half = |words: [u32; 2]| (words[lane / 2] >> (16 * (lane % 2))) as u16;
        if half(totals) > 0 {
            *found = half(medians).cast_signed();
        }
    }
    Some(found)
}

/// The taps of a row of the window.
struct TapsRow<'a, const CHANNELS: usize> {
    /// Pairs of pixels, one more than taps.
    levels: [&'a [[u8; 2]]; CHANNELS],
    values: &'a [[i16; 2]],
    places: &'a [u8],
    /// Four pixels in each channel.
    centres: [u32; CHANNELS],
    /// Difference at which nothing weighs any more, four times.
    reach: u32,
}

/// Lists the taps that weigh and adds their weights to the totals; gives their number.
#[inline(never)]
fn list_row<const CHANNELS: usize, const CLEAR: bool>(
    row: &TapsRow<'_, CHANNELS>,
    list: &mut [Tap],
    totals: &mut [u32; 2],
) -> Option<usize> {
    let TapsRow { centres, reach, .. } = *row;
    let mut levels = [&[][..]; CHANNELS];
    let mut levels_before = [0; CHANNELS];
    let count = row.places.len();
    for channel in 0..CHANNELS {
        let (&first, rest) = row.levels[channel].split_first()?;
        levels_before[channel] = u32::from(u16::from_le_bytes(first));
        levels[channel] = rest.get(..count)?;
    }
    let (first, values) = row.values.split_first()?;
    let mut values_before = pair_of(first);
    let values = values.get(..count)?;
    let [mut total_low, mut total_high] = *totals;
    let all = list.len();
    let mut list = list.iter_mut();
    for tap in 0..count {
        let values = [values_before, pair_of(&values[tap])];
        values_before = values[1];
        let mut difference = 0;
        for channel in 0..CHANNELS {
            let pair = u32::from(u16::from_le_bytes(levels[channel][tap]));
            let four = levels_before[channel] | pair << 16;
            levels_before[channel] = pair;
            let distance = distance_u8x4(centres[channel], four);
            difference = if CHANNELS == 1 {
                // Grey counts as three equal channels.
                add_saturating_u8x4(distance, add_saturating_u8x4(distance, distance))
            } else {
                add_saturating_u8x4(difference, distance)
            };
        }
        let likeness = sub_saturating_u8x4(reach, difference);
        if likeness == 0 {
            continue;
        }
        let by_likeness = &WEIGHTS[usize::from(row.places[tap]) % PLACES];
        let weight = |lane: u32| {
            // Six bits.
            u32::from(by_likeness[(likeness >> (8 * lane)) as usize % LIKENESSES])
        };
        let mut weights = [weight(0) | weight(1) << 16, weight(2) | weight(3) << 16];
        if !CLEAR {
            let least = splat_u16((INVALID + 1).cast_unsigned());
            for (weights, &values) in weights.iter_mut().zip(&values) {
                *weights = select_ge_i16x2(values, least, *weights, 0);
            }
        }
        total_low += weights[0];
        total_high += weights[1];
        *list.next()? = [values[0], values[1], weights[0], weights[1]];
    }
    *totals = [total_low, total_high];
    Some(all - list.len())
}

/// The smallest values at or below which lies half of the weight, searched for from
/// `probes` on.
#[inline(never)]
fn search(listed: &[Tap], mut probes: [u32; 2], totals: [u32; 2]) -> [u32; 2] {
    // Half of the weights, rounded up.
    let halves = totals.map(|total| halve_sum_u16x2(total, splat_u16(1)));
    let mut low = [splat_u16((INVALID + 1).cast_unsigned()); 2];
    // A pixel without a disparity may be the first to look at.
    for (probe, &low) in probes.iter_mut().zip(&low) {
        *probe = max_i16x2(*probe, low);
    }
    let mut high = [splat_u16(i16::MAX.cast_unsigned()); 2];
    let mut step = splat_u16(2);
    loop {
        let mut below = [0; 2];
        let mut add = |tap: &Tap| {
            for word in 0..2 {
                below[word] += select_ge_i16x2(probes[word], tap[word], tap[2 + word], 0);
            }
        };
        let (fours, rest) = listed.as_chunks::<4>();
        fours.iter().flatten().for_each(&mut add);
        rest.iter().for_each(&mut add);
        for word in 0..2 {
            let (probe, enough) = (probes[word], |yes, no| {
                select_ge_u16x2(below[word], halves[word], yes, no)
            });
            high[word] = enough(probe, high[word]);
            // Never above the highest, which is enough.
            let above = add_saturating_i16x2(probe, splat_u16(1));
            low[word] = enough(low[word], above);
            let middle = halve_sum_i16x2(low[word], high[word]);
            let down = max_i16x2(middle, sub_saturating_i16x2(probe, step));
            let up = min_i16x2(middle, add_saturating_i16x2(probe, step));
            probes[word] = enough(down, up);
        }
        if low == high {
            return low;
        }
        step = add_saturating_i16x2(step, step);
    }
}

/// Four values, two to a word.
#[inline(always)]
fn words_of(values: &[i16; LANES]) -> [u32; 2] {
    let [a, b, c, d] = *values;
    [pair_of(&[a, b]), pair_of(&[c, d])]
}

/// `N` values from `start` on.
#[inline(always)]
fn run_at<T, const N: usize>(values: &[T], start: usize) -> Option<&[T; N]> {
    values.get(start..)?.first_chunk()
}
