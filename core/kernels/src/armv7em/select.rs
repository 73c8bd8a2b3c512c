//! Winner-take-all selection from up to 64 disparities, two keys to a register.
//!
//! A key of 16 bits holds the sum of three path costs above the index of the disparity, so that the
//! least key belongs to the first of the least sums. Even and odd disparities have separate
//! registers of keys, because that is how bytes widen to halfwords. The least key of each pair of
//! neighbouring disparities is kept for finding the second best.

use bytemuck::{must_cast_slice, must_cast_slice_mut, try_cast_slice};
use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::kernel::{AggregateRow, SubpixelStep};

use super::aggregate::MAX_STRIDE;
use super::others;
use super::simd::{afresh, in_order, meet_all, min_u16x2, opaque};

/// Bits of the index, which is below the sum in a key. A sum is at most 3 * 255.
pub(crate) const INDEX_BITS: u32 = 6;
pub(crate) const INDEX_MASK: u32 = (1 << INDEX_BITS) - 1;

/// Smallest number of disparities: of as many, there is always a second best.
pub(crate) const DISPARITIES_MIN: usize = 4;

/// Least key of each pair of disparities, with a guard at either end.
type Minima = [Pair; MAX_STRIDE / 8 + 2];

/// Equals [`select_row`](vgstereo_core::kernel::select_row) bit for bit.
pub(super) fn select_row(row: &mut AggregateRow<'_>) {
    // One more than the positions of the other view that all pixels' disparities reach.
    let slots = row.best.len() + row.disparities;
    let is_whole = (DISPARITIES_MIN..=row.stride).contains(&row.disparities)
        && row.other_best.len() + 1 >= slots;
    let selected = match row.stride {
        16 if is_whole => select_pixels::<2>(row),
        32 if is_whole => select_pixels::<4>(row),
        48 if is_whole => select_pixels::<6>(row),
        MAX_STRIDE if is_whole => select_pixels::<8>(row),
        _ => None,
    };
    if selected.is_none() {
        others::select_row(row);
    }
}

/// Selects from the sums of path costs of `8 * PAIRS` disparities; returns `None` if the rows are
/// not aligned to words.
#[inline(never)]
fn select_pixels<const PAIRS: usize>(row: &mut AggregateRow<'_>) -> Option<()> {
    let paths = [&*row.costs, &*row.from_right, &*row.from_above];
    let [Some(from_left), Some(from_right), Some(from_above)] = paths.map(pixels::<PAIRS>) else {
        return None;
    };
    let paths = from_left
        .chunks(Others::MOVES)
        .zip(from_right.chunks(Others::MOVES))
        .zip(from_above.chunks(Others::MOVES));
    let disparities = row.disparities;
    let subpixel = Subpixel::new(&row.subpixel);
    let end = (row.best.len() + disparities).saturating_sub(1);
    let (inside, beyond) = row.other_best.split_at_mut(end.min(row.other_best.len()));
    beyond.fill(u32::MAX);
    // Positions still open after the last pixel: those of its disparities below the highest.
    let open = disparities.saturating_sub(1).min(inside.len());
    let (open, done) = inside.split_at_mut(open);
    let mut window = [0; _];
    let mut others = Others::new(&mut window);
    let mut minima = [[u32::MAX; 2]; _];
    let outputs = row.best.chunks_mut(Others::MOVES);
    let outputs = outputs.zip(row.refined_index_q4.chunks_mut(Others::MOVES));
    let outputs = outputs.zip(row.margins.chunks_mut(Others::MOVES));
    let outputs = outputs.zip(done.rchunks_mut(Others::MOVES));
    for (((from_left, from_right), from_above), (((best, refined_index_q4), margins), done)) in
        paths.zip(outputs)
    {
        others.rewind();
        let paths = from_left.iter().zip(from_right).zip(from_above);
        let outputs = best.iter_mut().zip(refined_index_q4).zip(margins);
        for (((from_left, from_right), from_above), ((best, refined_index_q4), margin)) in
            paths.zip(outputs)
        {
            let paths = [from_left, from_right, from_above].map(afresh);
            let key = in_order(others.meet(paths, &mut minima));
            let selected = select(key, paths, &mut minima, disparities, &subpixel);
            *best = selected.index;
            *refined_index_q4 = selected.refined_index_q4;
            *margin = selected.margin;
        }
        // No later pixel reaches the position of a pixel's highest disparity.
        others.write(open.len(), done);
    }
    others.write(0, open);
    Some(())
}

/// Path costs of eight disparities.
type Pair = [u32; 2];

fn pixels<const PAIRS: usize>(row: &[u8]) -> Option<&[[Pair; PAIRS]]> {
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
    /// Number of pixels after which the window is at its end, and must be rewound.
    const MOVES: usize = PLANE - MAX_STRIDE;

    /// Returns the state before the first pixel, one position above it, and at the end of the window.
    fn new(keys: &'a mut Window) -> Self {
        *keys = [u8::MAX; _];
        Self {
            keys,
            even: PLANE,
            odd: 2,
        }
    }

    /// Moves the open positions from the end of the window to its beginning.
    #[inline(never)]
    fn rewind(&mut self) {
        for plane in self.keys.as_chunks_mut::<PLANE>().0 {
            let (low, high) = plane.split_at_mut(MAX_STRIDE);
            high.copy_from_slice(low);
            low.fill(u8::MAX);
        }
        self.even = (self.even + MAX_STRIDE) % (2 * PLANE);
        self.odd = (self.odd + MAX_STRIDE) % (2 * PLANE);
    }

    /// Adds the path costs of the next pixel. Returns its least key in the low half, and writes the least key of
    /// each pair of neighbouring disparities to `minima`.
    #[inline(always)]
    fn meet<const PAIRS: usize>(&mut self, paths: [&[Pair; PAIRS]; 3], minima: &mut Minima) -> u32 {
        // A position at an even disparity of one pixel is at the next higher, odd, disparity of the
        // next.
        (self.even, self.odd) = (
            (self.odd.wrapping_sub(2)) % (2 * PLANE),
            self.even % (2 * PLANE),
        );
        let best = pairs::meet(paths, self.keys, [self.even, self.odd], minima);
        min_u16x2(best, best >> 16)
    }

    /// Place of the key of the position that the pixel reaches at `disparity`.
    fn place(&self, disparity: usize) -> usize {
        let start = if disparity.is_multiple_of(2) {
            self.even
        } else {
            self.odd
        };
        start + disparity / 2 * 2
    }

    /// Writes the best matches of the positions that the pixel reaches from `disparity` on, as
    /// [`AggregateRow::other_best`].
    fn write(&self, disparity: usize, best: &mut [u32]) {
        let runs = [disparity, disparity + 1].map(|disparity| {
            let keys = self.keys.get(self.place(disparity)..);
            keys.unwrap_or_default().as_chunks().0
        });
        let (pairs, rest) = best.as_chunks_mut();
        for (([a, b], &first), &second) in pairs.iter_mut().zip(runs[0]).zip(runs[1]) {
            [*a, *b] = [first, second].map(best_of);
        }
        for (other, &key) in rest.iter_mut().zip(runs[0].iter().skip(pairs.len())) {
            *other = best_of(key);
        }
    }
}

/// The best match with this key, as `sum << 16 | index`.
#[inline(always)]
fn best_of(key: [u8; 2]) -> u32 {
    let key = u32::from(u16::from_le_bytes(key));
    opaque(key >> INDEX_BITS) << 16 | key & INDEX_MASK
}

/// The keys of a pixel as instructions, of eight disparities at a time.
#[cfg(dsp_extension)]
#[allow(unsafe_code)]
mod pairs {
    use core::arch::asm;

    use super::{INDEX_BITS, Minima, PLANE, Pair, Window};
    use crate::armv7em::simd::{in_order, min_u16x2};

    /// Meets the keys of a pixel with those of the window, whose runs for even and for odd disparities begin at these
    /// bytes, and writes the lesser key of each pair of neighbouring disparities. Returns the least of either half.
    #[inline(always)]
    pub(super) fn meet<const PAIRS: usize>(
        [left, right, above]: [&[Pair; PAIRS]; 3],
        window: &mut Window,
        runs: [usize; 2],
        minima: &mut Minima,
    ) -> u32 {
        let window = window.as_mut_ptr();
        // SAFETY: a run is at most the bytes that the window has beyond its planes.
        let [even, odd] = runs.map(|run| unsafe { window.add(run % (2 * PLANE)) });
        // Of disparities 0 and 2.
        let mut indices = 2_u32 << 16;
        let mut best = u32::MAX;
        macro_rules! pairs {
            ($($index:literal)+) => {
                $(if $index < PAIRS {
                    let (low, high);
                    // SAFETY: the addresses are within the paths and the runs of the window.
                    unsafe {
                        asm!(
                            "ldrd {a}, {b}, [{left}, #8 * {index}]",
                            "uxtb16 {c}, {a}, ror #8",
                            "uxtb16 {d}, {b}, ror #8",
                            "uxtb16 {a}, {a}",
                            "uxtb16 {b}, {b}",
                            "ldrd {e}, {f}, [{right}, #8 * {index}]",
                            "uxtab16 {c}, {c}, {e}, ror #8",
                            "uxtab16 {d}, {d}, {f}, ror #8",
                            "uxtab16 {a}, {a}, {e}",
                            "uxtab16 {b}, {b}, {f}",
                            "ldrd {e}, {f}, [{above}, #8 * {index}]",
                            "uxtab16 {c}, {c}, {e}, ror #8",
                            "uxtab16 {d}, {d}, {f}, ror #8",
                            "uxtab16 {a}, {a}, {e}",
                            "uxtab16 {b}, {b}, {f}",
                            // Of disparities 0, 1, 4 and 5, and those two after them.
                            "add {a}, {indices}, {a}, lsl #{bits}",
                            "add {indices}, {indices}, #0x00010001",
                            "add {c}, {indices}, {c}, lsl #{bits}",
                            "add {indices}, {indices}, #0x00030003",
                            "add {b}, {indices}, {b}, lsl #{bits}",
                            "add {indices}, {indices}, #0x00010001",
                            "add {d}, {indices}, {d}, lsl #{bits}",
                            "add {indices}, {indices}, #0x00030003",
                            "ldr {e}, [{even}, #8 * {index}]",
                            "uqsub16 {f}, {e}, {a}",
                            "subs {e}, {e}, {f}",
                            "str {e}, [{even}, #8 * {index}]",
                            "ldr {e}, [{even}, #8 * {index} + 4]",
                            "uqsub16 {f}, {e}, {b}",
                            "subs {e}, {e}, {f}",
                            "str {e}, [{even}, #8 * {index} + 4]",
                            "ldr {e}, [{odd}, #8 * {index}]",
                            "uqsub16 {f}, {e}, {c}",
                            "subs {e}, {e}, {f}",
                            "str {e}, [{odd}, #8 * {index}]",
                            "ldr {e}, [{odd}, #8 * {index} + 4]",
                            "uqsub16 {f}, {e}, {d}",
                            "subs {e}, {e}, {f}",
                            "str {e}, [{odd}, #8 * {index} + 4]",
                            "uqsub16 {e}, {a}, {c}",
                            "subs {a}, {a}, {e}",
                            "uqsub16 {e}, {b}, {d}",
                            "subs {b}, {b}, {e}",
                            a = out(reg) low, b = out(reg) high, c = out(reg) _, d = out(reg) _,
                            e = out(reg) _, f = out(reg) _, left = in(reg) left, right = in(reg) right,
                            above = in(reg) above, even = in(reg) even, odd = in(reg) odd,
                            indices = inout(reg) indices, index = const $index, bits = const INDEX_BITS,
                            options(nostack),
                        );
                    }
                    if let Some(minima) = minima.get_mut($index + 1) {
                        *minima = [low, high];
                    }
                    let least = if $index == 0 { low } else { min_u16x2(best, low) };
                    best = in_order(min_u16x2(least, high));
                })+
            };
        }
        pairs!(0 1 2 3 4 5 6 7);
        let _ = indices;
        best
    }
}

/// The same in plain code, to which the assembly is held.
#[cfg(not(dsp_extension))]
mod pairs {
    use core::array::from_fn;

    use super::{INDEX_BITS, Minima, Pair, Window};
    use crate::armv7em::simd::{even_bytes, load, min_u16x2, odd_bytes, splat_u16, store};

    pub(super) fn meet<const PAIRS: usize>(
        paths: [&[Pair; PAIRS]; 3],
        window: &mut Window,
        runs: [usize; 2],
        minima: &mut Minima,
    ) -> u32 {
        let mut best = u32::MAX;
        for pair in 0..PAIRS {
            for word in 0..2 {
                let costs = paths.map(|path| path[pair][word]);
                let first = 8 * pair + 4 * word;
                let keys: [u32; 2] = from_fn(|parity| {
                    let widened = [even_bytes, odd_bytes][parity];
                    let sums: u32 = costs.map(widened).iter().sum();
                    (sums << INDEX_BITS) + splat_u16((first + parity) as u16) + (2 << 16)
                });
                for (run, keys) in runs.into_iter().zip(keys) {
                    let others = window.get_mut(run + first..);
                    if let Some(others) = others.and_then(<[u8]>::first_chunk_mut) {
                        store(min_u16x2(load(others), keys), others);
                    }
                }
                let least = min_u16x2(keys[0], keys[1]);
                minima[pair + 1][word] = least;
                best = min_u16x2(best, least);
            }
        }
        best
    }
}

/// Result of the selection for one pixel, as in [`AggregateRow`].
struct Selected {
    index: u16,
    refined_index_q4: i16,
    margin: i16,
}

/// Returns the best disparity, whose key is in the low half of `key`, refined by the sums of its neighbours, and
/// its margin over the second best.
#[inline(always)]
fn select<const PAIRS: usize>(
    key: u32,
    paths: [&[Pair; PAIRS]; 3],
    minima: &mut Minima,
    disparities: usize,
    subpixel: &Subpixel,
) -> Selected {
    let index = key & INDEX_MASK;
    let least = sum_of(key);
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
    // The best disparity and its neighbours are in two pairs; the fourth disparity in these pairs
    // is two before an even best disparity and two after an odd one. It is compared by itself.
    let outer = (index + 4 * (index % 2)).wrapping_sub(2);
    let keys: &mut [u16] = must_cast_slice_mut(minima.as_mut_slice());
    for disparity in [index, outer] {
        if let Some(key) = keys.get_mut((disparity.wrapping_add(8) / 2) as usize) {
            *key = u16::MAX;
        }
    }
    let [_, minima @ ..] = minima;
    let second = least_of(minima.get(..PAIRS).unwrap_or_default().as_flattened());
    let mut second = sum_of(second);
    if outer < disparities as u32 && outer < 8 * PAIRS as u32 {
        second = second.min(sums(outer, 1)(0));
    }
    let margin = in_order(second - least);
    let before = index.wrapping_sub(1);
    let step_q4 = if before < disparities as u32 - 2 && before < 8 * PAIRS as u32 - 2 {
        let sum = sums(before, 3);
        subpixel.step_q4(sum(0) - least, sum(2) - least)
    } else {
        0
    };
    Selected {
        index: index as u16,
        refined_index_q4: (index as i32 * i32::from(STEPS_PER_PX) + step_q4) as i16,
        margin: margin as i16,
    }
}

/// The sum in the key in the low half of a word.
#[inline(always)]
const fn sum_of(key: u32) -> u32 {
    (key & 0xffff) >> INDEX_BITS
}

/// The least of the keys in these words, in the low half.
#[inline(always)]
fn least_of(words: &[u32]) -> u32 {
    let least = meet_all(words, min_u16x2);
    min_u16x2(least, least >> 16)
}

/// Bits by which the operands of the division, of 15 bits, are moved up where that saves time: the divider of CV32E40P takes
/// a cycle for each leading zero of the divisor.
const DIVISION_SHIFT: u32 = if cfg!(xpulp) { 17 } else { 0 };

/// How the sub-pixel step follows from the sums, as in [`SubpixelStep`].
pub(crate) struct Subpixel {
    relief: u32,
    lines_min: u32,
}

impl Subpixel {
    pub(crate) fn new(step: &SubpixelStep) -> Self {
        Self {
            relief: step.relief.into(),
            lines_min: step.lines_min.into(),
        }
    }

    /// Equals [`subpixel_step_q4`](vgstereo_core::kernel::subpixel_step_q4) bit for bit. A processor that divides in
    /// hardware takes less time for one division than for the steps that replace it there.
    #[inline(always)]
    pub(crate) fn step_q4(&self, before: u32, after: u32) -> i32 {
        let (larger, smaller) = if cfg!(dsp_extension) {
            let excess = before.saturating_sub(after);
            (after + excess, before - excess)
        } else {
            (before.max(after), before.min(after))
        };
        let relief = self.relief.min((5 * larger) >> 4);
        let relieved = (larger - relief, smaller.saturating_sub(relief));
        let is_weak = larger < self.lines_min;
        let divisor = relieved.0 + if is_weak { relieved.1 } else { 0 };
        let difference = relieved.0 - relieved.1;
        let dividend = 16 * difference + divisor;
        let steps = (dividend << DIVISION_SHIFT).checked_div((2 * divisor) << DIVISION_SHIFT);
        let steps = steps.unwrap_or(0) as i32;
        if before >= after { steps } else { -steps }
    }
}
