//! Winner-take-all selection from up to 64 disparities, eight keys to a register.
//!
//! A key of 16 bits holds the sum of three path costs above the index of the disparity, so that the
//! least key belongs to the first of the least sums. The keys of the other view's positions stand in the
//! upper half of where its best matches will, which take twice as much.

use bytemuck::{must_cast_slice, must_cast_slice_mut};
use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::kernel::{AggregateRow, Kernels, Portable, SubpixelStep};

use super::{LANES, vector_asm};

/// Largest number of disparities, rounded up to a multiple of 16.
const MAX_STRIDE: usize = 64;

/// Smallest number of disparities: of as many, there is always a second best.
const DISPARITIES_MIN: usize = 4;

/// Bits of the index, which is below the sum in a key. A sum is at most 3 * 255, so that no key is
/// [`NO_KEY`].
const INDEX_BITS: u32 = 6;
const NO_KEY: u16 = u16::MAX;

/// Keys of 16 bits in a vector.
const KEYS: usize = LANES / 2;

/// The indices that keys hold.
static INDICES: [u16; MAX_STRIDE] = {
    let mut indices = [0; MAX_STRIDE];
    let mut index = 0;
    while index < MAX_STRIDE {
        indices[index] = index as u16;
        index += 1;
    }
    indices
};

/// Keys of a pixel, with one before them and one after them.
type Keys = [u16; MAX_STRIDE + 2];

/// Equals [`vgstereo_core::kernel::select_row`] bit for bit.
pub(super) fn select_row(row: &mut AggregateRow<'_>) {
    let (stride, pixels) = (row.stride, row.best.len());
    let is_whole = (LANES..=MAX_STRIDE).contains(&stride)
        && stride.is_multiple_of(LANES)
        && (DISPARITIES_MIN..=stride).contains(&row.disparities)
        && pixels > 0
        && [&*row.costs, &*row.from_right, &*row.from_above]
            .iter()
            .all(|paths| paths.len() == pixels * stride)
        && row.refined_index_q4.len() == pixels
        && row.margins.len() == pixels
        && row.other_best.len() >= pixels + stride;
    if is_whole {
        select_pixels(row);
    } else {
        Portable.select_row(row);
    }
}

fn select_pixels(row: &mut AggregateRow<'_>) {
    let (stride, disparities) = (row.stride, row.disparities);
    let positions = row.other_best.len();
    let others: &mut [u16] = must_cast_slice_mut(row.other_best);
    let others = &mut others[positions..];
    others.fill(NO_KEY);
    let mut keys: Keys = [NO_KEY; _];
    let paths = row.costs.chunks_exact(stride);
    let paths = paths.zip(row.from_right.chunks_exact(stride));
    let paths = paths.zip(row.from_above.chunks_exact(stride));
    // From pixel to pixel, the position of the lowest disparity moves down by one.
    let positions = (0..row.best.len()).rev();
    let mut pixels = paths.zip(positions);
    let outputs = row.best.chunks_mut(KEYS);
    let outputs = outputs.zip(row.refined_index_q4.chunks_mut(KEYS));
    let outputs = outputs.zip(row.margins.chunks_mut(KEYS));
    for ((bests, refined_q4), margins) in outputs {
        // Rises of the neighbours of each best disparity; without two neighbours there is no step.
        let (mut before, mut after) = ([0; KEYS], [0; KEYS]);
        let rises = before.iter_mut().zip(&mut after);
        let outputs = bests.iter_mut().zip(&mut *margins).zip(rises);
        for (((best, margin), (before, after)), (((left, right), above), position)) in
            outputs.zip(&mut pixels)
        {
            let Some(others) = others.get_mut(position..position + stride) else {
                return;
            };
            let least = meet([left, right, above], others, &mut keys);
            let index = (least % MAX_STRIDE as u32) as usize;
            let least = (least >> INDEX_BITS) as i16;
            let around = keys
                .get_mut(index..)
                .and_then(<[u16]>::first_chunk_mut::<3>);
            let Some(around) = around else {
                return;
            };
            if index > 0 && index + 1 < disparities {
                *before = (around[0] >> INDEX_BITS) as i16 - least;
                *after = (around[2] >> INDEX_BITS) as i16 - least;
            }
            // The best and its neighbours are no second best.
            *around = [NO_KEY; 3];
            *best = index as u16;
            *margin = (least_of(&keys, stride) >> INDEX_BITS) as i16 - least;
        }
        let steps_q4 = steps_q4(&row.subpixel, &before, &after);
        for ((refined_q4, &best), step_q4) in refined_q4.iter_mut().zip(&*bests).zip(steps_q4) {
            *refined_q4 = best as i16 * STEPS_PER_PX + step_q4;
        }
    }
    spread(row.other_best, row.best.len() + disparities - 1);
}

/// Writes the keys of a pixel's disparities, from the sums of its path costs; replaces those of the other view's
/// positions that are larger; and returns the least key.
#[inline(always)]
fn meet(paths: [&[u8]; 3], others: &mut [u16], keys: &mut Keys) -> u32 {
    let length = others.len();
    debug_assert!(length.is_multiple_of(KEYS) && (KEYS..=MAX_STRIDE).contains(&length));
    debug_assert!(paths.iter().all(|path| path.len() == length));
    let mut least: u32 = NO_KEY.into();
    let [left, right, above] = paths.map(<[u8]>::as_ptr);
    // SAFETY: as asserted, the path costs, the others, the keys and the indices have as many whole vectors.
    unsafe {
        vector_asm!(
            "vmov.i8 q7, #255",
            "dls lr, {blocks}",
            "2:",
            "vldrb.u16 q0, [r0], #8",
            "vldrb.u16 q1, [r1], #8",
            "vldrb.u16 q2, [r2], #8",
            "vadd.i16 q0, q0, q1",
            "vldrh.u16 q3, [{indices}], #16",
            "vadd.i16 q0, q0, q2",
            "vldrh.u16 q4, [{others}]",
            "vsli.16 q3, q0, #6",
            "vmin.u16 q7, q7, q3",
            "vstrh.16 q3, [{keys}], #16",
            "vmin.u16 q4, q4, q3",
            "vstrh.16 q4, [{others}], #16",
            "le lr, 2b",
            "vminv.u16 {least}, q7";
            blocks = in(reg) length / KEYS,
            indices = inout(reg) INDICES.as_ptr() => _,
            others = inout(reg) others.as_mut_ptr() => _,
            keys = inout(reg) keys.as_mut_ptr().add(1) => _,
            least = inout(reg) least,
            // Loads that widen take these registers alone as addresses.
            inout("r0") left => _,
            inout("r1") right => _,
            inout("r2") above => _,
        );
    }
    least
}

/// Returns the least of the first `count` keys of a pixel.
#[inline(always)]
fn least_of(keys: &Keys, count: usize) -> u16 {
    debug_assert!(count.is_multiple_of(KEYS) && (KEYS..=MAX_STRIDE).contains(&count));
    let mut least: u32 = NO_KEY.into();
    // SAFETY: as asserted, the keys have as many whole vectors.
    unsafe {
        vector_asm!(
            "vmov.i8 q7, #255",
            "dls lr, {blocks}",
            "2:",
            "vldrh.u16 q0, [{keys}], #16",
            "vmin.u16 q7, q7, q0",
            "le lr, 2b",
            "vminv.u16 {least}, q7";
            blocks = in(reg) count / KEYS,
            keys = inout(reg) keys.as_ptr().add(1) => _,
            least = inout(reg) least,
        );
    }
    least as u16
}

/// Equals [`vgstereo_core::kernel::subpixel_steps_q4`] bit for bit.
#[inline(always)]
fn steps_q4(step: &SubpixelStep, before: &[i16; KEYS], after: &[i16; KEYS]) -> [i16; KEYS] {
    // The rounded quotient is the number of odd multiples of the divisor, up to 15 times it, that 16 times the
    // difference reaches.
    let mut steps_q4 = [0; KEYS];
    // SAFETY: the rises and the steps are one vector each.
    unsafe {
        vector_asm!(
            "vmrs {predicate}, p0",
            "vldrh.u16 q0, [{before}]",
            "vldrh.u16 q1, [{after}]",
            // q3 is the larger rise and q4 the smaller one; q7 the relief.
            "vmax.u16 q3, q0, q1",
            "vmin.u16 q4, q0, q1",
            "vdup.16 q6, {relief}",
            "vmul.i16 q7, q3, {five}",
            "vshr.u16 q7, q7, #4",
            "vmin.u16 q7, q7, q6",
            "vqsub.u16 q4, q4, q7",
            "vsub.i16 q6, q3, q7",
            // q5 is the divisor: the larger rise alone for lines.
            "vadd.i16 q5, q6, q4",
            "vpt.u16 cs, q3, {lines_min}",
            "vorrt q5, q6, q6",
            "vsub.i16 q6, q6, q4",
            "vshl.i16 q6, q6, #4",
            "vmov.i16 q2, #0",
            "vorr q7, q5, q5",
            "vorr q3, q5, q5",
            "vadd.i16 q5, q5, q5",
            "mov {five}, #1",
            "dls lr, {eight}",
            "2:",
            "vpt.u16 cs, q6, q7",
            "vaddt.i16 q2, q2, {five}",
            "vadd.i16 q7, q7, q5",
            "le lr, 2b",
            "vpt.i16 eq, q3, zr",
            "vmovt.i16 q2, #0",
            "vpt.s16 gt, q1, q0",
            "vnegt.s16 q2, q2",
            "vstrh.16 q2, [{steps}]",
            "vmsr p0, {predicate}";
            predicate = out(reg) _,
            before = in(reg) before.as_ptr(),
            after = in(reg) after.as_ptr(),
            steps = in(reg) steps_q4.as_mut_ptr(),
            relief = in(reg) u32::from(step.relief),
            lines_min = in(reg) u32::from(step.lines_min),
            five = inout(reg) 5 => _,
            eight = in(reg) 8,
        );
    }
    steps_q4
}

/// Replaces the keys in the upper half of `best` by matches as `sum << 16 | index` in all of it, from the first on:
/// a match takes the place of keys that were read. Those from `reached` on are none.
fn spread(best: &mut [u32], reached: usize) {
    let count = best.len();
    for position in 0..reached.min(count) {
        let keys: &[u16] = must_cast_slice(best);
        let Some(&key) = keys.get(count + position) else {
            return;
        };
        let key = u32::from(key);
        if let Some(best) = best.get_mut(position) {
            *best = ((key >> INDEX_BITS) << 16) | (key % (1 << INDEX_BITS));
        }
    }
    if let Some(beyond) = best.get_mut(reached..) {
        beyond.fill(u32::MAX);
    }
}
