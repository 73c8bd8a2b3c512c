//! Winner-take-all selection from up to 64 disparities. Path costs are summed up two to a register; keys are
//! compared one by one, because the least of two numbers rarely changes and costs a branch.
//!
//! The upper half of a key holds the sum of three path costs above the index of the disparity, so that the
//! least key belongs to the first of the least sums. Its lower half is of no account: no two keys that are
//! compared have the same upper half.

use bytemuck::{must_cast_slice, try_cast_slice};
use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::kernel::{self, AggregateRow};

use super::group::MAX_STRIDE;
use super::least::least;
use super::unrolled::unrolled;
use crate::armv7em::select::{DISPARITIES_MIN, INDEX_BITS, INDEX_MASK, Subpixel};
use crate::armv7em::simd::{even_bytes, odd_bytes, splat_u16};

/// Bits below the sum in a key.
const SUM_SHIFT: u32 = 16 + INDEX_BITS;

/// Disparities whose path costs share a word.
const QUAD: usize = 4;

/// Disparities whose loop is unrolled, and the words of their path costs.
const BLOCK: usize = 16;
const WORDS: usize = BLOCK / QUAD;

/// Least key of each word of path costs.
type Minima = [u32; MAX_STRIDE / QUAD];

/// Equals [`kernel::select_row`] bit for bit.
pub(super) fn select_row(row: &mut AggregateRow<'_>) {
    let fits =
        row.stride <= MAX_STRIDE && (DISPARITIES_MIN..=row.stride).contains(&row.disparities);
    if !fits || select_pixels(row).is_none() {
        kernel::select_row(row);
    }
}

/// Selects from the sums of path costs; returns `None` if the rows are not aligned to words.
#[inline(never)]
fn select_pixels(row: &mut AggregateRow<'_>) -> Option<()> {
    let words = (row.stride / QUAD).max(1);
    let rows = [&*row.costs, &*row.from_right, &*row.from_above];
    let [from_left, from_right, from_above] = rows.map(|row| try_cast_slice(row).ok());
    let (from_left, from_right, from_above): (&[u32], &[u32], &[u32]) =
        (from_left?, from_right?, from_above?);
    let subpixel = Subpixel::new(&row.subpixel);
    let (count, disparities) = (row.best.len(), row.disparities);
    let reached = (count + disparities).saturating_sub(1);
    row.other_best.get(..reached)?;
    row.other_best.fill(u32::MAX);
    let mut minima = [u32::MAX; _];
    let paths = from_left
        .chunks_exact(words)
        .zip(from_right.chunks_exact(words));
    let paths = paths.zip(from_above.chunks_exact(words));
    let outputs = row.best.iter_mut().zip(row.refined_index_q4.iter_mut());
    let outputs = outputs.zip(row.margins.iter_mut());
    let starts = (0..count).rev();
    for ((((left, right), above), ((best, refined_index_q4), margin)), start) in
        paths.zip(outputs).zip(starts)
    {
        let pixel = Pixel {
            paths: [left, right, above],
            disparities,
        };
        let Some(others) = row.other_best.get_mut(start..start + disparities) else {
            break;
        };
        pixel.meet(others, &mut minima);
        let selected = pixel.select(&mut minima, &subpixel);
        *best = selected.index;
        *refined_index_q4 = selected.refined_index_q4;
        *margin = selected.margin;
    }
    for other in row.other_best.get_mut(..reached)? {
        let key = *other >> 16;
        *other = (key >> INDEX_BITS) << 16 | key & INDEX_MASK;
    }
    Some(())
}

/// Result of the selection for one pixel, as in [`AggregateRow`].
struct Selected {
    index: u16,
    refined_index_q4: i16,
    margin: i16,
}

/// Path costs of a pixel, from left, right and above.
struct Pixel<'a> {
    paths: [&'a [u32]; 3],
    disparities: usize,
}

impl Pixel<'_> {
    /// Compares the pixel's keys with the least ones of `others`, the positions of the other view that its
    /// disparities reach, and writes the least key of each word.
    #[inline(always)]
    fn meet(&self, others: &mut [u32], minima: &mut Minima) {
        let [left, right, above] = self.paths.map(|path| path.as_chunks::<WORDS>().0);
        let (blocks, rest) = others.as_chunks_mut::<BLOCK>();
        let first_rest = BLOCK * blocks.len();
        // Those of even and of odd disparities.
        let mut indices = [2 << 16, 3 << 16 | 1];
        let blocks = left.iter().zip(right).zip(above).zip(blocks);
        let minima_blocks = minima.as_chunks_mut::<WORDS>().0;
        for ((((left, right), above), others), minima) in blocks.zip(minima_blocks) {
            unrolled::<WORDS>(|word| {
                let Some(others) = others.as_chunks_mut::<QUAD>().0.get_mut(word) else {
                    return;
                };
                minima[word] = meet_quad([left[word], right[word], above[word]], indices, others);
                indices = indices.map(|pair| pair + splat_u16(QUAD as u16));
            });
        }
        if !rest.is_empty() {
            self.meet_rest(first_rest, rest, minima);
        }
    }

    /// Compares the keys of the disparities from `first` on, too few to fill a block, as [`meet`](Self::meet) does.
    #[inline(never)]
    fn meet_rest(&self, first: usize, others: &mut [u32], minima: &mut Minima) {
        let minima = minima.get_mut(first / QUAD..).unwrap_or_default();
        minima.fill(u32::MAX);
        for (others, (minimum, first)) in others
            .chunks_mut(QUAD)
            .zip(minima.iter_mut().zip((first..).step_by(QUAD)))
        {
            for (other, disparity) in others.iter_mut().zip(first..) {
                let key = self.sum(disparity) << SUM_SHIFT | (disparity as u32) << 16;
                *other = key.min(*other);
                *minimum = key.min(*minimum);
            }
        }
    }

    /// Sum of the path costs at a disparity.
    #[inline(always)]
    fn sum(&self, disparity: usize) -> u32 {
        let costs = self
            .paths
            .map(|path| must_cast_slice::<_, u8>(path).get(disparity));
        costs
            .into_iter()
            .flatten()
            .map(|&cost| u32::from(cost))
            .sum()
    }

    /// Returns the best disparity, refined by the sums of its neighbours, and its margin over the second
    /// best.
    #[inline(always)]
    fn select(&self, minima: &mut Minima, subpixel: &Subpixel) -> Selected {
        let minima = minima
            .get_mut(..self.disparities.div_ceil(QUAD))
            .unwrap_or_default();
        let best = least_of(minima);
        let (sum, index) = (best >> SUM_SHIFT, best >> 16 & INDEX_MASK);
        let index = index as usize;
        let step_q4 = if index > 0 && index + 1 < self.disparities {
            subpixel.step_q4(self.sum(index - 1) - sum, self.sum(index + 1) - sum)
        } else {
            0
        };
        // The second best is in another word than the best and its neighbours, or beside them in theirs.
        let (first, last) = (index.saturating_sub(1) / QUAD, (index + 1) / QUAD);
        for word in [first, last] {
            if let Some(minimum) = minima.get_mut(word) {
                *minimum = u32::MAX;
            }
        }
        let mut second = least(
            self.least_beside(first, index),
            least_of(minima) >> SUM_SHIFT,
        );
        if last > first {
            second = least(second, self.least_beside(last, index));
        }
        Selected {
            index: index as u16,
            refined_index_q4: (index as i32 * i32::from(STEPS_PER_PX) + step_q4) as i16,
            margin: (second - sum) as i16,
        }
    }
}

impl Pixel<'_> {
    /// The least sum of a word's disparities but the best one and its neighbours.
    #[inline(always)]
    fn least_beside(&self, word: usize, best: usize) -> u32 {
        let mut found = u32::MAX;
        let [left, right, above] = self.paths.map(|path| path.get(word).copied());
        if let (Some(left), Some(right), Some(above)) = (left, right, above) {
            let even = even_bytes(left) + even_bytes(right) + even_bytes(above);
            let odd = odd_bytes(left) + odd_bytes(right) + odd_bytes(above);
            let sums = [even & 0xffff, odd & 0xffff, even >> 16, odd >> 16];
            // Beyond the range, sums are the largest there are.
            for (sum, disparity) in sums.into_iter().zip(QUAD * word..) {
                if disparity.abs_diff(best) > 1 {
                    found = least(found, sum);
                }
            }
        }
        found
    }
}

/// Compares the keys of four disparities with the least ones of the other view's positions, and returns the
/// least key. The path costs are those from left, right and above.
#[inline(always)]
fn meet_quad([left, right, above]: [u32; 3], indices: [u32; 2], others: &mut [u32; QUAD]) -> u32 {
    let even = even_bytes(left) + even_bytes(right) + even_bytes(above);
    let odd = odd_bytes(left) + odd_bytes(right) + odd_bytes(above);
    let even = (even << INDEX_BITS) + indices[0];
    let odd = (odd << INDEX_BITS) + indices[1];
    let keys = [even << 16, odd << 16, even, odd];
    for (other, key) in others.iter_mut().zip(keys) {
        // Most keys are not written.
        if key < *other {
            *other = key;
        }
    }
    let [a, b, c, d] = keys;
    least(least(a, b), least(c, d))
}

/// The least of these keys.
#[inline(always)]
fn least_of(keys: &[u32]) -> u32 {
    let (blocks, rest) = keys.as_chunks();
    let mut found = u32::MAX;
    for &[a, b, c, d] in blocks {
        found = least(least(least(least(found, a), b), c), d);
    }
    rest.iter().fold(found, |found, &key| least(found, key))
}
