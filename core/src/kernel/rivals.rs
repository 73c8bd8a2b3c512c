//! Rivals in a row of costs: blocks of pixels in whose surroundings a second disparity fits about as well as
//! the best.

use super::lanes::{LANES, Lanes, add, in_order, lanes_of, subtract};

/// Pixels that share a window.
pub const RIVAL_BLOCK_PX: usize = 4;

/// Distance of the pixels of a window whose costs are summed up, px. Those between have nearly the same
/// patterns.
pub const RIVAL_STEP_PX: usize = 2;

/// Pixels of a block whose costs are summed up.
const SAMPLES: usize = RIVAL_BLOCK_PX / RIVAL_STEP_PX;

/// The highest bit of each of two sums. No sum has it: 65 costs of at most 254 are less.
const HIGHEST: u32 = 0x8000_8000;

/// A row of costs in which rivals are looked for.
#[derive(Debug, Clone, Copy)]
pub struct RivalsRow<'a> {
    /// Matching costs, `stride` per pixel, of which the first are those of the `disparities`. Those of a set that keeps
    /// them elsewhere are not here.
    pub costs: &'a [u8],
    /// Bytes from the costs of one pixel to those of the next, at least 1.
    pub stride: usize,
    /// Number of disparities; those beyond a multiple of four are left out.
    pub disparities: usize,
    /// Reach of the window to either side, px, at most 64.
    pub reach_px: usize,
    /// Ratio to the least sum below which a sum is that of a rival, 1/16; `slack` is added to the product.
    pub ratio_q4: u8,
    /// Cost that is added to `ratio_q4` times the least sum.
    pub slack: u8,
    /// Height of what parts two rivals, as a cost per pixel of the window that is summed up: a sum between the two
    /// must be larger by this, times the number of these pixels, than a rival's may be.
    pub rise: u8,
}

impl RivalsRow<'_> {
    /// Number of pixels.
    #[must_use]
    pub fn width(&self) -> usize {
        self.costs.len() / self.stride.max(1)
    }

    /// The sums in `scratch`, two words for each four disparities, all 0. If there is less scratch, there are sums
    /// of as many disparities.
    #[inline(always)]
    pub fn sums_in<'s>(&self, scratch: &'s mut [u32]) -> &'s mut [[u32; 2]] {
        let sums = scratch.as_chunks_mut().0;
        let count = sums.len().min(self.disparities / LANES);
        let sums = sums.get_mut(..count).unwrap_or_default();
        sums.fill([0; 2]);
        sums
    }

    /// The costs of a pixel that are summed up, four by four.
    #[must_use]
    #[inline(always)]
    pub fn costs_of(&self, x: usize) -> &[[u8; 4]] {
        let costs = self.costs.get(x * self.stride..(x + 1) * self.stride);
        let costs = costs.and_then(|costs| costs.get(..self.disparities));
        costs.unwrap_or_default().as_chunks().0
    }

    /// The pixels that are summed up for block `block`, `RIVAL_STEP_PX` apart from a multiple of it on.
    #[must_use]
    #[inline(always)]
    pub fn window(&self, block: usize) -> core::ops::Range<usize> {
        let centre = block * RIVAL_BLOCK_PX + RIVAL_BLOCK_PX / 2;
        let (start, end) = (
            centre.saturating_sub(self.reach_px),
            centre + self.reach_px + 1,
        );
        let end = end.min(self.width());
        start.min(end).next_multiple_of(RIVAL_STEP_PX)..end.next_multiple_of(RIVAL_STEP_PX)
    }

    /// The bounds of sums over `samples` pixels of which `least` is the least: the first that is not a rival's,
    /// and the first that parts two rivals.
    #[must_use]
    #[inline(always)]
    pub fn bounds(&self, least: u32, samples: usize) -> [u32; 2] {
        let bound = ((least * u32::from(self.ratio_q4)) >> 4) + u32::from(self.slack);
        [bound, bound + u32::from(self.rise) * samples as u32]
    }
}

/// Writes 1 for each block of the row whose window has a rival, and 0 for the others: where a sum of costs
/// is nearly as small as the least one, and a much larger one lies between. `sums` is scratch, a word for each
/// two disparities; if there are fewer, as many disparities are looked at.
#[inline(always)]
pub fn rivals_row(row: &RivalsRow<'_>, sums: &mut [u32], rivals: &mut [u8]) {
    let sums = row.sums_in(sums);
    // The pixels that are in the sums.
    let mut window = 0..0;
    for (block, rival) in rivals.iter_mut().enumerate() {
        let next = row.window(block);
        let entering = (window.end..next.end).step_by(RIVAL_STEP_PX);
        let leaving = (window.start..next.start).step_by(RIVAL_STEP_PX);
        // What leaves has entered before.
        if entering.len() == SAMPLES && leaving.len() == SAMPLES {
            let two = |first| [row.costs_of(first), row.costs_of(first + RIVAL_STEP_PX)];
            replace(sums, two(window.end), two(window.start));
        } else {
            for x in entering {
                change(sums, row.costs_of(x), add);
            }
            for x in leaving {
                change(sums, row.costs_of(x), subtract);
            }
        }
        let samples = next.clone().step_by(RIVAL_STEP_PX).len();
        *rival = u8::from(has_rival(row, sums, samples));
        window = next;
    }
}

/// Adds the costs of a column to the sums, or subtracts them.
fn change(sums: &mut [Lanes], costs: &[[u8; LANES]], by: impl Fn(&mut Lanes, Lanes)) {
    for (sums, &costs) in sums.iter_mut().zip(costs) {
        by(sums, lanes_of(u32::from_le_bytes(costs)));
    }
}

/// Adds the costs of as many columns as are subtracted: all at once, so that sums are loaded and stored
/// once.
fn replace(
    sums: &mut [Lanes],
    [a, b]: [&[[u8; LANES]]; SAMPLES],
    [c, d]: [&[[u8; LANES]]; SAMPLES],
) {
    let costs = a.iter().zip(b).zip(c.iter().zip(d));
    for (sums, ((&a, &b), (&c, &d))) in sums.iter_mut().zip(costs) {
        let [a, b, mut leaving, d] = [a, b, c, d].map(|costs| lanes_of(u32::from_le_bytes(costs)));
        add(sums, a);
        add(sums, b);
        add(&mut leaving, d);
        subtract(sums, leaving);
    }
}

/// Whether the least of the sums over `samples` pixels has a rival: whether sums below the bound lie on both
/// sides of one that is far above it. Where they do, one of them is the least.
fn has_rival(row: &RivalsRow<'_>, sums: &[Lanes], samples: usize) -> bool {
    let least = sums.iter().flatten().fold(!HIGHEST, |a, &b| least_of(a, b));
    let least = (least & 0xffff).min(least >> 16);
    let [bound, wall] = row.bounds(least, samples);
    let (lows_end, walls_start) = (both_halves(bound), both_halves(wall));
    let (mut has_low, mut has_wall) = (false, false);
    for &sums in sums {
        // Only a wall is looked for after a low sum, and only a low sum otherwise.
        let [a, b] = sums;
        let has_none = if has_low && !has_wall {
            at_least(a, walls_start) | at_least(b, walls_start) == 0
        } else {
            at_least(a, lows_end) & at_least(b, lows_end) == HIGHEST
        };
        if has_none {
            continue;
        }
        for sum in in_order(sums) {
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
    false
}

/// A bound of sums in both halves of a word; all that are above every sum are the same.
fn both_halves(bound: u32) -> u32 {
    // Either half of `HIGHEST`.
    let bound = bound.min(1 << 15);
    bound << 16 | bound
}

/// The highest bit of each of the two sums of a word that is at least its bound.
#[inline(always)]
fn at_least(sums: u32, bounds: u32) -> u32 {
    // No half borrows.
    ((sums | HIGHEST) - bounds) & HIGHEST
}

/// The lesser of each of the two sums of two words.
fn least_of(a: u32, b: u32) -> u32 {
    // Where `b` is not the greater one, the difference keeps the highest bit.
    let difference = (a | HIGHEST) - b;
    let kept = difference & HIGHEST;
    let mask = kept - (kept >> 15);
    a - (difference & mask)
}
