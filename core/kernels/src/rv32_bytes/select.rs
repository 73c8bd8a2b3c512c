//! Winner-take-all selection from up to 64 disparities, two keys to a register.
//!
//! A key of 16 bits holds the sum of three path costs above the index of the disparity, so that the least key belongs
//! to the first of the least sums.

use bytemuck::{must_cast_slice_mut, try_cast_slice};
use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::kernel::{self, AggregateRow};

use super::instructions::{align, indexed_sums, min_u16x2, sums_high, sums_low};
use crate::armv7em::select::{DISPARITIES_MIN, INDEX_BITS, INDEX_MASK, Subpixel};
use crate::armv7em::simd::{in_order, splat_u16};

/// Largest number of disparities, rounded up to a multiple of 16.
const MAX_STRIDE: usize = 64;

/// Words of path costs whose loop is unrolled, and of the keys made of them. All rows of disparities are a multiple
/// of them.
const BLOCK: usize = 4;
const KEYS: usize = 2 * BLOCK;

/// Two keys that are not less than any other.
pub(crate) const NO_KEYS: u32 = u32::MAX;

/// Keys of a pixel, with a word before the first and one behind the last.
pub(crate) type Keys = [u32; MAX_STRIDE / 2 + 2];

/// Equals [`kernel::select_row`] bit for bit.
pub(super) fn select_row(row: &mut AggregateRow<'_>) {
    let fits =
        row.stride <= MAX_STRIDE && (DISPARITIES_MIN..=row.stride).contains(&row.disparities);
    if !fits || select_pixels(row).is_none() {
        kernel::select_row(row);
    }
}

/// Selects from the sums of path costs; returns `None` if the rows are not aligned to words, or that of the other
/// view's best is too short.
#[inline(never)]
fn select_pixels(row: &mut AggregateRow<'_>) -> Option<()> {
    let words = (row.stride / 4).max(1);
    let rows = [&*row.costs, &*row.from_right, &*row.from_above];
    let [from_left, from_right, from_above] = rows.map(|row| try_cast_slice(row).ok());
    let (from_left, from_right, from_above): (&[u32], &[u32], &[u32]) =
        (from_left?, from_right?, from_above?);
    let subpixel = Subpixel::new(&row.subpixel);
    let (count, disparities) = (row.best.len(), row.disparities);
    // The keys of all positions, packed, lie in the first half of the row.
    let reached = (count + disparities).saturating_sub(1);
    row.other_best.get(..reached.max(count + row.stride))?;
    row.other_best.fill(NO_KEYS);
    let mut keys = [NO_KEYS; _];
    let paths = from_left
        .chunks_exact(words)
        .zip(from_right.chunks_exact(words))
        .zip(from_above.chunks_exact(words));
    let outputs = row.best.iter_mut().zip(row.refined_index_q4.iter_mut());
    let outputs = outputs.zip(row.margins.iter_mut());
    for ((((left, right), above), ((best, refined_index_q4), margin)), start) in
        paths.zip(outputs).zip((0..count).rev())
    {
        let others = row.other_best.get_mut(start / 2..)?;
        let key = if start.is_multiple_of(2) {
            meet::<false>([left, right, above], others, &mut keys)
        } else {
            meet::<true>([left, right, above], others, &mut keys)
        };
        let selected = select(min_u16x2, key, &mut keys, disparities, words, &subpixel);
        *best = selected.index;
        *refined_index_q4 = selected.refined_index_q4;
        *margin = selected.margin;
    }
    unpack(row.other_best, reached);
    Some(())
}

/// Makes the keys of a pixel, meets them with those of the positions of the other view that its disparities reach,
/// and returns the least. The first position is the high half of the first word of `others` if `IS_ODD`, else the low
/// half.
#[inline(always)]
fn meet<const IS_ODD: bool>(paths: [&[u32]; 3], others: &mut [u32], keys: &mut Keys) -> u32 {
    let [left, right, above] = paths.map(|path| path.as_chunks::<BLOCK>().0);
    let [_, keys @ ..] = keys;
    let blocks = left.iter().zip(right).zip(above);
    let blocks = blocks.zip(keys.as_chunks_mut::<KEYS>().0);
    let (blocks_of_others, rest) = others.as_chunks_mut::<KEYS>();
    let mut blocks_of_others = blocks_of_others.iter_mut();
    let mut run = Run {
        least: [NO_KEYS; 2],
        first: 0,
        before: NO_KEYS,
    };
    for ((((left, right), above), keys), others) in blocks.zip(&mut blocks_of_others) {
        let (&[a, b, c, d], &[e, f, g, h], &[i, j, k, l]) = (left, right, above);
        if let ([keys, more_keys], []) = keys.as_chunks_mut()
            && let ([others, more_others], []) = others.as_chunks_mut()
        {
            run.meet::<IS_ODD, 0, 1, 2, 3>([[a, b], [e, f], [i, j]], others, keys);
            run.meet::<IS_ODD, 4, 5, 6, 7>([[c, d], [g, h], [k, l]], more_others, more_keys);
        }
        run.first += splat_u16(16);
    }
    if IS_ODD
        && let Some(other) = match blocks_of_others.into_slice() {
            [] => rest.first_mut(),
            [others, ..] => others.first_mut(),
        }
    {
        *other = min_u16x2(*other, align::<2>(run.before, NO_KEYS));
    }
    let least = min_u16x2(run.least[0], run.least[1]);
    min_u16x2(least, least >> 16) & 0xffff
}

/// Keys of a pixel, made from the lowest disparity on.
struct Run {
    /// The least keys so far, of either half of words.
    least: [u32; 2],
    /// First disparity of the block, in both halves.
    first: u32,
    /// The keys before the next ones.
    before: u32,
}

impl Run {
    /// Makes the keys of eight disparities, whose words of two are these of a block, and meets them with those of the
    /// other view. The path costs are those from left, right and above.
    #[inline(always)]
    fn meet<const IS_ODD: bool, const A: u32, const B: u32, const C: u32, const D: u32>(
        &mut self,
        [left, right, above]: [[u32; 2]; 3],
        others: &mut [u32; KEYS / 2],
        keys: &mut [u32; KEYS / 2],
    ) {
        let met = *others;
        let sums = [
            sums_low(left[0], right[0]),
            sums_high(left[0], right[0]),
            sums_low(left[1], right[1]),
            sums_high(left[1], right[1]),
        ];
        let found = [
            indexed_sums::<A>(sums[0], above[0]),
            indexed_sums::<B>(sums[1], above[0]),
            indexed_sums::<C>(sums[2], above[1]),
            indexed_sums::<D>(sums[3], above[1]),
        ];
        let found = found.map(|keys| keys + self.first);
        let pairs = [min_u16x2(found[0], found[1]), min_u16x2(found[2], found[3])];
        self.least = [
            min_u16x2(self.least[0], pairs[0]),
            min_u16x2(self.least[1], pairs[1]),
        ];
        let moved = if IS_ODD {
            [
                align::<2>(self.before, found[0]),
                align::<2>(found[0], found[1]),
                align::<2>(found[1], found[2]),
                align::<2>(found[2], found[3]),
            ]
        } else {
            found
        };
        self.before = found[3];
        let words: [usize; KEYS / 2] = [0, 1, 2, 3];
        // All is computed before anything is stored.
        let met = words
            .map(|word| min_u16x2(met[word], moved[word]))
            .map(in_order);
        *keys = found.map(in_order);
        *others = met;
    }
}

/// Writes the best matches of the other view, as [`AggregateRow::other_best`], in the place of their keys, the last first.
pub(crate) fn unpack(others: &mut [u32], reached: usize) {
    let unpacked = |key: u32| (key >> INDEX_BITS) << 16 | key & INDEX_MASK;
    for word in (0..reached.div_ceil(2)).rev() {
        let keys = others.get(word).copied().unwrap_or(NO_KEYS);
        let (low, high) = (unpacked(keys & 0xffff), unpacked(keys >> 16));
        let places = others.get_mut(2 * word..).unwrap_or_default();
        match places {
            [first, second, ..] => (*first, *second) = (low, high),
            [last] => *last = low,
            [] => {}
        }
    }
    others.get_mut(reached..).unwrap_or_default().fill(u32::MAX);
}

/// Result of the selection for one pixel, as in [`AggregateRow`].
pub(crate) struct Selected {
    pub(crate) index: u16,
    pub(crate) refined_index_q4: i16,
    pub(crate) margin: i16,
}

/// Returns the best disparity, refined by the sums of its neighbours, and its margin over the second best. Overwrites
/// the keys around the best. `lesser` gives the lesser halfword of each lane.
#[inline(always)]
pub(crate) fn select(
    lesser: impl Fn(u32, u32) -> u32,
    key: u32,
    keys: &mut Keys,
    disparities: usize,
    words: usize,
    subpixel: &Subpixel,
) -> Selected {
    let (sum, index) = (key >> INDEX_BITS, (key & INDEX_MASK) as usize);
    // From the disparity below the best on; there are two keys before the first.
    let around: &mut [u16] = must_cast_slice_mut(keys.as_mut_slice());
    let mut step_q4 = 0;
    if let Some([before, best, after]) = around
        .get_mut(index + 1..index + 4)
        .and_then(<[_]>::first_chunk_mut)
    {
        if index > 0 && index + 1 < disparities {
            let rise = |key: u16| (u32::from(key) >> INDEX_BITS) - sum;
            step_q4 = subpixel.step_q4(rise(*before), rise(*after));
        }
        (*before, *best, *after) = (u16::MAX, u16::MAX, u16::MAX);
    }
    let [_, keys @ ..] = keys;
    let mut least = [NO_KEYS; 2];
    for keys in keys.as_chunks::<KEYS>().0.iter().take(words / BLOCK) {
        let [a, b, c, d, e, f, g, h] = *keys;
        let first = lesser(lesser(a, c), lesser(e, g));
        let second = lesser(lesser(b, d), lesser(f, h));
        least = [lesser(least[0], first), lesser(least[1], second)];
    }
    let least = lesser(least[0], least[1]);
    let second = (lesser(least, least >> 16) & 0xffff) >> INDEX_BITS;
    Selected {
        index: index as u16,
        refined_index_q4: (index as i32 * i32::from(STEPS_PER_PX) + step_q4) as i16,
        margin: (second - sum) as i16,
    }
}
