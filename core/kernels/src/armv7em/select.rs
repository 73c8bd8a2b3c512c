//! Winner-take-all selection from up to 64 disparities, two keys to a register.
//!
//! A key of 16 bits holds the sum of three path costs above the index of the disparity, so that the
//! least key belongs to the first of the least sums. Even and odd disparities have separate
//! registers of keys, because that is how bytes widen to halfwords. The least key of each pair of
//! neighbouring disparities is kept for finding the second best.

use bytemuck::{must_cast_slice, must_cast_slice_mut, try_cast_slice};
use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::kernel::{self, AggregateRow};

use super::aggregate::MAX_STRIDE;
use super::simd::{
    add_even_bytes, add_odd_bytes, even_bytes, in_order, load, meet_all, min_u16x2, odd_bytes,
    opaque, splat_u16, store, unrolled,
};

/// Bits of the index, which is below the sum in a key. A sum is at most 3 * 255.
const INDEX_BITS: u32 = 6;
const INDEX_MASK: u32 = (1 << INDEX_BITS) - 1;

/// Smallest number of disparities: of as many, there is always a second best.
const DISPARITIES_MIN: usize = 4;

/// Least key of each pair of disparities, with a guard word at either end.
type Minima = [u32; MAX_STRIDE / 4 + 2];

/// Equals [`kernel::select_row`] bit for bit.
pub(super) fn select_row(row: &mut AggregateRow<'_>) {
    // One more than the positions of the other view that all pixels' disparities reach.
    let slots = row.best.len() + row.disparities;
    let is_whole = (DISPARITIES_MIN..=row.stride).contains(&row.disparities)
        && row.other_best.len() + 1 >= slots;
    let selected = match row.stride {
        16 if is_whole => select_pixels::<4>(row),
        32 if is_whole => select_pixels::<8>(row),
        48 if is_whole => select_pixels::<12>(row),
        MAX_STRIDE if is_whole => select_pixels::<16>(row),
        _ => None,
    };
    if selected.is_none() {
        kernel::select_row(row);
    }
}

/// Selects from the sums of path costs of `4 * QUADS` disparities; returns `None` if the rows are
/// not aligned to words.
#[inline(never)]
fn select_pixels<const QUADS: usize>(row: &mut AggregateRow<'_>) -> Option<()> {
    let paths = pixels::<QUADS>(row.costs)?
        .iter()
        .zip(pixels(row.from_right)?)
        .zip(pixels(row.from_above)?);
    let disparities = row.disparities;
    let subpixel = Subpixel {
        relief: row.subpixel.relief.into(),
        lines_min: row.subpixel.lines_min.into(),
    };
    let end = (row.best.len() + disparities).saturating_sub(1);
    let (inside, beyond) = row.other_best.split_at_mut(end.min(row.other_best.len()));
    beyond.fill(u32::MAX);
    // Positions still open after the last pixel: those of its disparities below the highest.
    let open = disparities.saturating_sub(1).min(inside.len());
    let (open, done) = inside.split_at_mut(open);
    let mut window = [0; _];
    let mut others = Others::new(&mut window);
    let mut minima = [u32::MAX; _];
    let outputs = row.best.iter_mut().zip(&mut *row.refined_index_q4);
    let outputs = outputs.zip(&mut *row.margins).zip(done.iter_mut().rev());
    for (((from_left, from_right), from_above), (((best, refined_index_q4), margin), done)) in
        paths.zip(outputs)
    {
        let paths = [from_left, from_right, from_above];
        let key = in_order(others.meet(paths, &mut minima));
        // No later pixel reaches the position of this pixel's highest disparity.
        *done = others.best(open.len());
        let selected = select(key, paths, &mut minima, disparities, &subpixel);
        *best = selected.index;
        *refined_index_q4 = selected.refined_index_q4;
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

/// Bytes of the window of [`Others`] for the keys of every other position.
const PLANE: usize = 2 * MAX_STRIDE;

/// Keys of every other position, then those of the positions between. No run of keys begins in the
/// `MAX_STRIDE` bytes after them, which only spare bounds checks.
type Window = [u8; 2 * PLANE + MAX_STRIDE];

/// Best match of each pixel of the other view, for the left-right check.
///
/// At any pixel, only as many positions are open as there are disparities. Their keys stand in a
/// window that moves down by one position from pixel to pixel.
struct Others<'a> {
    keys: &'a mut Window,
    /// Byte of the window at which the keys of the pixel's even disparities begin.
    even: usize,
    /// Byte of the window at which the keys of the pixel's odd disparities begin.
    odd: usize,
}

impl<'a> Others<'a> {
    /// Returns the state before the first pixel, one position above it.
    fn new(keys: &'a mut Window) -> Self {
        *keys = [u8::MAX; _];
        Self {
            keys,
            even: 2 * PLANE - MAX_STRIDE,
            odd: PLANE - MAX_STRIDE + 2,
        }
    }

    /// Adds the path costs of the next pixel. Returns its least key, and writes the least key of
    /// each pair of neighbouring disparities to `minima`.
    #[inline(always)]
    fn meet<const QUADS: usize>(&mut self, paths: [&[u32; QUADS]; 3], minima: &mut Minima) -> u32 {
        if self.odd.is_multiple_of(PLANE) {
            rewind(self.keys);
            self.even += MAX_STRIDE;
            self.odd += MAX_STRIDE;
        }
        // A position at an even disparity of one pixel is at the next higher, odd, disparity of the
        // next.
        (self.even, self.odd) = ((self.odd - 2) % (2 * PLANE), self.even % (2 * PLANE));
        let mut best = None;
        unrolled::<QUADS>(|index| {
            let least = self.meet_quad(index, paths.map(|path| path[index]));
            best = Some(in_order(best.map_or(least, |best| min_u16x2(best, least))));
            minima[index + 1] = least;
        });
        let best = best.unwrap_or(u32::MAX);
        min_u16x2(best, best >> 16) & 0xffff
    }

    /// Adds four of the pixel's disparities; returns the lesser key of each pair.
    #[inline(always)]
    fn meet_quad(&mut self, quad: usize, [left, right, above]: [u32; 3]) -> u32 {
        // Indices of disparities 0 and 2 of the four.
        let indices = splat_u16(4 * quad as u16) + (2 << 16);
        let sums = add_even_bytes(add_even_bytes(even_bytes(left), right), above);
        let keys_even = opaque((sums << INDEX_BITS) + indices);
        let sums = add_odd_bytes(add_odd_bytes(odd_bytes(left), right), above);
        let keys_odd = opaque((sums << INDEX_BITS) + (indices + splat_u16(1)));
        for (start, keys) in [(self.even, keys_even), (self.odd, keys_odd)] {
            let others = self.keys.get_mut(start + 4 * quad..);
            if let Some(others) = others.and_then(<[u8]>::first_chunk_mut) {
                store(in_order(min_u16x2(load(others), keys)), others);
            }
        }
        min_u16x2(keys_even, keys_odd)
    }

    /// Best match of the position that the pixel reaches at `disparity`, as `sum << 16 | index`.
    #[inline(always)]
    fn best(&self, disparity: usize) -> u32 {
        let start = if disparity.is_multiple_of(2) {
            self.even
        } else {
            self.odd
        };
        // The remainder changes nothing; it spares a bounds check.
        let key = self.keys.get(start + disparity / 2 * 2 % MAX_STRIDE..);
        let key = key.and_then(<[u8]>::first_chunk);
        let key = key.map_or(0, |key| u32::from(u16::from_le_bytes(*key)));
        opaque(key >> INDEX_BITS) << 16 | key & INDEX_MASK
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

/// Result of the selection for one pixel, as in [`AggregateRow`].
struct Selected {
    index: u16,
    refined_index_q4: i16,
    margin: i16,
}

/// Returns the best disparity, refined by the sums of its neighbours, and its margin over
/// the second best.
#[inline(always)]
fn select<const QUADS: usize>(
    key: u32,
    paths: [&[u32; QUADS]; 3],
    minima: &mut Minima,
    disparities: usize,
    subpixel: &Subpixel,
) -> Selected {
    let index = key & INDEX_MASK;
    let least = key >> INDEX_BITS;
    let paths: [&[u8]; 3] = paths.map(|path| must_cast_slice(path.as_slice()));
    let sums = |first: u32, count: usize| {
        let first = first as usize;
        let costs = paths.map(|path| path.get(first..first + count).unwrap_or_default());
        move |index: usize| {
            costs
                .iter()
                .map(|costs| u32::from(costs[index]))
                .sum::<u32>()
        }
    };
    let before = index.wrapping_sub(1);
    let step_q4 = if before < disparities as u32 - 2 && before < 4 * QUADS as u32 - 2 {
        let sum = sums(before, 3);
        subpixel.step_q4(sum(0) - least, sum(2) - least)
    } else {
        0
    };
    // The best disparity and its neighbours are in two pairs; the fourth disparity in these pairs
    // is two before an even best disparity and two after an odd one. It is compared by itself.
    let outer = (index + 4 * (index % 2)).wrapping_sub(2);
    let keys: &mut [u16] = must_cast_slice_mut(minima.as_mut_slice());
    for disparity in [index, outer] {
        if let Some(key) = keys.get_mut((disparity.wrapping_add(4) / 2) as usize) {
            *key = u16::MAX;
        }
    }
    let [_, minima @ ..] = minima;
    let second = least_of(minima.get(..QUADS).unwrap_or_default());
    let mut second = second >> INDEX_BITS;
    if outer < disparities as u32 && outer < 4 * QUADS as u32 {
        second = second.min(sums(outer, 1)(0));
    }
    Selected {
        index: index as u16,
        refined_index_q4: (index as i32 * i32::from(STEPS_PER_PX) + step_q4) as i16,
        margin: (second - least) as i16,
    }
}

/// The least of the keys in these words.
#[inline(always)]
fn least_of(words: &[u32]) -> u32 {
    let least = meet_all(words, min_u16x2);
    min_u16x2(least, least >> 16) & 0xffff
}

/// How the sub-pixel step follows from the sums, as in [`SubpixelStep`](vgstereo_core::kernel::SubpixelStep).
struct Subpixel {
    relief: u32,
    lines_min: u32,
}

impl Subpixel {
    /// Equals [`kernel::subpixel_step_q4`] bit for bit. A processor that divides in hardware takes less
    /// time for one division than for the steps that replace it there.
    #[inline(always)]
    fn step_q4(&self, before: u32, after: u32) -> i32 {
        let (larger, smaller) = (before.max(after), before.min(after));
        let relief = self.relief.min((5 * larger) >> 4);
        let relieved = (larger - relief, smaller.saturating_sub(relief));
        let is_weak = larger < self.lines_min;
        let divisor = relieved.0 + if is_weak { relieved.1 } else { 0 };
        let difference = relieved.0 - relieved.1;
        let steps = (16 * difference + divisor).checked_div(2 * divisor);
        let steps = steps.unwrap_or(0) as i32;
        if before >= after { steps } else { -steps }
    }
}
