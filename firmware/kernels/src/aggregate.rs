//! Aggregation of up to 64 disparities, four to a register.
//!
//! A sum of three paths and its index fit 16 bits as a key, whose least is the first of
//! the least sums. Keys are made of even and odd disparities apart, as the bytes of a
//! register widen; the least of each pair of neighbours is kept for the second best.

use vgstereo_core::aggregation::{AggregateRow, aggregate_row as portable};
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

/// Four disparities.
type Quad = [u8; 4];

/// The least key of each pair of neighbouring disparities, with guards around them.
type Pairs = [Quad; MAX_STRIDE / 4 + 2];

/// Aggregates a row and selects.
pub fn aggregate_row(row: &mut AggregateRow<'_>) {
    // The other view's slots of all pixels' disparities.
    let slots = row.best.len() + row.disparities;
    let is_whole = (1..=row.stride).contains(&row.disparities) && row.other_best.len() + 1 >= slots;
    match row.stride {
        16 if is_whole => aggregate::<4>(row),
        32 if is_whole => aggregate::<8>(row),
        48 if is_whole => aggregate::<12>(row),
        MAX_STRIDE if is_whole => aggregate::<16>(row),
        _ => portable(row),
    }
}

/// The same for `4 * QUADS` disparities.
#[inline(never)]
fn aggregate<const QUADS: usize>(row: &mut AggregateRow<'_>) {
    let costs = pixels::<QUADS>(row.costs);
    let from_right = pixels_mut::<QUADS>(row.from_right);
    let from_above = pixels_mut::<QUADS>(row.from_above);
    let p1 = splat_u8(row.p1);
    let (mut previous, mut next) = (&mut Path::new(), &mut Path::new());

    // From the right, over the penalties between a pixel and the one on its right. With a
    // penalty of 0, a path begins.
    let (mut least, mut p2) = (0, 0);
    let pixels = costs.iter().zip(&mut *from_right).zip(row.p2_along);
    for ((costs, from_right), &p2_left) in pixels.rev() {
        least = step(previous, least, costs, p1, p2, |index, path| {
            next.write(index, path);
            write(from_right, index, path);
        });
        p2 = p2_left;
        core::mem::swap(&mut previous, &mut next);
    }

    // From the left and from above; all three are there, so each pixel is decided at once.
    let mut above = Path::new();
    let mut pairs = [[u8::MAX; 4]; _];
    let mut others = Others::new(row.other_best, row.best.len(), row.disparities);
    let (mut least, mut is_inside) = (0, 0);
    let penalties = row.p2_along.iter().zip(row.p2_down);
    let rows = costs.iter().zip(&*from_right).zip(from_above);
    let outputs = row.best.iter_mut().zip(&mut *row.refined_q4);
    let outputs = outputs.zip(&mut *row.margins);
    for ((((costs, from_right), from_above), (&p2_along, &p2_down)), output) in
        rows.zip(penalties).zip(outputs)
    {
        let p2_along = p2_along & is_inside;
        is_inside = u8::MAX;
        least = step(previous, least, costs, p1, p2_along, |index, path| {
            next.write(index, path);
        });
        core::mem::swap(&mut previous, &mut next);
        if row.is_first {
            *from_above = *costs;
        } else {
            let least = above.set(from_above);
            advance(&above, least, costs, p1, p2_down, |index, path| {
                write(from_above, index, in_order(path));
            });
        }
        let ((best, refined_q4), margin) = output;
        let paths = [previous.quads(), from_right, &*from_above];
        let key = others.meet(paths, &mut pairs);
        let selected = select(key, paths, &mut pairs, row.disparities);
        *best = selected.index;
        *refined_q4 = selected.refined_q4;
        *margin = selected.margin;
    }
    others.finish();
}

fn pixels<const QUADS: usize>(row: &[u8]) -> &[[Quad; QUADS]] {
    row.as_chunks().0.as_chunks().0
}

fn pixels_mut<const QUADS: usize>(row: &mut [u8]) -> &mut [[Quad; QUADS]] {
    row.as_chunks_mut().0.as_chunks_mut().0
}

/// Writes four path costs.
#[inline(always)]
fn write<const QUADS: usize>(path: &mut [Quad; QUADS], index: usize, costs: u32) {
    if let Some(quad) = path.get_mut(index) {
        store(costs, quad);
    }
}

/// Path costs of a pixel, with guards of the highest cost around them: beyond the range
/// no path is cheapest.
struct Path([Quad; MAX_STRIDE / 4 + 2]);

impl Path {
    const fn new() -> Self {
        Self([[u8::MAX; 4]; _])
    }

    #[inline(always)]
    fn write(&mut self, index: usize, costs: u32) {
        if let Some(quad) = self.0.get_mut(index + 1) {
            store(costs, quad);
        }
    }

    /// Copies path costs; gives the least.
    #[inline(always)]
    fn set<const QUADS: usize>(&mut self, path: &[Quad; QUADS]) -> u32 {
        let mut least = u32::MAX;
        unrolled::<QUADS>(|index| {
            let costs = quad(path, index);
            least = in_order(if index == 0 {
                costs
            } else {
                min_u8x4(least, costs)
            });
            self.write(index, costs);
        });
        least_of(least)
    }

    #[inline(always)]
    fn quads<const QUADS: usize>(&self) -> &[Quad; QUADS] {
        const { assert!(4 * QUADS <= MAX_STRIDE) };
        let [_, quads @ ..] = &self.0;
        quads.first_chunk().unwrap_or(&[[0; 4]; QUADS])
    }

    /// Four path costs, from so many disparities after those of the index on: -1 to 1.
    #[inline(always)]
    fn load(&self, index: usize, shift: isize) -> u32 {
        let start = (4 * (index + 1)).wrapping_add_signed(shift);
        let costs = self.0.as_flattened().get(start..);
        costs.and_then(<[u8]>::first_chunk).map_or(0, load)
    }
}

#[inline(always)]
fn quad<const QUADS: usize>(path: &[Quad; QUADS], index: usize) -> u32 {
    path.get(index).map_or(0, load)
}

/// One pixel along a path whose least cost is given; the same of the next, four times each.
#[inline(always)]
fn step<const QUADS: usize>(
    previous: &Path,
    least: u32,
    costs: &[Quad; QUADS],
    p1: u32,
    p2: u8,
    mut write: impl FnMut(usize, u32),
) -> u32 {
    let mut least_next = u32::MAX;
    advance(previous, least, costs, p1, p2, |index, path| {
        least_next = in_order(if index == 0 {
            path
        } else {
            min_u8x4(least_next, path)
        });
        write(index, path);
    });
    least_of(least_next)
}

/// The same without the next least.
#[inline(always)]
fn advance<const QUADS: usize>(
    previous: &Path,
    least: u32,
    costs: &[Quad; QUADS],
    p1: u32,
    p2: u8,
    mut write: impl FnMut(usize, u32),
) {
    let p2 = splat_u8(p2);
    // No path cost is below the least, and with the penalty that fits a byte.
    let ceiling = add_saturating_u8x4(least, p2);
    unrolled::<QUADS>(|index| {
        let neighbour = min_u8x4(previous.load(index, -1), previous.load(index, 1));
        let neighbour = add_saturating_u8x4(neighbour, p1);
        let reached = min_u8x4(previous.load(index, 0), neighbour);
        // The same as the smaller of `reached - least` and `p2`.
        let onward = p2.wrapping_sub(sub_saturating_u8x4(ceiling, reached));
        write(index, add_saturating_u8x4(quad(costs, index), onward));
    });
}

/// The least of four bytes, four times.
#[inline(always)]
fn least_of(quad: u32) -> u32 {
    let pair = min_u8x4(quad, quad >> 16);
    splat_u8(min_u8x4(pair, pair >> 8) as u8)
}

/// Positions of the window of [`Others`].
const WINDOW: usize = 2 * MAX_STRIDE;

/// The best match of each pixel of the other view.
///
/// Only as many positions as there are disparities are still open at a pixel; their keys
/// stand in a window that moves one position down from pixel to pixel.
struct Others<'a> {
    /// Keys of even and odd positions of the window.
    planes: [[u8; WINDOW]; 2],
    /// Position of the pixel's lowest disparity in the window.
    offset: usize,
    /// Where positions go that no later pixel has.
    done: core::iter::Rev<core::slice::IterMut<'a, u32>>,
    disparities: usize,
}

impl<'a> Others<'a> {
    /// Where the window begins: with an odd number of positions before it.
    const START: usize = WINDOW - MAX_STRIDE - 1;

    fn new(other_best: &'a mut [u32], count: usize, disparities: usize) -> Self {
        let end = (count + disparities).saturating_sub(1);
        let (done, beyond) = other_best.split_at_mut(end.min(other_best.len()));
        beyond.fill(u32::MAX);
        Self {
            planes: [[u8::MAX; WINDOW]; 2],
            offset: Self::START,
            done: done.iter_mut().rev(),
            disparities,
        }
    }

    /// Takes the next pixel's paths; gives its least key, and that of each pair of
    /// neighbouring disparities.
    #[inline(always)]
    fn meet<const QUADS: usize>(&mut self, paths: [&[Quad; QUADS]; 3], pairs: &mut Pairs) -> u32 {
        let offset = self.offset;
        let [even, odd] = &mut self.planes;
        let (even, odd) = if offset.is_multiple_of(2) {
            (even, odd)
        } else {
            (odd, even)
        };
        let (Some(even), Some(odd)) = (
            quads_from::<QUADS>(even, offset / 2 * 2),
            quads_from::<QUADS>(odd, offset.div_ceil(2) * 2),
        ) else {
            return 0;
        };
        let mut best = u32::MAX;
        unrolled::<QUADS>(|index| {
            let [left, right, above] = paths.map(|path| quad(path, index));
            // Of disparities 0 and 2 of the quad.
            let indices = splat_u16(4 * index as u16) + (2 << 16);
            let sums = add_even_bytes(add_even_bytes(even_bytes(left), right), above);
            let keys_even = opaque((sums << INDEX_BITS) + indices);
            let sums = add_odd_bytes(add_odd_bytes(odd_bytes(left), right), above);
            let keys_odd = opaque((sums << INDEX_BITS) + (indices + splat_u16(1)));
            for (others, keys) in [(&mut *even, keys_even), (&mut *odd, keys_odd)] {
                write(others, index, min_u16x2(quad(others, index), keys));
            }
            let least = min_u16x2(keys_even, keys_odd);
            best = in_order(if index == 0 {
                least
            } else {
                min_u16x2(best, least)
            });
            if let Some(pairs) = pairs.get_mut(index + 1) {
                store(least, pairs);
            }
        });
        self.retire();
        min_u16x2(best, best >> 16) & 0xffff
    }

    /// The pixel's highest disparity is where no later pixel's is.
    #[inline(always)]
    fn retire(&mut self) {
        let best = self.best(self.offset + self.disparities - 1);
        if let Some(done) = self.done.next() {
            *done = best;
        }
        if self.offset > 0 {
            self.offset -= 1;
        } else {
            self.rewind();
        }
    }

    /// Moves the window's open positions to its end.
    #[cold]
    #[inline(never)]
    fn rewind(&mut self) {
        for plane in &mut self.planes {
            let (low, high) = plane.split_at_mut(MAX_STRIDE);
            high.copy_from_slice(low);
            low.fill(u8::MAX);
        }
        self.offset = Self::START;
    }

    /// The positions that are still open, up from the last pixel's lowest disparity.
    fn finish(mut self) {
        let first = self.offset + 1;
        let done = core::mem::take(&mut self.done).rev();
        for (position, done) in (first..).zip(done) {
            *done = self.best(position);
        }
    }

    /// The best match of a position of the window.
    #[inline(always)]
    fn best(&self, position: usize) -> u32 {
        let plane = &self.planes[position % 2].as_chunks().0;
        let key = plane
            .get(position / 2)
            .map_or(0, |key| u16::from_le_bytes(*key));
        let key = u32::from(key);
        key >> INDEX_BITS << 16 | key & INDEX_MASK
    }
}

/// Quads of a plane.
#[inline(always)]
fn quads_from<const QUADS: usize>(
    plane: &mut [u8; WINDOW],
    start: usize,
) -> Option<&mut [Quad; QUADS]> {
    // No start is beyond: the bound is for the compiler.
    let quads = plane.get_mut(start.min(WINDOW - MAX_STRIDE)..)?;
    quads.as_chunks_mut().0.first_chunk_mut()
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
    paths: [&[Quad; QUADS]; 3],
    pairs: &mut Pairs,
    disparities: usize,
) -> Selected {
    let index = (key & INDEX_MASK) as usize;
    let least = (key >> INDEX_BITS) as i16;
    let sum = |index: usize| {
        (index < disparities).then(|| {
            let cost = |path: &[Quad; QUADS]| {
                path.as_flattened()
                    .get(index)
                    .map_or(0, |&cost| i16::from(cost))
            };
            cost(paths[0]) + cost(paths[1]) + cost(paths[2])
        })
    };
    let step_q4 = match (sum(index.wrapping_sub(1)), sum(index + 1)) {
        (Some(before), Some(after)) => parabola_q4(before - least, after - least),
        _ => 0,
    };
    // The pairs of the best and its neighbours have one disparity more.
    let pair = index / 2 + 2;
    let (other_pair, outer) = if index.is_multiple_of(2) {
        (pair - 1, index.wrapping_sub(2))
    } else {
        (pair + 1, index + 2)
    };
    let keys = pairs.as_flattened_mut().as_chunks_mut::<2>().0;
    for pair in [pair, other_pair] {
        if let Some(key) = keys.get_mut(pair) {
            *key = [u8::MAX; 2];
        }
    }
    let [_, pairs @ ..] = pairs;
    let second = pairs
        .iter()
        .take(QUADS)
        .fold(u32::MAX, |a, b| min_u16x2(a, load(b)));
    let second = min_u16x2(second, second >> 16) & 0xffff;
    let second = ((second >> INDEX_BITS) as i16).min(sum(outer).unwrap_or(NO_DISTANCE));
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
