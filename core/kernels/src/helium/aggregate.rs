//! Path costs of sixteen disparities at once, for any number of disparities.
//!
//! The path costs of the pixel before lie between two guards, so that the loads of the neighbouring
//! disparities need no exception at the ends of the range. Two rows take turns: a step reads the one and
//! writes the other.

use vgstereo_core::kernel::{AggregateRow, aggregate_paths as portable, path_scratch_bytes};

use super::{LANES, vector_asm};

/// Bytes before and after the path costs of a pixel.
const GUARD: usize = 1;

/// Equals [`portable`] bit for bit.
pub(super) fn aggregate_paths(row: &mut AggregateRow<'_>) {
    let stride = row.stride;
    let pixels = row.costs.len().min(row.from_right.len()) / stride.max(1);
    let is_whole = stride > 0
        && stride.is_multiple_of(LANES)
        && row.paths.len() >= path_scratch_bytes(stride)
        && row.from_above.len() >= pixels * stride
        && row.p2_along.len() >= pixels
        && row.p2_down.len() >= pixels;
    if !is_whole {
        portable(row);
        return;
    }
    row.paths.fill(u8::MAX);
    let guarded = stride + 2 * GUARD;
    let (previous, rest) = row.paths.split_at_mut(guarded);
    let (current, above) = rest.split_at_mut(guarded);
    let mut turns = [previous, current];

    let p1 = row.p1;
    let costs = row.costs.chunks_exact_mut(stride);
    let to_right = costs.zip(row.from_right.chunks_exact_mut(stride));
    let penalties = core::iter::once(&0).chain(row.p2_along[..pixels].iter().skip(1).rev());
    let mut least = None;
    for ((costs, from_right), &p2) in to_right.rev().zip(penalties) {
        least = Some(follow(&mut turns, costs, Some(from_right), [p1, p2], least));
    }

    let costs = row.costs.chunks_exact_mut(stride);
    let lines = costs.zip(row.from_above.chunks_exact_mut(stride));
    let penalties = row.p2_along.iter().zip(row.p2_down);
    let mut least = None;
    for ((costs, from_above), (&p2_along, &p2_down)) in lines.zip(penalties) {
        if row.is_first {
            from_above.copy_from_slice(costs);
        } else {
            descend(above, costs, from_above, [p1, p2_down]);
        }
        least = Some(follow(&mut turns, costs, None, [p1, p2_along], least));
    }
}

/// Takes a step along a line: writes the path costs of a pixel to the second of two guarded rows, the first
/// of which has those of the pixel before, and to `path`, or else in place of the matching costs; then the
/// rows take turns. `least` is the least path cost of the pixel before, and that of this pixel is returned. A
/// path without one begins with the matching costs.
#[inline(always)]
fn follow(
    turns: &mut [&mut [u8]; 2],
    costs: &mut [u8],
    path: Option<&mut [u8]>,
    [p1, p2]: [u8; 2],
    least: Option<u32>,
) -> u32 {
    let length = costs.len();
    debug_assert!(length > 0 && length.is_multiple_of(LANES));
    debug_assert!(turns.iter().all(|row| row.len() == length + 2 * GUARD));
    debug_assert!(path.as_ref().is_none_or(|path| path.len() == length));
    let [previous, current] = turns;
    let costs = costs.as_mut_ptr();
    let path = path.map_or(costs, <[u8]>::as_mut_ptr);
    // Nothing is less than nothing: a path begins as if all was reached without cost.
    let (p2, least) = least.map_or((0, 0), |least| (p2, least));
    let mut next_least: u32 = u8::MAX.into();
    // SAFETY: as asserted, the costs and the path have whole vectors, and the rows as many and a guard at
    // either end, from which the neighbours of the disparities at the ends of the range are read.
    unsafe {
        vector_asm!(
            "vdup.8 q7, {p2}",
            "dls lr, {blocks}",
            "2:",
            "vldrb.u8 q0, [{previous}, #-1]",
            "vldrb.u8 q1, [{previous}, #1]",
            "vmin.u8 q0, q0, q1",
            "vldrb.u8 q2, [{previous}], #16",
            "vqadd.u8 q0, q0, {p1}",
            "vldrb.u8 q3, [{costs}], #16",
            "vmin.u8 q0, q0, q2",
            "vsub.i8 q0, q0, {least}",
            "vmin.u8 q0, q0, q7",
            "vqadd.u8 q0, q0, q3",
            "vstrb.8 q0, [{current}], #16",
            "vminv.u8 {next_least}, q0",
            "vstrb.8 q0, [{path}], #16",
            "le lr, 2b";
            blocks = in(reg) length / LANES,
            previous = inout(reg) previous.as_ptr().add(GUARD) => _,
            current = inout(reg) current.as_mut_ptr().add(GUARD) => _,
            costs = inout(reg) costs => _,
            path = inout(reg) path => _,
            p1 = in(reg) u32::from(p1),
            p2 = in(reg) u32::from(p2),
            least = in(reg) least,
            next_least = inout(reg) next_least,
        );
    }
    turns.swap(0, 1);
    next_least
}

/// Takes a step down: replaces the path costs of the pixel above by those of this pixel. `above` is a guarded
/// row of scratch.
#[inline(always)]
fn descend(above: &mut [u8], costs: &[u8], path: &mut [u8], [p1, p2]: [u8; 2]) {
    let length = costs.len();
    debug_assert!(length > 0 && length.is_multiple_of(LANES));
    debug_assert!(path.len() == length && above.len() >= length + 2 * GUARD);
    // SAFETY: as asserted, the costs and the path have whole vectors, and the scratch as many and a guard
    // at either end.
    unsafe {
        vector_asm!(
            "mov {least}, #255",
            "dls lr, {blocks}",
            "2:",
            "vldrb.u8 q0, [{path}], #16",
            "vminv.u8 {least}, q0",
            "vstrb.8 q0, [{above}], #16",
            "le lr, 2b",
            "sub {path}, {path}, {length}",
            "sub {above}, {above}, {length}",
            "vdup.8 q7, {p2}",
            "dls lr, {blocks}",
            "2:",
            "vldrb.u8 q0, [{above}, #-1]",
            "vldrb.u8 q1, [{above}, #1]",
            "vmin.u8 q0, q0, q1",
            "vldrb.u8 q2, [{above}], #16",
            "vqadd.u8 q0, q0, {p1}",
            "vldrb.u8 q3, [{costs}], #16",
            "vmin.u8 q0, q0, q2",
            "vsub.i8 q0, q0, {least}",
            "vmin.u8 q0, q0, q7",
            "vqadd.u8 q0, q0, q3",
            "vstrb.8 q0, [{path}], #16",
            "le lr, 2b";
            blocks = in(reg) length / LANES,
            length = in(reg) length,
            above = inout(reg) above.as_mut_ptr().add(GUARD) => _,
            costs = inout(reg) costs.as_ptr() => _,
            path = inout(reg) path.as_mut_ptr() => _,
            p1 = in(reg) u32::from(p1),
            p2 = in(reg) u32::from(p2),
            least = out(reg) _,
        );
    }
}
