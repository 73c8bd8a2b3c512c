//! Winner-take-all selection from up to 64 disparities, eight keys to a register.
//!
//! A key of 16 bits holds the sum of three path costs above the index of the disparity, so that the
//! least key belongs to the first of the least sums. The keys of the other view's positions stand in the
//! upper half of where its best matches will, which take twice as much.

use bytemuck::{must_cast_slice, must_cast_slice_mut};
use vgstereo_core::disparity::STEPS_PER_PX;
use vgstereo_core::kernel::{AggregateRow, Kernels, Portable, subpixel_step_q4};

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
    let outputs = row.best.iter_mut().zip(&mut *row.refined_index_q4);
    let outputs = outputs.zip(&mut *row.margins);
    // From pixel to pixel, the position of the lowest disparity moves down by one.
    let positions = (0..row.costs.len() / stride).rev();
    for ((((left, right), above), ((best, refined_index_q4), margin)), position) in
        paths.zip(outputs).zip(positions)
    {
        let Some(others) = others.get_mut(position..position + stride) else {
            return;
        };
        let least = meet([left, right, above], others, &mut keys);
        let (index, least) = (
            (least % MAX_STRIDE as u32) as usize,
            (least >> INDEX_BITS) as i16,
        );
        let Some(around) = keys
            .get_mut(index..)
            .and_then(<[u16]>::first_chunk_mut::<3>)
        else {
            return;
        };
        let sums = around.map(|key| (key >> INDEX_BITS) as i16);
        // The best and its neighbours are no second best.
        *around = [NO_KEY; 3];
        let is_inside = index > 0 && index + 1 < disparities;
        let step_q4 = if is_inside {
            subpixel_step_q4(&row.subpixel, sums[0] - least, sums[2] - least)
        } else {
            0
        };
        *best = index as u16;
        *refined_index_q4 = index as i16 * STEPS_PER_PX + step_q4;
        *margin = (least_of(&keys, stride) >> INDEX_BITS) as i16 - least;
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
