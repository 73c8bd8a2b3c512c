//! Weighted median of four pixels at once: four bytes to a word.
//!
//! The taps with a weight are listed once. Their values are stored relative to an origin per pixel
//! and clamped to a byte. The pixel's own disparity is in the middle of that range, and the search
//! for the median proceeds from there in steps that double. In the rare case that the median is not
//! within the range, the origin moves and the taps are listed again.

use core::array::from_fn;

use bytemuck::{must_cast_ref, try_cast_slice_mut};
use vgstereo_core::disparity::INVALID;
use vgstereo_core::kernel::{MAX_CHANNELS, WeightedMedianRow};

use super::others;

use super::simd::{
    add_even_bytes, add_odd_bytes, add_saturating_i16x2, add_saturating_u8x4, afresh,
    distance_u8x4, even_bytes, halve_sum_u8x4, halve_sum_u16x2, in_order, list_some, load,
    load_six, max_u8x4, min_i16x2, min_u8x4, odd_bytes, pair_of, select_ge_i16x2, select_ge_u8x4,
    select_ge_u16x2, splat_u8, splat_u16, sub_saturating_i16x2, sub_saturating_u8x4, sub_to_u8x2,
};

/// Pixels filtered at once.
const LANES: usize = 4;
/// Number of weights by distance from the centre: they are below this, 1/16.
const PLACES: usize = 32;
/// Number of likenesses of colour: a likeness fits six bits.
const LIKENESSES: usize = 64;

/// Weight of a tap by its distance weight and its likeness of colour, at most 255.
static WEIGHTS: [[u8; LIKENESSES]; PLACES] = weights(1);

/// Weight of a tap by its distance weight and a third of its likeness. Grey counts as three equal channels: a
/// third of its likeness follows from the difference of one.
static WEIGHTS_OF_THIRDS: [[u8; LIKENESSES]; PLACES] = weights(3);

const fn weights(step: usize) -> [[u8; LIKENESSES]; PLACES] {
    let mut weights = [[0; LIKENESSES]; PLACES];
    let mut place = 0;
    while place < PLACES {
        let mut index = 0;
        while index < LIKENESSES {
            let likeness = step * index;
            let weight = (((likeness * likeness) >> 4) * place) >> 4;
            weights[place][index] = if weight < 255 { weight as u8 } else { 255 };
            index += 1;
        }
        place += 1;
    }
    weights
}

/// A tap of four pixels: their values relative to the origins, and their weights. The bytes are in
/// the order of pixels 0, 2, 1, 3, so that bytes 0 and 2 belong to the first two pixels.
type Tap = [u32; 2];

/// Four values in two words of halfwords: those of the first two pixels, then those of the last
/// two.
type Halfwords = [u32; 2];

/// Value of a pixel's own disparity relative to its origin.
const OWN: u8 = 128;
/// Distance by which the origin moves. It is one less than the largest byte, because that and 0
/// also stand for all values beyond the range.
const MOVE: u16 = 254;

/// Equals [`weighted_median_row`](vgstereo_core::kernel::weighted_median_row) bit for bit.
#[inline(never)]
pub(super) fn weighted_median_row(
    row: &WeightedMedianRow<'_>,
    weights: &mut [u8],
    output: &mut [i16],
) {
    let width = output.len();
    let (true, Ok(list)) = (width >= LANES, try_cast_slice_mut(weights)) else {
        others::weighted_median_row(row, weights, output);
        return;
    };
    let list = list.as_chunks_mut().0;
    let replicated;
    let row = if row.channels == 1 && !row.colour_reach.is_multiple_of(3) {
        // A third of its reach is not a whole number.
        replicated = WeightedMedianRow {
            levels: [row.levels[0]; MAX_CHANNELS],
            centres: [row.centres[0]; MAX_CHANNELS],
            channels: MAX_CHANNELS,
            ..*row
        };
        &replicated
    } else {
        row
    };
    let clear = clear_columns(row);
    let window = row.window_width - 1 + LANES;
    // The last block overlaps the one before it, so that nothing remains.
    for x in (0..width).step_by(LANES) {
        let x = x.min(width - LANES);
        let is_clear = clear.start <= x && x + window <= clear.end;
        let medians = match (row.channels, is_clear) {
            (1, true) => filter_block::<1, true>(row, x, list),
            (1, false) => filter_block::<1, false>(row, x, list),
            _ => filter_block::<MAX_CHANNELS, false>(row, x, list),
        };
        if let (Some(medians), Some(output)) = (medians, output.get_mut(x..x + LANES)) {
            output.copy_from_slice(&medians);
        }
    }
}

/// Columns of the window's rows in which every row has a disparity of 0 or more, as is the case
/// within the image in the pipeline. Empty if these columns are not contiguous in some row.
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

/// Returns the weighted medians of the [`LANES`] pixels from `x` on.
#[inline(always)]
fn filter_block<const CHANNELS: usize, const CLEAR: bool>(
    row: &WeightedMedianRow<'_>,
    x: usize,
    list: &mut [Tap],
) -> Option<[i16; LANES]> {
    let own = words_of(run_at(
        row.values.get(row.centre)?,
        x + row.window_width / 2,
    )?);
    let lowest = splat_u16((INVALID + 1).cast_unsigned());
    // The highest origin: its range of values ends at the largest value of all.
    let last = splat_u16((i16::MAX - MOVE.cast_signed()).cast_unsigned());
    let mut origins = own.map(|own| {
        let origin = sub_saturating_i16x2(own, splat_u16(OWN.into()));
        // A pixel without a disparity starts at 0.
        min_i16x2(select_ge_i16x2(own, lowest, origin, 0), last)
    });
    loop {
        let listed = list_taps::<CHANNELS, CLEAR>(row, x, origins, list)?;
        let listed = list.get(..listed)?;
        let (medians, totals) = search(listed);
        let found = [even_bytes(medians), odd_bytes(medians)];
        let mut is_settled = true;
        let mut values = [0; 2];
        for word in 0..2 {
            values[word] = add_saturating_i16x2(origins[word], found[word]);
            let down = sub_saturating_i16x2(origins[word], splat_u16(MOVE));
            let up = min_i16x2(add_saturating_i16x2(origins[word], splat_u16(MOVE)), last);
            // A median of 0 relative to the origin may be at 0 or below it, one of 255 at 255 or
            // above.
            let moved = select_ge_i16x2(0, found[word], down, origins[word]);
            let moved = select_ge_i16x2(found[word], splat_u16(255), up, moved);
            let moved = select_ge_u16x2(totals[word], splat_u16(1), moved, origins[word]);
            is_settled &= moved == origins[word];
            origins[word] = moved;
            let invalid = splat_u16(INVALID.cast_unsigned());
            values[word] = select_ge_u16x2(totals[word], splat_u16(1), values[word], invalid);
        }
        if is_settled {
            let [a, b] = values.map(|pair| [pair as u16, (pair >> 16) as u16]);
            return Some([a[0], a[1], b[0], b[1]].map(u16::cast_signed));
        }
    }
}

/// Lists the taps with a weight for any of the four pixels from `x` on; returns their number.
#[inline(never)]
fn list_taps<const CHANNELS: usize, const CLEAR: bool>(
    row: &WeightedMedianRow<'_>,
    x: usize,
    origins: Halfwords,
    list: &mut [Tap],
) -> Option<usize> {
    let count = row.tap_columns().len();
    let mut centres = [0; CHANNELS];
    for (centre, levels) in centres.iter_mut().zip(row.centres) {
        *centre = load(run_at(levels, x)?);
    }
    let rows = row.places.chunks_exact(count.max(1)).zip(&row.values);
    let mut listed = 0;
    for (index, (places, values)) in rows.enumerate().take(row.rows) {
        let mut pairs = [&[][..]; CHANNELS];
        for (pairs, levels) in pairs.iter_mut().zip(&row.levels) {
            *pairs = pairs_from(levels.get(index)?, x, count)?;
        }
        let taps = TapRow {
            levels: pairs,
            values: pairs_from(values, x, count)?,
            places,
        };
        let reach = splat_u8(if CHANNELS == 1 {
            row.colour_reach / 3
        } else {
            row.colour_reach
        });
        let list = list.get_mut(listed..)?;
        listed += list_row::<CHANNELS, CLEAR>(&taps, centres, reach, origins, list)?;
    }
    Some(listed)
}

/// One row of taps of four pixels: pairs of neighbouring levels and values, one more than there are
/// taps.
struct TapRow<'a, const CHANNELS: usize> {
    levels: [&'a [[u8; 2]]; CHANNELS],
    values: &'a [[i16; 2]],
    /// Weight of each tap by its distance.
    places: &'a [u8],
}

/// Lists the taps of one row that have a weight; returns their number, or `None` if there is no room
/// for them.
#[inline(always)]
fn list_row<const CHANNELS: usize, const CLEAR: bool>(
    taps: &TapRow<'_, CHANNELS>,
    centres: [u32; CHANNELS],
    reach: u32,
    origins: Halfwords,
    list: &mut [Tap],
) -> Option<usize> {
    let (places, count) = (taps.places, taps.places.len());
    let table = afresh(if CHANNELS == 1 {
        &WEIGHTS_OF_THIRDS
    } else {
        &WEIGHTS
    });
    let mut levels = [&[][..]; CHANNELS];
    let mut before = [0; CHANNELS];
    for channel in 0..CHANNELS {
        let (&first, rest) = taps.levels[channel].split_first()?;
        before[channel] = u32::from(u16::from_le_bytes(first));
        levels[channel] = rest.get(..count)?;
    }
    let (&first, values) = taps.values.split_first()?;
    let mut value_pair = pair_of(&first);
    let values = values.get(..count)?;
    list_some(list, count, |tap| {
        let (&place, next) = (places.get(tap)?, values.get(tap)?);
        let mut difference = 0;
        for channel in 0..CHANNELS {
            let pair = u32::from(u16::from_le_bytes(*levels[channel].get(tap)?));
            let four = before[channel] | pair << 16;
            before[channel] = pair;
            let distance = distance_u8x4(centres[channel], four);
            difference = if channel == 0 {
                distance
            } else {
                add_saturating_u8x4(difference, distance)
            };
        }
        let values = [value_pair, in_order(pair_of(next))];
        value_pair = values[1];
        let likeness = sub_saturating_u8x4(reach, difference);
        if likeness == 0 {
            return None;
        }
        let by_likeness = &table[usize::from(place) % PLACES];
        let weight = |lane: u32| {
            // The likeness fits six bits.
            u32::from(by_likeness[(likeness >> (8 * lane)) as usize % LIKENESSES])
        };
        let mut weights = in_order(weight(0) | weight(1) << 16);
        weights = in_order(weights | weight(2) << 8);
        weights = in_order(weights | weight(3) << 24);
        if !CLEAR {
            let least = splat_u16((INVALID + 1).cast_unsigned());
            let known = |values, byte| select_ge_i16x2(values, least, byte, 0);
            weights &= known(values[0], splat_u16(0xff)) | known(values[1], splat_u16(0xff00));
        }
        let [a, b] = from_fn(|word| sub_to_u8x2(values[word], origins[word]));
        Some([a | b << 8, weights])
    })
}

/// Sums the weights of each of the four pixels.
#[inline(always)]
fn total(listed: &[Tap]) -> Halfwords {
    let mut totals = [0; 2];
    each_tap(listed, |[_, weights]| {
        totals[0] = add_even_bytes(totals[0], weights);
        totals[1] = add_odd_bytes(totals[1], weights);
    });
    totals
}

/// Pairs of neighbouring elements from `x` on. The elements of four pixels at one tap are two
/// successive pairs, as taps are two columns apart.
#[inline(always)]
fn pairs_from<T>(row: &[T], x: usize, taps: usize) -> Option<&[[T; 2]]> {
    row.get(x..)?.as_chunks().0.get(..taps + 1)
}

/// Returns, for each of four pixels, the smallest value at or below which lies at least half of the
/// weight, and the total weights. Values are relative to the origins.
#[inline(never)]
fn search(listed: &[Tap]) -> (u32, Halfwords) {
    let totals = total(listed);
    // Half of the total weight, rounded up.
    let halves = totals.map(|total| halve_sum_u16x2(total, splat_u16(1)));
    let (mut low, mut high) = (0, splat_u8(u8::MAX));
    let mut probes = splat_u8(OWN);
    let mut step = splat_u8(2);
    loop {
        let (mut below_low, mut below_high) = (0, 0);
        each_tap(listed, |[values, weights]| {
            let counted = select_ge_u8x4(probes, values, weights, 0);
            below_low = add_even_bytes(below_low, counted);
            below_high = add_odd_bytes(below_high, counted);
        });
        let is_enough = select_ge_u16x2(below_low, halves[0], splat_u16(0xff), 0)
            | select_ge_u16x2(below_high, halves[1], splat_u16(0xff00), 0);
        let enough = |yes, no| select_ge_u8x4(is_enough, splat_u8(u8::MAX), yes, no);
        high = enough(probes, high);
        // This does not wrap, because the highest probe has enough weight.
        low = enough(low, add_saturating_u8x4(probes, splat_u8(1)));
        if low == high {
            return (low, totals);
        }
        let middle = halve_sum_u8x4(low, high);
        let down = max_u8x4(middle, sub_saturating_u8x4(probes, step));
        let up = min_u8x4(middle, add_saturating_u8x4(probes, step));
        probes = enough(down, up);
        step = add_saturating_u8x4(step, step);
    }
}

/// Calls `body` with each tap; three are loaded at a time.
#[inline(always)]
fn each_tap(listed: &[Tap], mut body: impl FnMut(Tap)) {
    let (threes, rest) = listed.as_chunks::<3>();
    for three in threes {
        let [a, a_weights, b, b_weights, c, c_weights] = load_six(must_cast_ref(three));
        body([a, a_weights]);
        body([b, b_weights]);
        body([c, c_weights]);
    }
    rest.iter().for_each(|&tap| body(tap));
}

/// Packs four values into two words.
#[inline(always)]
fn words_of(values: &[i16; LANES]) -> Halfwords {
    let [a, b, c, d] = *values;
    [pair_of(&[a, b]), pair_of(&[c, d])]
}

/// Returns the `N` values from `start` on.
#[inline(always)]
fn run_at<T, const N: usize>(values: &[T], start: usize) -> Option<&[T; N]> {
    values.get(start..)?.first_chunk()
}
