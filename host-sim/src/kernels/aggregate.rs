//! Aggregation of up to 64 disparities in vector registers: the path costs of a pixel stay
//! in registers from pixel to pixel.
//!
//! The loops are the same for every instruction set; [`aggregate_in_registers`] puts them
//! beside the registers' own operations.

use std::cell::Cell;

use vgstereo_core::aggregation::parabolas_q4;
use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::matching::NO_DISTANCE;

/// Most disparities, rounded up, that the registers hold.
pub const MAX_STRIDE: usize = 64;

/// Pixels whose disparities are written together.
pub const BLOCK: usize = 32;

/// Key of no match: above those of all sums.
pub const NO_KEY: u16 = u16::MAX;

/// A key is a sum, at most 3 times 255, and 6 bits of index below it: the least key is
/// the first of the least sums.
pub const INDEX_BITS: u32 = 6;

/// Where the key of a disparity stands: the odd ones after the even ones, as bytes become
/// words without a shuffle.
#[inline]
pub const fn place(index: usize) -> usize {
    let index = index % MAX_STRIDE;
    index / 2 + index % 2 * (MAX_STRIDE / 2)
}

/// What the lower bits of the keys are: their index, and [`NO_KEY`] beyond the range.
pub fn key_tails(disparities: usize) -> [u16; MAX_STRIDE] {
    let mut tails = [NO_KEY; MAX_STRIDE];
    for (index, tail) in (0..disparities.min(MAX_STRIDE)).zip(0..) {
        tails[place(index)] = tail;
    }
    tails
}

/// Where the keys of a disparity and its neighbours stand; of the first and the last its own
/// instead of one outside.
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

/// The key of a disparity.
#[inline]
pub fn key_at(keys: &[u16; MAX_STRIDE], index: usize) -> u16 {
    keys[place(index)]
}

/// A key as core's `AggregateRow::other_best` has it.
#[inline]
pub fn other_of(key: u16) -> u32 {
    let all_ones = u32::from(key == NO_KEY).wrapping_neg();
    all_ones | (u32::from(key >> INDEX_BITS) << 16) | (u32::from(key) % MAX_STRIDE as u32)
}

/// The keys of a pixel, in the order of [`place`]. No load of them straddles two cache lines.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct PixelKeys(pub [u16; MAX_STRIDE]);

/// What is known of the pixels of a block before it is written, side by side: the loops
/// over them become vector code.
#[derive(Debug)]
pub struct SelectedBlock {
    /// Keys of each pixel's disparities, until [`SelectedBlock::remove_best`].
    pub keys: [PixelKeys; BLOCK],
    /// Keys of the best and of the best without it and its neighbours.
    pub least: [u16; BLOCK],
    pub second: [u16; BLOCK],
    /// Keys beside the best; anything at the ends of the range.
    before: [u16; BLOCK],
    after: [u16; BLOCK],
    /// Keys of the other view's pixels that are decided, the last one first.
    pub others: [u16; BLOCK],
}

impl SelectedBlock {
    pub const NONE: Self = Self {
        keys: [PixelKeys([NO_KEY; MAX_STRIDE]); BLOCK],
        least: [NO_KEY; BLOCK],
        second: [NO_KEY; BLOCK],
        before: [NO_KEY; BLOCK],
        after: [NO_KEY; BLOCK],
        others: [NO_KEY; BLOCK],
    };

    /// Takes the best and its neighbours out of the keys, for the second best.
    #[inline(always)]
    pub fn remove_best(&mut self) {
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

    /// Writes the first pixels, as many as there are. Inlined so that it is compiled for the
    /// caller's instruction set.
    #[inline(always)]
    pub fn write(
        &self,
        disparities: usize,
        best: &mut [u16],
        refined_q4: &mut [i16],
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
            // All ones where there is a disparity on either side.
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
        let mut refined = parabolas_q4(&before, &after);
        for (refined, &index) in refined.iter_mut().zip(&indices) {
            *refined += index.cast_signed() * STEPS_PER_PX;
        }
        let count = best.len();
        best.copy_from_slice(&indices[..count]);
        refined_q4.copy_from_slice(&refined[..count]);
        margins.copy_from_slice(&margin[..count]);
    }
}

/// The sum of a key.
#[inline(always)]
fn sum_of(key: u16) -> i16 {
    (key >> INDEX_BITS).cast_signed()
}

thread_local! {
    /// Scratch of a thread: path costs from the left, of a row of pixels.
    pub static FROM_LEFT: Cell<Vec<u8>> = const { Cell::new(Vec::new()) };
}

/// Defines `aggregate_row`, the same as core's and that itself for more disparities.
///
/// A macro because a function cannot be compiled for the instruction set of its caller. It
/// takes from where it stands:
///
/// - `Costs`, the bytes of [`MAX_STRIDE`] disparities, with `broadcast`, `load` (255 after
///   the last), `store` (of as many as there is room for), `are_equal` and `step_path`, which
///   may take it that no disparity is in the last place unless it is told `FULL`;
/// - `Keys`, as many words in the order of [`place`], with `join` (the sums of three paths
///   with the tails of keys), `lesser`, `least_key`, `key_in` (a place), and `advance`,
///   which moves all to the next disparity.
macro_rules! aggregate_in_registers {
    ($features:literal) => {
        #[target_feature(enable = $features)]
        pub fn aggregate_row(row: &mut AggregateRow<'_>) {
            match row.stride {
                16 => aggregate_registers::<16, false>(row),
                32 => aggregate_registers::<32, false>(row),
                48 => aggregate_registers::<48, false>(row),
                64 if row.disparities < 64 => aggregate_registers::<64, false>(row),
                64 => aggregate_registers::<64, true>(row),
                _ => aggregation::aggregate_row(row),
            }
        }

        /// The same for a stride of at most [`MAX_STRIDE`] that the compiler knows.
        #[target_feature(enable = $features)]
        fn aggregate_registers<const STRIDE: usize, const FULL: bool>(row: &mut AggregateRow<'_>) {
            let count = row.best.len();
            row.other_best.fill(u32::MAX);
            if count == 0 {
                return;
            }
            let p1 = broadcast(row.p1);
            // Where all costs of a path are the same, the step from it costs nothing: what a
            // path begins with.
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

            // Along a path each pixel waits for the one before. Four paths and those down,
            // which do not wait, fill each other's time: from both ends, and both ways from
            // the middle as if the line began there.
            let half = count / 2;
            let second_start = count - half;
            let mut paths = [beginning; 4];
            // Between a pixel and the one on its right.
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
            // Where a path from the end comes to what the one from the middle found, the rest
            // is the same: after about ten pixels of real lines, at the latest at their end.
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
                .zip(row.refined_q4.chunks_mut(BLOCK))
                .zip(row.margins.chunks_mut(BLOCK));
            let disparities = row.disparities.clamp(1, STRIDE);
            let tails = load_keys(&key_tails(disparities));
            // The best matches of the other view's pixels that this pixel's disparities
            // reach: of the next pixel they are one further on.
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
                    // No later pixel reaches the last.
                    selected.others[BLOCK - 1 - lane] = key_in(others, last_place);
                    selected.least[lane] = least_key(keys);
                    selected.keys[lane].0 = words(keys);
                }
                // In loops of their own, where no pixel waits for another.
                selected.remove_best();
                for (second, keys) in selected.second.iter_mut().zip(&selected.keys) {
                    *second = least_key(load_keys(&keys.0));
                }
                let ((best, refined_q4), margins) = outputs;
                selected.write(disparities, best, refined_q4, margins);
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
