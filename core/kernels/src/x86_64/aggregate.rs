//! Aggregation of up to 64 disparities in vector registers: the path costs of a pixel stay in
//! registers from pixel to pixel.
//!
//! All instruction sets share the loops: [`aggregate_in_registers`] is expanded beside the
//! operations on each set's registers.

use core::cell::Cell;
use std::vec::Vec;

use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::kernel::{
    AggregateRow, NO_DISTANCE, SubpixelStep, path_scratch_bytes, subpixel_steps_q4,
};

/// Largest number of disparities that the registers hold, rounded up to a multiple of 16.
pub(super) const MAX_STRIDE: usize = 64;

/// Whether all slices have the lengths that the row states, on which the registers rely.
pub(super) fn is_whole(row: &AggregateRow<'_>) -> bool {
    let count = row.best.len();
    let costs = [&*row.costs, row.from_right, row.from_above];
    let outputs = [row.refined_index_q4.len(), row.margins.len()];
    let penalties = [row.p2_along.len(), row.p2_down.len()];
    (1..=row.stride).contains(&row.disparities)
        && (costs.iter()).all(|costs| Some(costs.len()) == count.checked_mul(row.stride))
        && outputs == [count; 2]
        && penalties == [count; 2]
        && row.paths.len() >= path_scratch_bytes(row.stride)
        && row.sums.len() == row.stride
        && row.other_best.len().saturating_add(1) >= count.saturating_add(row.disparities)
}

/// Number of pixels whose results are written together.
pub(super) const BLOCK: usize = 32;

/// Key of no match: greater than the key of every sum.
pub(super) const NO_KEY: u16 = u16::MAX;

/// Bits of the index in a key, which is below the sum, at most 3 * 255. So the least key belongs to
/// the first of the least sums.
pub(super) const INDEX_BITS: u32 = 6;

/// Place of a disparity's key: all odd disparities follow all even ones, because bytes then widen
/// to words without a shuffle.
#[inline]
pub(super) const fn place(index: usize) -> usize {
    let index = index % MAX_STRIDE;
    index / 2 + index % 2 * (MAX_STRIDE / 2)
}

/// Lower bits of the keys in the order of [`place`]: the index, and [`NO_KEY`] beyond the range.
pub(super) fn key_tails(disparities: usize) -> [u16; MAX_STRIDE] {
    let mut tails = [NO_KEY; MAX_STRIDE];
    for (index, tail) in (0..disparities.min(MAX_STRIDE)).zip(0..) {
        tails[place(index)] = tail;
    }
    tails
}

/// Places of the keys of a disparity and of its neighbours below and above. At either end of the
/// range, the disparity's own place stands for the missing neighbour's.
#[inline(always)]
fn places_around(index: usize) -> [u8; 3] {
    static PLACES: [[u8; 3]; MAX_STRIDE] = {
        let mut places = [[0; 3]; MAX_STRIDE];
        let mut index = 0;
        while index < MAX_STRIDE {
            let after = if index + 1 < MAX_STRIDE {
                index + 1
            } else {
                index
            };
            places[index] = [
                place(index.saturating_sub(1)) as u8,
                place(index) as u8,
                place(after) as u8,
            ];
            index += 1;
        }
        places
    };
    PLACES[index % MAX_STRIDE]
}

/// Returns the key of a disparity.
#[inline]
pub(super) fn key_at(keys: &[u16; MAX_STRIDE], index: usize) -> u16 {
    keys[place(index)]
}

/// Converts a key to the format of core's `AggregateRow::other_best`.
#[inline]
pub(super) fn other_of(key: u16) -> u32 {
    let all_ones = u32::from(key == NO_KEY).wrapping_neg();
    all_ones | (u32::from(key >> INDEX_BITS) << 16) | (u32::from(key) % MAX_STRIDE as u32)
}

/// Keys of a pixel, in the order of [`place`]; aligned, so that no load straddles two cache lines.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct PixelKeys(pub(super) [u16; MAX_STRIDE]);

/// Keys of a block of pixels before the results are written. Each field holds all pixels, so that
/// the loops over them are vectorised.
#[derive(Debug)]
pub(super) struct SelectedBlock {
    /// Keys of each pixel's disparities; [`SelectedBlock::remove_best`] takes some out.
    pub(super) keys: [PixelKeys; BLOCK],
    /// Keys of the best disparity, and of the second best, which is no neighbour of the best.
    pub(super) least: [u16; BLOCK],
    pub(super) second: [u16; BLOCK],
    /// Keys of the best disparity's neighbours; not meaningful at the ends of the range.
    before: [u16; BLOCK],
    after: [u16; BLOCK],
    /// Keys of the other view's pixels that are final, the last one first.
    pub(super) others: [u16; BLOCK],
}

impl SelectedBlock {
    pub(super) const NONE: Self = Self {
        keys: [PixelKeys([NO_KEY; MAX_STRIDE]); BLOCK],
        least: [NO_KEY; BLOCK],
        second: [NO_KEY; BLOCK],
        before: [NO_KEY; BLOCK],
        after: [NO_KEY; BLOCK],
        others: [NO_KEY; BLOCK],
    };

    /// Replaces the keys of the best disparity and its neighbours by [`NO_KEY`], so that the second
    /// best can be found.
    #[inline(always)]
    pub(super) fn remove_best(&mut self) {
        let sides = self.before.iter_mut().zip(&mut self.after);
        for ((keys, least), (before, after)) in self.keys.iter_mut().zip(self.least).zip(sides) {
            let [first, middle, last] = places_around(least.into()).map(usize::from);
            *before = keys.0[first % MAX_STRIDE];
            *after = keys.0[last % MAX_STRIDE];
            for place in [first, middle, last] {
                keys.0[place % MAX_STRIDE] = NO_KEY;
            }
        }
    }

    /// Writes the results of the first `best.len()` pixels. Inlined, so that it is compiled for the
    /// caller's instruction set.
    #[inline(always)]
    pub(super) fn write(
        &self,
        disparities: usize,
        subpixel: &SubpixelStep,
        best: &mut [u16],
        refined_index_q4: &mut [i16],
        margins: &mut [i16],
    ) {
        let last = disparities as u16 - 1;
        let mut indices = [0; BLOCK];
        let (mut before, mut after) = ([0; BLOCK], [0; BLOCK]);
        let mut margin = [0; BLOCK];
        for lane in 0..BLOCK {
            let (least, second) = (self.least[lane], self.second[lane]);
            let index = least % MAX_STRIDE as u16;
            let sum = sum_of(least);
            // All ones if the best disparity has a neighbour on either side.
            let is_inside = -i16::from((index > 0) & (index < last));
            before[lane] = (sum_of(self.before[lane]) - sum) & is_inside;
            after[lane] = (sum_of(self.after[lane]) - sum) & is_inside;
            indices[lane] = index;
            let second = if second == NO_KEY {
                NO_DISTANCE
            } else {
                sum_of(second)
            };
            margin[lane] = second - sum;
        }
        let mut refined = subpixel_steps_q4(subpixel, &before, &after);
        for (refined, &index) in refined.iter_mut().zip(&indices) {
            *refined += index.cast_signed() * STEPS_PER_PX;
        }
        let count = best.len();
        best.copy_from_slice(&indices[..count]);
        refined_index_q4.copy_from_slice(&refined[..count]);
        margins.copy_from_slice(&margin[..count]);
    }
}

/// Returns the sum in a key.
#[inline(always)]
fn sum_of(key: u16) -> i16 {
    (key >> INDEX_BITS).cast_signed()
}

std::thread_local! {
    /// Scratch of a thread: path costs from the left of one row of pixels.
    pub(super) static FROM_LEFT: Cell<Vec<u8>> = const { Cell::new(Vec::new()) };
}

/// Defines `aggregate_row`, which equals core's kernels bit for bit and calls them for more
/// disparities than [`MAX_STRIDE`] and for a row that is not whole; see [`is_whole`].
///
/// A macro, because a function cannot be compiled for the instruction set of its caller. Where it
/// is expanded, it expects:
///
/// - `Costs`, the bytes of [`MAX_STRIDE`] disparities, with `broadcast`, `load` (255 after the end
///   of the slice), `store` (as many as the slice has), `are_equal` and `step_path`; without
///   `FULL`, the last place never has a disparity;
/// - `Keys`, as many words in the order of [`place`], with `join` (sums three path costs and puts
///   them above the tails of the keys), `lesser`, `least_key`, `key_in` (the key in a place), and
///   `advance`, which moves every key to the next disparity.
macro_rules! aggregate_in_registers {
    ($features:literal) => {
        #[target_feature(enable = $features)]
        pub(super) fn aggregate_row(row: &mut AggregateRow<'_>) {
            match row.stride {
                16..=MAX_STRIDE if !is_whole(row) => {
                    kernel::aggregate_paths(row);
                    kernel::select_row(row);
                }
                16 => aggregate_registers::<16, false>(row),
                32 => aggregate_registers::<32, false>(row),
                48 => aggregate_registers::<48, false>(row),
                64 if row.disparities < 64 => aggregate_registers::<64, false>(row),
                64 => aggregate_registers::<64, true>(row),
                _ => {
                    kernel::aggregate_paths(row);
                    kernel::select_row(row);
                }
            }
        }

        /// Aggregates and selects with a stride of at most [`MAX_STRIDE`] that is known at compile
        /// time.
        #[target_feature(enable = $features)]
        fn aggregate_registers<const STRIDE: usize, const FULL: bool>(row: &mut AggregateRow<'_>) {
            let count = row.best.len();
            row.other_best.fill(u32::MAX);
            if count == 0 {
                return;
            }
            let p1 = broadcast(row.p1);
            // A path begins after costs that are all equal: a step from them costs nothing.
            let beginning = broadcast(0);

            let mut scratch = FROM_LEFT.take();
            scratch.resize(scratch.len().max(count * STRIDE), 0);
            let from_left = &mut scratch.as_chunks_mut::<STRIDE>().0[..count];
            let from_right = &mut row.from_right.as_chunks_mut::<STRIDE>().0[..count];
            let from_above = &mut row.from_above.as_chunks_mut::<STRIDE>().0[..count];
            let costs = &row.costs.as_chunks::<STRIDE>().0[..count];
            let (p2_along, p2_down) = (&row.p2_along[..count], &row.p2_down[..count]);
            if row.is_first {
                from_above.as_flattened_mut().fill(0);
            }

            // Along a path, each pixel depends on the one before. The loop interleaves four such
            // paths, which hide each other's latency: one from either end, and two from the middle,
            // as if the line began there. The paths down do not depend on each other.
            let half = count / 2;
            let second_start = count - half;
            let mut paths = [beginning; 4];
            // P2 between a pixel and the one on its right.
            let mut p2_right = [0; 2];
            for x in 0..half {
                for (path, x) in paths.iter_mut().zip([x, second_start + x]) {
                    let costs = load(&costs[x]);
                    *path = step_path::<FULL>(*path, costs, p1, broadcast(p2_along[x]));
                    store(&mut from_left[x], *path);
                    let above = load(&from_above[x]);
                    let down = step_path::<FULL>(above, costs, p1, broadcast(p2_down[x]));
                    store(&mut from_above[x], down);
                }
                let ends = [count - 1 - x, half - 1 - x];
                for ((path, p2), x) in paths[2..].iter_mut().zip(&mut p2_right).zip(ends) {
                    *path = step_path::<FULL>(*path, load(&costs[x]), p1, broadcast(*p2));
                    store(&mut from_right[x], *path);
                    *p2 = p2_along[x];
                }
            }
            let [mut left, _, mut right, _] = paths;
            if half < second_start {
                let costs = load(&costs[half]);
                left = step_path::<FULL>(left, costs, p1, broadcast(p2_along[half]));
                store(&mut from_left[half], left);
                right = step_path::<FULL>(right, costs, p1, broadcast(p2_right[0]));
                store(&mut from_right[half], right);
                let above = load(&from_above[half]);
                let down = step_path::<FULL>(above, costs, p1, broadcast(p2_down[half]));
                store(&mut from_above[half], down);
            }
            // Continue each path from its end of the line into the other half. As soon as it equals
            // the path that was begun in the middle, the rest is equal too: after about ten pixels
            // of real lines.
            for x in second_start..count {
                left = step_path::<FULL>(left, load(&costs[x]), p1, broadcast(p2_along[x]));
                if are_equal(left, load(&from_left[x])) {
                    break;
                }
                store(&mut from_left[x], left);
            }
            for x in (0..half).rev() {
                let p2 = broadcast(p2_along[x + 1]);
                right = step_path::<FULL>(right, load(&costs[x]), p1, p2);
                if are_equal(right, load(&from_right[x])) {
                    break;
                }
                store(&mut from_right[x], right);
            }

            let blocks = (from_left.chunks(BLOCK))
                .zip(from_right.chunks(BLOCK))
                .zip(from_above.chunks(BLOCK));
            let outputs = row
                .best
                .chunks_mut(BLOCK)
                .zip(row.refined_index_q4.chunks_mut(BLOCK))
                .zip(row.margins.chunks_mut(BLOCK));
            let disparities = row.disparities.clamp(1, STRIDE);
            let tails = load_keys(&key_tails(disparities));
            // Best matches of the other view's pixels that the current pixel's disparities reach.
            // For the next pixel, each is one disparity further up.
            let mut others = load_keys(&[NO_KEY; MAX_STRIDE]);
            let mut others_end = count + disparities - 1;
            let last_place = place(disparities - 1);
            let mut selected = SelectedBlock::NONE;
            for (((from_left, from_right), from_above), outputs) in blocks.zip(outputs) {
                let pixels = from_left.iter().zip(from_right).zip(from_above);
                for (lane, ((from_left, from_right), from_above)) in pixels.enumerate().take(BLOCK)
                {
                    let keys = join([load(from_left), load(from_right), load(from_above)], tails);
                    others = lesser(advance(others), keys);
                    // No later pixel reaches the position of this pixel's highest disparity.
                    selected.others[BLOCK - 1 - lane] = key_in(others, last_place);
                    selected.least[lane] = least_key(keys);
                    selected.keys[lane].0 = words(keys);
                }
                // In loops of their own, in which no pixel depends on another.
                selected.remove_best();
                for (second, keys) in selected.second.iter_mut().zip(&selected.keys) {
                    *second = least_key(load_keys(&keys.0));
                }
                let ((best, refined_index_q4), margins) = outputs;
                selected.write(disparities, &row.subpixel, best, refined_index_q4, margins);
                let others_start = others_end - best.len();
                let decided = &selected.others[BLOCK - best.len()..];
                if let Some(other_best) = row.other_best.get_mut(others_start..others_end) {
                    for (other, &key) in other_best.iter_mut().zip(decided) {
                        *other = other_of(key);
                    }
                }
                others_end = others_start;
            }
            let others = words(others);
            for (index, other) in row.other_best.iter_mut().take(disparities).enumerate() {
                *other = other_of(key_at(&others, index));
            }
            FROM_LEFT.set(scratch);
        }

        #[target_feature(enable = $features)]
        #[inline]
        fn load_keys(words: &[u16; MAX_STRIDE]) -> Keys {
            const { assert!(size_of::<Keys>() == size_of::<[u16; MAX_STRIDE]>()) };
            // SAFETY: both have the same size, and any bits are keys.
            unsafe { words.as_ptr().cast::<Keys>().read_unaligned() }
        }

        #[target_feature(enable = $features)]
        #[inline]
        fn words(keys: Keys) -> [u16; MAX_STRIDE] {
            const { assert!(size_of::<Keys>() == size_of::<[u16; MAX_STRIDE]>()) };
            // SAFETY: both have the same size, and any bits are words.
            unsafe { (&raw const keys).cast::<[u16; MAX_STRIDE]>().read() }
        }
    };
}
pub(super) use aggregate_in_registers;
