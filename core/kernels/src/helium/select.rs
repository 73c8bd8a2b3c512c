//! Winner-take-all selection from up to 64 disparities, eight keys to a register.
//!
//! A key of 16 bits holds the sum of three path costs above the index of the disparity, so that the
//! least key belongs to the first of the least sums. The keys of the other view's positions stand in the
//! upper half of where its best matches will, which take twice as much.

use core::ptr;

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
    let Some(others) = others.get_mut(positions..) else {
        return;
    };
    others.fill(NO_KEY);
    let mut group = Group {
        blocks: stride / KEYS,
        stride,
        inside: disparities - 2,
        indices: INDICES.as_ptr(),
        before: [0; _],
        after: [0; _],
        best: [0; _],
        margins: [0; _],
        keys: [NO_KEY; _],
    };
    let paths = [&*row.costs, &*row.from_right, &*row.from_above];
    let outputs = row.best.chunks_mut(KEYS);
    let outputs = outputs.zip(row.refined_index_q4.chunks_mut(KEYS));
    let outputs = outputs.zip(row.margins.chunks_mut(KEYS));
    for (((best, refined), margins), first) in outputs.zip((0..).step_by(KEYS)) {
        group.select(
            paths,
            others,
            first,
            best.len(),
            row.costs.len() / stride.max(1),
        );
        let refined_q4 = refined_q4(&row.subpixel, &group);
        write(best, &group.best);
        write(refined, &refined_q4);
        write(margins, &group.margins);
    }
    spread(row.other_best, row.best.len() + disparities - 1);
}

/// Pixels that are selected for one after another, with what their loop needs; assembly addresses the fields by
/// their order.
#[repr(C)]
struct Group {
    /// Vectors of keys of a pixel.
    blocks: usize,
    stride: usize,
    /// Disparities with two neighbours.
    inside: usize,
    indices: *const u16,
    /// Sum of the disparity before the best one, less the best one's, of each pixel; 0 where the best one has not two
    /// neighbours. `after` is that of the disparity after it.
    before: [i16; KEYS],
    after: [i16; KEYS],
    best: [u16; KEYS],
    margins: [i16; KEYS],
    /// Keys of a pixel, with one before them and one after them.
    keys: [u16; MAX_STRIDE + 2],
}

impl Group {
    /// Selects for `count` pixels of the line from `first` on, and replaces those keys of the other view's positions
    /// that are larger. From pixel to pixel, the position of the lowest disparity moves down by one, to the first for
    /// the last of the line's `pixels`.
    #[inline(never)]
    fn select(
        &mut self,
        paths: [&[u8]; 3],
        others: &mut [u16],
        first: usize,
        count: usize,
        pixels: usize,
    ) {
        let stride = self.stride;
        debug_assert!(self.blocks * KEYS == stride && (LANES..=MAX_STRIDE).contains(&stride));
        debug_assert!((1..=KEYS).contains(&count) && first + count <= pixels);
        debug_assert!(paths.iter().all(|path| path.len() >= pixels * stride));
        debug_assert!(others.len() >= pixels + stride);
        let [left, right, above] = paths.map(|path| path.as_ptr().wrapping_add(first * stride));
        // SAFETY: as asserted, the path costs of a pixel, the keys and the indices have as many whole vectors, as have
        // the others from each pixel's position on; the outputs have room for all pixels; and an index, which is below
        // the number of keys, has a key before it and one after it.
        unsafe {
            vector_asm!(
                "3:",
                "ldrd {t}, {key}, [{group}]",
                "dls lr, {t}",
                "ldr {t}, [{group}, #12]",
                "add {key}, {group}, #82",
                "vmov.i8 q7, #255",
                "2:",
                "vldrb.u16 q0, [r0], #8",
                "vldrb.u16 q1, [r1], #8",
                "vldrb.u16 q2, [r2], #8",
                "vadd.i16 q0, q0, q1",
                "vldrh.u16 q3, [{t}], #16",
                "vadd.i16 q0, q0, q2",
                "vldrh.u16 q4, [{others}]",
                "vsli.16 q3, q0, #6",
                "vmin.u16 q7, q7, q3",
                "vstrh.16 q3, [{key}], #16",
                "vmin.u16 q4, q4, q3",
                "vstrh.16 q4, [{others}], #16",
                "le lr, 2b",
                "ldrd {t}, {key}, [{group}]",
                "dls lr, {t}",
                "sub {others}, {others}, {key}, lsl #1",
                "sub {others}, {others}, #2",
                "movw {least}, #65535",
                "vminv.u16 {least}, q7",
                "and {index}, {least}, #63",
                "lsr {least}, {least}, #6",
                "strh {index}, [{output}, #32]",
                "add {key}, {group}, {index}, lsl #1",
                "sub {index}, {index}, #1",
                "ldr {t}, [{group}, #8]",
                "cmp {index}, {t}",
                "ldrh {t}, [{key}, #80]",
                "rsb {t}, {least}, {t}, lsr #6",
                "it cs",
                "movcs {t}, #0",
                "strh {t}, [{output}]",
                "ldrh {t}, [{key}, #84]",
                "rsb {t}, {least}, {t}, lsr #6",
                "it cs",
                "movcs {t}, #0",
                "strh {t}, [{output}, #16]",
                // The best and its neighbours are no second best.
                "mov {t}, #-1",
                "str {t}, [{key}, #80]",
                "strh {t}, [{key}, #84]",
                "add {key}, {group}, #82",
                "vmov.i8 q7, #255",
                "2:",
                "vldrh.u16 q0, [{key}], #16",
                "vmin.u16 q7, q7, q0",
                "le lr, 2b",
                "movw {index}, #65535",
                "vminv.u16 {index}, q7",
                "rsb {index}, {least}, {index}, lsr #6",
                "strh {index}, [{output}, #48]",
                "add {output}, {output}, #2",
                "cmp {output}, {end}",
                "bne 3b";
                group = in(reg) ptr::from_mut(self),
                output = inout(reg) self.before.as_mut_ptr() => _,
                end = in(reg) self.before.as_ptr().wrapping_add(count),
                others = inout(reg) others.as_mut_ptr().wrapping_add(pixels - 1 - first) => _,
                t = out(reg) _,
                key = out(reg) _,
                least = out(reg) _,
                index = out(reg) _,
                // Loads that widen take these registers alone as addresses.
                inout("r0") left => _,
                inout("r1") right => _,
                inout("r2") above => _,
            );
        }
    }
}

/// Copies a vector, or the first of its values where there is room for fewer.
#[inline(always)]
fn write<T: Copy>(output: &mut [T], values: &[T; KEYS]) {
    if let Some(output) = output.first_chunk_mut() {
        *output = *values;
    } else {
        for (output, value) in output.iter_mut().zip(values) {
            *output = *value;
        }
    }
}

/// Returns the best disparities with the steps of [`vgstereo_core::kernel::subpixel_steps_q4`], 1/16 px.
#[inline(always)]
fn refined_q4(step: &SubpixelStep, group: &Group) -> [i16; KEYS] {
    const { assert!(STEPS_PER_PX == 1 << 4) };
    // The rounded quotient is the number of odd multiples of the divisor, up to 15 times it, that 16 times the
    // difference reaches.
    let mut refined_q4 = [0; KEYS];
    // SAFETY: the rises and all else are one vector each.
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
            "vldrh.u16 q0, [{best}]",
            "vshl.i16 q0, q0, #4",
            "vadd.i16 q2, q2, q0",
            "vstrh.16 q2, [{refined}]",
            "vmsr p0, {predicate}";
            predicate = out(reg) _,
            before = in(reg) group.before.as_ptr(),
            after = in(reg) group.after.as_ptr(),
            best = in(reg) group.best.as_ptr(),
            refined = in(reg) refined_q4.as_mut_ptr(),
            relief = in(reg) u32::from(step.relief),
            lines_min = in(reg) u32::from(step.lines_min),
            five = inout(reg) 5 => _,
            eight = in(reg) 8,
        );
    }
    refined_q4
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
