//! Aggregation of up to 64 disparities in vector registers: the path costs of a pixel stay
//! in registers from pixel to pixel.
//!
//! The loops are the same for every instruction set; [`aggregate_in_registers`] puts them
//! beside the registers' own operations.

use vgstereo_core::aggregation::parabola_q4;
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
const fn place(index: usize) -> usize {
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

/// [`NO_KEY`] for a disparity and its neighbours, 0 for the others.
#[inline]
pub fn around(index: usize) -> &'static [u16; MAX_STRIDE] {
    static AROUND: [[u16; MAX_STRIDE]; MAX_STRIDE] = {
        let mut around = [[0; MAX_STRIDE]; MAX_STRIDE];
        let mut index = 0;
        while index < MAX_STRIDE {
            around[index][place(index)] = NO_KEY;
            if index > 0 {
                around[index][place(index - 1)] = NO_KEY;
                around[index - 1][place(index)] = NO_KEY;
            }
            index += 1;
        }
        around
    };
    &AROUND[index % MAX_STRIDE]
}

/// The key of a disparity, counted round from the last to the first.
#[inline]
pub fn key_at(keys: &[u16; MAX_STRIDE], index: usize) -> u16 {
    keys[place(index)]
}

/// A key as core's `AggregateRow::other_best` has it.
#[inline]
pub fn other_of(key: u16) -> u32 {
    match key {
        NO_KEY => u32::MAX,
        key => (u32::from(key >> INDEX_BITS) << 16) | (u32::from(key) % MAX_STRIDE as u32),
    }
}

/// What is known of the pixels of a block before it is written, side by side: the loops
/// over them become vector code.
#[derive(Debug, Default)]
pub struct SelectedBlock {
    /// Keys of the best and of the best without it and its neighbours.
    pub least: [u16; BLOCK],
    pub second: [u16; BLOCK],
    /// Keys beside the best; anything at the ends of the range.
    pub before: [u16; BLOCK],
    pub after: [u16; BLOCK],
    /// Keys of the other view's pixels that are decided.
    pub others: [u16; BLOCK],
}

impl SelectedBlock {
    /// Inlined so that it is compiled for the caller's instruction set.
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
        let mut refined = [0; BLOCK];
        let mut margin = [0; BLOCK];
        for lane in 0..BLOCK {
            let (least, second) = (self.least[lane], self.second[lane]);
            let index = least % MAX_STRIDE as u16;
            let sum = sum_of(least);
            let is_inside = (index > 0) & (index < last);
            let side = |side| if is_inside { sum_of(side) - sum } else { 0 };
            let step_q4 = parabola_q4(side(self.before[lane]), side(self.after[lane]));
            indices[lane] = index;
            refined[lane] = index.cast_signed() * STEPS_PER_PX + step_q4;
            let second = match second {
                NO_KEY => NO_DISTANCE,
                key => sum_of(key),
            };
            margin[lane] = second - sum;
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

/// Defines `aggregate_row`, the same as core's and that itself for more disparities.
///
/// A macro because a function cannot be compiled for the instruction set of its caller. It
/// takes from where it stands:
///
/// - `Costs`, the bytes of [`MAX_STRIDE`] disparities, with `broadcast`, `load` (255 after
///   the last), `store` (of as many as there is room for) and `step_path`;
/// - `Keys`, as many words in the order of [`place`], with `join` (the sums of three paths
///   with the tails of keys), `lesser`, `either` (of the bits), `least_key`, and `advance`,
///   which moves all to the next disparity.
macro_rules! aggregate_in_registers {
    ($features:literal) => {
        #[target_feature(enable = $features)]
        pub fn aggregate_row(row: &mut AggregateRow<'_>) {
            if row.stride > MAX_STRIDE {
                aggregation::aggregate_row(row);
            } else {
                aggregate_registers(row);
            }
        }

        /// The same for strides of at most [`MAX_STRIDE`].
        #[target_feature(enable = $features)]
        fn aggregate_registers(row: &mut AggregateRow<'_>) {
            let (stride, count) = (row.stride.min(MAX_STRIDE), row.best.len());
            row.other_best.fill(u32::MAX);
            if stride == 0 || count == 0 {
                return;
            }
            let p1 = broadcast(row.p1);

            // From the right, over the penalties between a pixel and the one on its right.
            // Each of these waits for the one before; the path down, which does not, fills
            // the time.
            let pixels = row
                .costs
                .chunks_exact(stride)
                .zip(row.from_right.chunks_exact_mut(stride))
                .zip(row.from_above.chunks_exact_mut(stride));
            let penalties = std::iter::once(&0).chain(row.p2_along.iter().skip(1).rev());
            let penalties = penalties.zip(row.p2_down.iter().rev());
            let mut path = broadcast(0);
            for (index, (((costs, from_right), from_above), (&p2_along, &p2_down))) in
                pixels.rev().zip(penalties).enumerate()
            {
                let costs = load(costs);
                path = if index == 0 {
                    costs
                } else {
                    step_path(path, costs, p1, broadcast(p2_along))
                };
                store(from_right, path);
                let down = if row.is_first {
                    costs
                } else {
                    step_path(load(from_above), costs, p1, broadcast(p2_down))
                };
                store(from_above, down);
            }

            // From the left; all three are there, so each pixel is decided at once.
            let blocks = row
                .costs
                .chunks(stride * BLOCK)
                .zip(row.from_right.chunks(stride * BLOCK))
                .zip(row.from_above.chunks(stride * BLOCK))
                .zip(row.p2_along.chunks(BLOCK));
            let outputs = row
                .best
                .chunks_mut(BLOCK)
                .zip(row.refined_q4.chunks_mut(BLOCK))
                .zip(row.margins.chunks_mut(BLOCK));
            let disparities = row.disparities.clamp(1, stride);
            let tails = load_keys(&key_tails(disparities));
            // The best matches of the other view's pixels that this pixel's disparities
            // reach: of the next pixel they are one further on.
            let mut others = load_keys(&[NO_KEY; MAX_STRIDE]);
            let mut others_end = count + disparities - 1;
            let mut selected = SelectedBlock::default();
            for (block, ((((costs, from_right), from_above), p2_along), outputs)) in
                blocks.zip(outputs).enumerate()
            {
                let pixels = costs
                    .chunks_exact(stride)
                    .zip(from_right.chunks_exact(stride))
                    .zip(from_above.chunks_exact(stride))
                    .zip(p2_along);
                for (lane, (((costs, from_right), from_above), &p2)) in
                    pixels.enumerate().take(BLOCK)
                {
                    let costs = load(costs);
                    path = if block == 0 && lane == 0 {
                        costs
                    } else {
                        step_path(path, costs, p1, broadcast(p2))
                    };
                    let keys = join([path, load(from_right), load(from_above)], tails);
                    others = lesser(advance(others), keys);
                    // No later pixel reaches the last.
                    selected.others[lane] = key_at(&words(others), disparities - 1);
                    let least = least_key(keys);
                    let index = usize::from(least) % MAX_STRIDE;
                    selected.least[lane] = least;
                    selected.second[lane] = least_key(either(keys, load_keys(around(index))));
                    let keys = words(keys);
                    selected.before[lane] = key_at(&keys, index + MAX_STRIDE - 1);
                    selected.after[lane] = key_at(&keys, index + 1);
                }
                let ((best, refined_q4), margins) = outputs;
                selected.write(disparities, best, refined_q4, margins);
                let others_start = others_end - best.len();
                if let Some(other_best) = row.other_best.get_mut(others_start..others_end) {
                    for (other, &key) in other_best.iter_mut().rev().zip(&selected.others) {
                        *other = other_of(key);
                    }
                }
                others_end = others_start;
            }
            let others = words(others);
            for (index, other) in row.other_best.iter_mut().take(disparities).enumerate() {
                *other = other_of(key_at(&others, index));
            }
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
