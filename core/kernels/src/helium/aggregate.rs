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
        && row.paths.len() == path_scratch_bytes(stride)
        && row.from_above.len() >= pixels * stride
        && row.p2_along.len() >= pixels
        && row.p2_down.len() >= pixels;
    if !is_whole {
        portable(row);
        return;
    }
    row.paths.fill(u8::MAX);
    let guarded = stride + 2 * GUARD;
    let mut rows = row.paths.chunks_exact_mut(guarded);
    let (Some(previous), Some(current), Some(above)) = (rows.next(), rows.next(), rows.next())
    else {
        return;
    };
    let mut turns = [previous, current];

    let length = pixels * stride;
    let (Some(costs), Some(from_right), Some(from_above), Some([_, penalties @ ..]), Some(p2_down)) = (
        row.costs.get_mut(..length),
        row.from_right.get_mut(..length),
        row.from_above.get_mut(..length),
        row.p2_along.get(..pixels),
        row.p2_down.get(..pixels),
    ) else {
        return;
    };
    follow::<true>(&mut turns, costs, Some(from_right), row.p1, penalties);
    if row.is_first {
        from_above.copy_from_slice(costs);
    } else {
        descend(above, costs, from_above, row.p1, p2_down);
    }
    follow::<false>(&mut turns, costs, None, row.p1, penalties);
}

/// Follows a path along a line of pixels, to the left or to the right: writes its costs to `path`, or else in place
/// of the matching costs. Two guarded rows take turns to have the path costs of the pixel before. `penalties` has P2
/// of each pair of neighbouring pixels.
#[inline(never)]
fn follow<const TO_LEFT: bool>(
    turns: &mut [&mut [u8]; 2],
    costs: &mut [u8],
    path: Option<&mut [u8]>,
    p1: u8,
    penalties: &[u8],
) {
    let [previous, current] = turns;
    let (stride, pixels) = (previous.len() - 2 * GUARD, penalties.len() + 1);
    debug_assert!(stride > 0 && stride.is_multiple_of(LANES) && current.len() == previous.len());
    debug_assert!(costs.len() == stride * pixels);
    debug_assert!(path.as_ref().is_none_or(|path| path.len() == costs.len()));
    let costs = costs.as_mut_ptr();
    let path = path.map_or(costs, <[u8]>::as_mut_ptr);
    let (first, penalty) = match TO_LEFT {
        true => ((pixels - 1) * stride, penalties.len().saturating_sub(1)),
        false => (0, 0),
    };
    macro_rules! follow {
        ($next_penalty:literal, $($back:literal),*) => {
            vector_asm!(
                // The path begins with the matching costs: a step that may cost nothing.
                "vmov.i8 q7, #0",
                "mov {least}, #0",
                "3:",
                "lsr {t}, {stride}, #4",
                "dls lr, {t}",
                "mov {t}, #255",
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
                "vminv.u8 {t}, q0",
                "vstrb.8 q0, [{path}], #16",
                "le lr, 2b",
                "subs {pixels}, {pixels}, #1",
                "beq 4f",
                "mov {least}, {t}",
                "sub {t}, {current}, {stride}",
                "sub {current}, {previous}, {stride}",
                "mov {previous}, {t}",
                concat!("ldrb {t}, [{penalty}], #", $next_penalty),
                "vdup.8 q7, {t}",
                $($back,)*
                "b 3b",
                "4:";
                stride = in(reg) stride,
                pixels = inout(reg) pixels => _,
                previous = inout(reg) previous.as_ptr().wrapping_add(GUARD) => _,
                current = inout(reg) current.as_mut_ptr().wrapping_add(GUARD) => _,
                costs = inout(reg) costs.wrapping_add(first) => _,
                path = inout(reg) path.wrapping_add(first) => _,
                penalty = inout(reg) penalties.as_ptr().wrapping_add(penalty) => _,
                p1 = in(reg) u32::from(p1),
                least = out(reg) _,
                t = out(reg) _,
            )
        };
    }
    // SAFETY: as asserted, costs and path have whole vectors for each pixel; the rows have as many for one, and a guard
    // at either end, from which the neighbours of the disparities at the ends of the range are read; and there is a
    // penalty for each pixel but the first.
    unsafe {
        if TO_LEFT {
            follow!(
                "-1",
                "sub {costs}, {costs}, {stride}, lsl #1",
                "sub {path}, {path}, {stride}, lsl #1"
            );
        } else {
            follow!("1",);
        }
    }
}

/// Takes a step down with each pixel of a line: replaces the path costs of the line above by those of this line. `above`
/// is a guarded row of scratch, for the path costs of the pixel above.
#[inline(never)]
fn descend(above: &mut [u8], costs: &[u8], path: &mut [u8], p1: u8, penalties: &[u8]) {
    let (stride, pixels) = (above.len() - 2 * GUARD, penalties.len());
    debug_assert!(stride > 0 && stride.is_multiple_of(LANES) && pixels > 0);
    debug_assert!(costs.len() == stride * pixels && path.len() == costs.len());
    // SAFETY: as asserted, costs and path have whole vectors for each pixel, of which there is one at least, and the
    // scratch has as many for one, and a guard at either end.
    unsafe {
        vector_asm!(
            "3:",
            "mov {least}, #255",
            "lsr {t}, {stride}, #4",
            "dls lr, {t}",
            "2:",
            "vldrb.u8 q0, [{path}], #16",
            "vminv.u8 {least}, q0",
            "vstrb.8 q0, [{above}], #16",
            "le lr, 2b",
            "sub {path}, {path}, {stride}",
            "sub {above}, {above}, {stride}",
            "dls lr, {t}",
            "ldrb {t}, [{penalty}], #1",
            "vdup.8 q7, {t}",
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
            "le lr, 2b",
            "sub {above}, {above}, {stride}",
            "subs {pixels}, {pixels}, #1",
            "bne 3b";
            stride = in(reg) stride,
            pixels = inout(reg) pixels => _,
            above = inout(reg) above.as_mut_ptr().wrapping_add(GUARD) => _,
            costs = inout(reg) costs.as_ptr() => _,
            path = inout(reg) path.as_mut_ptr() => _,
            penalty = inout(reg) penalties.as_ptr() => _,
            p1 = in(reg) u32::from(p1),
            least = out(reg) _,
            t = out(reg) _,
        );
    }
}
