//! Rivals in a row of costs: two sums of costs to a register, as halfwords.

use vgstereo_core::kernel::{RIVAL_BLOCK_PX, RIVAL_STEP_PX, RivalsRow};

use super::simd::{
    add_even_bytes, add_odd_bytes, even_bytes, in_order, load, meet_all, min_u16x2, odd_bytes,
    splat_u16, sub_saturating_u16x2,
};

/// Sums of four disparities: the first and the third, and the others.
type Sums = [u32; 2];

/// Costs of a pixel, of four disparities each.
type Costs<'a> = &'a [[u8; 4]];

/// A sum that is above all.
const NO_SUM: u16 = 1 << 15;

/// Equals [`rivals_row`](vgstereo_core::kernel::rivals_row) bit for bit.
#[inline(never)]
pub(super) fn rivals_row(row: &RivalsRow<'_>, sums: &mut [u32], rivals: &mut [u8]) {
    let sums = row.sums_in(sums);
    // The pixels that are in the sums.
    let mut window = 0..0;
    for (block, rival) in rivals.iter_mut().enumerate() {
        let next = row.window(block);
        let is_moved = |before: usize, after: usize| after - before == RIVAL_BLOCK_PX;
        let is_inside = is_moved(window.start, next.start) && is_moved(window.end, next.end);
        let moved = || Some((two(row, window.end)?, two(row, window.start)?));
        let least = if let (true, Some((entering, leaving))) = (is_inside, moved()) {
            replace(sums, entering, leaving)
        } else {
            for x in (window.end..next.end).step_by(RIVAL_STEP_PX) {
                change(sums, row.costs_of(x), u32::wrapping_add);
            }
            for x in (window.start..next.start).step_by(RIVAL_STEP_PX) {
                change(sums, row.costs_of(x), u32::wrapping_sub);
            }
            meet_all(sums.as_flattened(), min_u16x2)
        };
        let least = (least & 0xffff).min(least >> 16);
        let samples = next.len().div_ceil(RIVAL_STEP_PX);
        *rival = u8::from(has_rival(sums, row.bounds(least, samples)));
        window = next;
    }
}

/// The costs of the pixels of a block that enter a window, or leave it, of which the first is `first`.
#[inline(always)]
fn two<'a>(row: &RivalsRow<'a>, first: usize) -> Option<[Costs<'a>; 2]> {
    const { assert!(RIVAL_BLOCK_PX == 2 * RIVAL_STEP_PX) };
    let second = RIVAL_STEP_PX * row.stride;
    let costs = row.costs.get(first * row.stride..)?;
    let costs = costs.get(..second + row.disparities)?;
    let costs = [costs.get(..row.disparities)?, costs.get(second..)?];
    Some(costs.map(|costs| costs.as_chunks().0))
}

/// Adds the costs of a pixel to the sums, or subtracts them.
fn change(sums: &mut [Sums], costs: Costs<'_>, by: impl Fn(u32, u32) -> u32) {
    for ([even, odd], costs) in sums.iter_mut().zip(costs) {
        let costs = load(costs);
        *even = by(*even, even_bytes(costs));
        *odd = by(*odd, odd_bytes(costs));
    }
}

/// Adds the costs of the pixels that enter and subtracts those of the ones that leave. Returns the least of
/// either half of all sums.
fn replace(sums: &mut [Sums], [a, b]: [Costs<'_>; 2], [c, d]: [Costs<'_>; 2]) -> u32 {
    let mut least = splat_u16(NO_SUM);
    let costs = a.iter().zip(b).zip(c.iter().zip(d));
    for (sums, ((a, b), (c, d))) in sums.iter_mut().zip(costs) {
        // One after the other, because there are few registers.
        let [mut even, mut odd] = *sums;
        for entering in [a, b] {
            let costs = in_order(load(entering));
            even = in_order(add_even_bytes(even, costs));
            odd = in_order(add_odd_bytes(odd, costs));
        }
        // The costs that leave were added before.
        let (c, d) = (in_order(load(c)), in_order(load(d)));
        even = in_order(even.wrapping_sub(add_even_bytes(even_bytes(c), d)));
        odd = in_order(odd.wrapping_sub(add_odd_bytes(odd_bytes(c), d)));
        *sums = [even, odd];
        least = min_u16x2(min_u16x2(least, even), odd);
    }
    least
}

/// Whether sums below `bound` lie on both sides of one that is at least `wall`, which is not less.
fn has_rival(sums: &[Sums], [bound, wall]: [u32; 2]) -> bool {
    let half = |bound: u32| bound.min(NO_SUM.into()) as u16;
    let Some(below_wall) = half(wall).checked_sub(1) else {
        // No sum is below 0.
        return false;
    };
    let (lows_end, below_wall) = (splat_u16(half(bound)), splat_u16(below_wall));
    let (mut has_low, mut has_wall) = (false, false);
    let mut rest = sums.iter();
    loop {
        // Only a wall is looked for after a low sum, and only a low sum otherwise.
        let next = if has_low && !has_wall {
            let above = |sums| sub_saturating_u16x2(sums, below_wall);
            rest.find(|&&[even, odd]| above(even) | above(odd) != 0)
        } else {
            let below = |sums| sub_saturating_u16x2(lows_end, sums);
            rest.find(|&&[even, odd]| below(even) | below(odd) != 0)
        };
        let Some(&[even, odd]) = next else {
            return false;
        };
        for sum in [even & 0xffff, odd & 0xffff, even >> 16, odd >> 16] {
            if sum < bound {
                if has_wall {
                    return true;
                }
                has_low = true;
            } else if sum >= wall {
                has_wall = has_low;
            }
        }
    }
}
