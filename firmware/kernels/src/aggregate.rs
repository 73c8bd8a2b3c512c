//! Aggregation of up to 64 disparities, four to a register; two registers are loaded and stored
//! at once.
//!
//! A sum of three paths and its index fit 16 bits as a key, whose least is the first of
//! the least sums. Keys are made of even and odd disparities apart, as the bytes of a
//! register widen; the least of each two neighbours is kept for the second best.

use bytemuck::{must_cast_slice, must_cast_slice_mut, try_cast_slice, try_cast_slice_mut};
use vgstereo_core::aggregation::{self, AggregateRow};
use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::matching::NO_DISTANCE;

use crate::simd::{
    add_even_bytes, add_odd_bytes, add_saturating_u8x4, even_bytes, in_order, load, min_u8x4,
    min_u16x2, odd_bytes, opaque, splat_u8, splat_u16, store, sub_saturating_u8x4, unrolled,
};

/// Most disparities, rounded up.
const MAX_STRIDE: usize = 64;

/// Bits of the index below the sum in a key; a sum is at most 3 times 255.
const INDEX_BITS: u32 = 6;
const INDEX_MASK: u32 = (1 << INDEX_BITS) - 1;

/// Eight disparities.
type Pair = [u32; 2];

/// The least key of each two neighbouring disparities, with guards around them.
type Minima = [u32; MAX_STRIDE / 4 + 2];

/// The same as core's `aggregate_paths`.
pub fn aggregate_paths(row: &mut AggregateRow<'_>) {
    let aggregated = match row.stride {
        16 => aggregate::<2>(row),
        32 => aggregate::<4>(row),
        48 => aggregate::<6>(row),
        MAX_STRIDE => aggregate::<8>(row),
        _ => None,
    };
    if aggregated.is_none() {
        aggregation::aggregate_paths(row);
    }
}

/// The same as core's `select_row`.
pub fn select_row(row: &mut AggregateRow<'_>) {
    // The other view's slots of all pixels' disparities.
    let slots = row.best.len() + row.disparities;
    let is_whole = (1..=row.stride).contains(&row.disparities) && row.other_best.len() + 1 >= slots;
    let selected = match row.stride {
        16 if is_whole => select_pixels::<4>(row),
        32 if is_whole => select_pixels::<8>(row),
        48 if is_whole => select_pixels::<12>(row),
        MAX_STRIDE if is_whole => select_pixels::<16>(row),
        _ => None,
    };
    if selected.is_none() {
        aggregation::select_row(row);
    }
}

/// Path costs of `8 * PAIRS` disparities; none where rows are not aligned to words.
#[inline(never)]
fn aggregate<const PAIRS: usize>(row: &mut AggregateRow<'_>) -> Option<()> {
    let costs = pixels_mut::<PAIRS>(row.costs)?;
    let from_right = pixels_mut::<PAIRS>(row.from_right)?;
    let from_above = pixels_mut::<PAIRS>(row.from_above)?;
    let p1 = splat_u8(row.p1);
    // With a penalty of 0, a path begins: whatever is before it.
    let before = [[0; 2]; PAIRS];

    // From the right, over the penalties between a pixel and the one on its right.
    let (mut previous, mut least, mut p2) = (&before, 0, 0);
    let pixels = costs.iter().zip(from_right).zip(row.p2_along);
    for ((costs, from_right), &p2_left) in pixels.rev() {
        least = step(previous, least, p1, p2, |index, onward| {
            let path = add(costs[index], onward);
            from_right[index] = path;
            path
        });
        previous = from_right;
        p2 = p2_left;
    }

    let rows = costs.iter().zip(from_above).zip(row.p2_down);
    for ((costs, from_above), &p2) in rows {
        if row.is_first {
            *from_above = *costs;
        } else {
            descend(from_above, costs, p1, p2);
        }
    }

    // From the left, in place of the costs.
    let (mut previous, mut least, mut is_inside) = (&before, 0, 0);
    for (costs, &p2) in costs.iter_mut().zip(row.p2_along) {
        least = step(previous, least, p1, p2 & is_inside, |index, onward| {
            let path = add(costs[index], onward);
            costs[index] = path;
            path
        });
        previous = costs;
        is_inside = u8::MAX;
    }
    Some(())
}

fn pixels_mut<const PAIRS: usize>(row: &mut [u8]) -> Option<&mut [[Pair; PAIRS]]> {
    Some(try_cast_slice_mut(row).ok()?.as_chunks_mut().0)
}

/// One pixel along a path whose least cost is given; the same of the next, four times each.
/// What the next path costs more than its pixel goes to `add`, which gives their sum.
#[inline(always)]
fn step<const PAIRS: usize>(
    previous: &[Pair; PAIRS],
    least: u32,
    p1: u32,
    p2: u8,
    mut add: impl FnMut(usize, Pair) -> Pair,
) -> u32 {
    let onward = Onward::new(least, p2);
    let mut least = u32::MAX;
    unrolled::<PAIRS>(|index| {
        let path = add(index, onward.costs(reach(previous, index, p1)));
        least = least_with(least, path);
    });
    least_of(least)
}

/// One pixel along the path down, in place.
#[inline(always)]
fn descend<const PAIRS: usize>(path: &mut [Pair; PAIRS], costs: &[Pair; PAIRS], p1: u32, p2: u8) {
    let mut all_reached = [[0; 2]; PAIRS];
    let mut least = u32::MAX;
    unrolled::<PAIRS>(|index| {
        let reached = reach(path, index, p1);
        all_reached[index] = reached;
        // No step makes the cheapest cheaper.
        least = least_with(least, reached);
    });
    let onward = Onward::new(least_of(least), p2);
    unrolled::<PAIRS>(|index| {
        path[index] = add(costs[index], onward.costs(all_reached[index])).map(in_order);
    });
}

#[inline(always)]
fn add(costs: Pair, onward: Pair) -> Pair {
    [
        add_saturating_u8x4(costs[0], onward[0]),
        add_saturating_u8x4(costs[1], onward[1]),
    ]
}

#[inline(always)]
fn least_with(least: u32, [a, b]: Pair) -> u32 {
    in_order(min_u8x4(min_u8x4(least, a), b))
}

/// What it costs to come to eight disparities without a larger step. Beyond the range there
/// are the highest costs, which are never the least.
#[inline(always)]
fn reach<const PAIRS: usize>(path: &[Pair; PAIRS], index: usize, p1: u32) -> Pair {
    let bytes: &[u8] = must_cast_slice(path.as_slice());
    let moved = |start: usize| {
        let costs = bytes.get(start..).and_then(<[u8]>::first_chunk);
        costs.map(load)
    };
    let reached = |word: usize| {
        let (start, same) = (8 * index + 4 * word, path[index][word]);
        let below = moved(start.wrapping_sub(1)).unwrap_or(same << 8 | 0xff);
        let above = moved(start + 1).unwrap_or(same >> 8 | 0xff << 24);
        min_u8x4(same, add_saturating_u8x4(min_u8x4(below, above), p1))
    };
    [reached(0), reached(1)]
}

/// What a path costs more from pixel to pixel.
struct Onward {
    p2: u32,
    /// No path cost is below the least, and with the penalty that fits a byte.
    ceiling: u32,
}

impl Onward {
    #[inline(always)]
    fn new(least: u32, p2: u8) -> Self {
        let p2 = splat_u8(p2);
        Self {
            p2,
            ceiling: add_saturating_u8x4(least, p2),
        }
    }

    /// The smaller of the penalty and of what is reached less the least.
    #[inline(always)]
    fn costs(&self, reached: Pair) -> Pair {
        reached.map(|reached| {
            let less = sub_saturating_u8x4(self.ceiling, reached);
            self.p2.wrapping_sub(less)
        })
    }
}

/// The least of four bytes, four times.
#[inline(always)]
fn least_of(quad: u32) -> u32 {
    let pair = min_u8x4(quad, quad.rotate_right(16));
    min_u8x4(pair, pair.rotate_right(8))
}

/// Selects from the sums of paths of `4 * QUADS` disparities; none where rows are not aligned
/// to words.
#[inline(never)]
fn select_pixels<const QUADS: usize>(row: &mut AggregateRow<'_>) -> Option<()> {
    let paths = pixels::<QUADS>(row.costs)?
        .iter()
        .zip(pixels(row.from_right)?)
        .zip(pixels(row.from_above)?);
    let disparities = row.disparities;
    let end = (row.best.len() + disparities).saturating_sub(1);
    let (inside, beyond) = row.other_best.split_at_mut(end.min(row.other_best.len()));
    beyond.fill(u32::MAX);
    // No more pixel comes after the last, whose lowest disparity is at the first position.
    let open = disparities.saturating_sub(1).min(inside.len());
    let (open, done) = inside.split_at_mut(open);
    let mut window = [0; _];
    let mut others = Others::new(&mut window);
    let mut minima = [u32::MAX; _];
    let outputs = row.best.iter_mut().zip(&mut *row.refined_q4);
    let outputs = outputs.zip(&mut *row.margins).zip(done.iter_mut().rev());
    for (((from_left, from_right), from_above), (((best, refined_q4), margin), done)) in
        paths.zip(outputs)
    {
        let paths = [from_left, from_right, from_above];
        let key = others.meet(paths, &mut minima);
        // Where the highest disparity is, no later pixel's is.
        *done = others.best(open.len());
        let selected = select(key, paths, &mut minima, disparities);
        *best = selected.index;
        *refined_q4 = selected.refined_q4;
        *margin = selected.margin;
    }
    for (position, other) in open.iter_mut().enumerate() {
        *other = others.best(position);
    }
    Some(())
}

fn pixels<const QUADS: usize>(row: &[u8]) -> Option<&[[u32; QUADS]]> {
    Some(try_cast_slice(row).ok()?.as_chunks().0)
}

/// Bytes of the window of [`Others`] for every other position.
const PLANE: usize = 2 * MAX_STRIDE;

/// Keys of every other position, then of those between them; no start is in what is after that,
/// which is for the compiler.
type Window = [u8; 2 * PLANE + MAX_STRIDE];

/// The best match of each pixel of the other view.
///
/// Only as many positions as there are disparities are still open at a pixel; their keys
/// stand in a window that moves one position down from pixel to pixel.
struct Others<'a> {
    keys: &'a mut Window,
    /// Where the keys of the pixel's even disparities begin.
    even: usize,
    /// Those of its odd ones.
    odd: usize,
}

impl<'a> Others<'a> {
    /// What [`Others::meet`] begins with a step down from.
    fn new(keys: &'a mut Window) -> Self {
        *keys = [u8::MAX; _];
        Self {
            keys,
            even: 2 * PLANE - MAX_STRIDE,
            odd: PLANE - MAX_STRIDE + 2,
        }
    }

    /// Takes the next pixel's paths; gives its least key, and those of each two neighbouring
    /// disparities.
    #[inline(always)]
    fn meet<const QUADS: usize>(&mut self, paths: [&[u32; QUADS]; 3], minima: &mut Minima) -> u32 {
        if self.odd.is_multiple_of(PLANE) {
            rewind(self.keys);
            self.even += MAX_STRIDE;
            self.odd += MAX_STRIDE;
        }
        // What was at an even disparity is one step further from it at an odd one.
        (self.even, self.odd) = ((self.odd - 2) % (2 * PLANE), self.even % (2 * PLANE));
        let mut best = u32::MAX;
        unrolled::<QUADS>(|index| {
            let least = self.meet_quad(index, paths.map(|path| path[index]));
            best = min_u16x2(best, least);
            if index % 2 == 1 {
                best = in_order(best);
            }
            minima[index + 1] = least;
        });
        min_u16x2(best, best >> 16) & 0xffff
    }

    /// Takes four of the pixel's disparities; gives the least key of each two.
    #[inline(always)]
    fn meet_quad(&mut self, quad: usize, [left, right, above]: [u32; 3]) -> u32 {
        // Of disparities 0 and 2 of the quad.
        let indices = splat_u16(4 * quad as u16) + (2 << 16);
        let sums = add_even_bytes(add_even_bytes(even_bytes(left), right), above);
        let keys_even = opaque((sums << INDEX_BITS) + indices);
        let sums = add_odd_bytes(add_odd_bytes(odd_bytes(left), right), above);
        let keys_odd = opaque((sums << INDEX_BITS) + (indices + splat_u16(1)));
        for (start, keys) in [(self.even, keys_even), (self.odd, keys_odd)] {
            let others = self.keys.get_mut(start + 4 * quad..);
            if let Some(others) = others.and_then(<[u8]>::first_chunk_mut) {
                store(min_u16x2(load(others), keys), others);
            }
        }
        min_u16x2(keys_even, keys_odd)
    }

    /// The best match of where the pixel has a disparity.
    #[inline(always)]
    fn best(&self, disparity: usize) -> u32 {
        let start = if disparity.is_multiple_of(2) {
            self.even
        } else {
            self.odd
        };
        let key = self.keys.get(start + disparity / 2 * 2..);
        let key = key.and_then(<[u8]>::first_chunk);
        let key = key.map_or(0, |key| u32::from(u16::from_le_bytes(*key)));
        key >> INDEX_BITS << 16 | key & INDEX_MASK
    }
}

/// Moves the open positions of the window of [`Others`] to its end.
#[cold]
#[inline(never)]
fn rewind(keys: &mut [u8]) {
    for plane in keys.as_chunks_mut::<PLANE>().0 {
        let (low, high) = plane.split_at_mut(MAX_STRIDE);
        high.copy_from_slice(low);
        low.fill(u8::MAX);
    }
}

/// What is known of a pixel from its sums.
struct Selected {
    index: u16,
    refined_q4: i16,
    margin: i16,
}

/// The best disparity, refined by a parabola through its neighbours, and how clear it is.
#[inline(always)]
fn select<const QUADS: usize>(
    key: u32,
    paths: [&[u32; QUADS]; 3],
    minima: &mut Minima,
    disparities: usize,
) -> Selected {
    let index = (key & INDEX_MASK) as usize;
    let least = (key >> INDEX_BITS) as i16;
    let paths: [&[u8]; 3] = paths.map(|path| must_cast_slice(path.as_slice()));
    // As long as the first for the compiler too.
    let paths = paths.map(|path| path.get(..paths[0].len()).unwrap_or_default());
    let sum = |index: usize| paths.iter().map(|path| i16::from(path[index])).sum::<i16>();
    let is_inside = 0 < index && index + 1 < disparities && index + 1 < paths[0].len();
    let step_q4 = if is_inside {
        parabola_q4(sum(index - 1) - least, sum(index + 1) - least)
    } else {
        0
    };
    // The two of the best and its neighbours have one disparity more.
    let two = index / 2 + 2;
    let (other_two, outer) = if index.is_multiple_of(2) {
        (two - 1, index.wrapping_sub(2))
    } else {
        (two + 1, index + 2)
    };
    let keys: &mut [u16] = must_cast_slice_mut(minima.as_mut_slice());
    for two in [two, other_two] {
        if let Some(key) = keys.get_mut(two) {
            *key = u16::MAX;
        }
    }
    let [_, minima @ ..] = minima;
    let second = minima.iter().take(QUADS);
    let second = second.fold(u32::MAX, |a, &b| min_u16x2(a, b));
    let second = min_u16x2(second, second >> 16) & 0xffff;
    let mut second = (second >> INDEX_BITS) as i16;
    if outer < disparities && outer < paths[0].len() {
        second = second.min(sum(outer));
    }
    // Beyond the range there are the highest sums, which are no second best.
    let has_second = index >= 2 || index + 2 < disparities;
    Selected {
        index: index as u16,
        refined_q4: index as i16 * STEPS_PER_PX + step_q4,
        margin: if has_second { second } else { NO_DISTANCE } - least,
    }
}

/// The same as [`vgstereo_core::aggregation::parabola_q4`]: with a divider in hardware,
/// one division takes less than the steps without.
#[inline(always)]
fn parabola_q4(before: i16, after: i16) -> i16 {
    let sum = u32::from((before + after) as u16);
    let difference = u32::from(before.abs_diff(after));
    let steps = (16 * difference + sum).checked_div(2 * sum).unwrap_or(0) as i16;
    if before >= after { steps } else { -steps }
}
