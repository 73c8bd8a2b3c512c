//! Costs of differences of levels, looked up.
//!
//! The levels of the reference view that count as equal to one of the other view are an interval. All intervals
//! are equally long but those that reach an end of the range of levels, which are open there: where a level may
//! have been clipped, or nothing is known. So the cost is that of the distance from the interval's lower end, or
//! from its only one, and one table has them all. A position of the other view is the place in the table of its
//! interval, and a level the offset from there.

use bytemuck::{must_cast_slice, must_cast_slice_mut};
use vgstereo_core::kernel::CostRun;

use crate::armv7em::simd::{in_order, splat_u8};

/// Places in the table of level 0 against an interval that begins at 0: for intervals of the common length,
/// for those that are open above, and for those that are open below and end at 0.
const CLOSED: u16 = 255;
const OPEN_ABOVE: u16 = CLOSED + 511;
const OPEN_BELOW: u16 = OPEN_ABOVE + 255;

/// Number of places, rounded up to a power of two.
pub(super) const PLACES: usize = 1024;
const _: () = assert!(OPEN_BELOW < PLACES as u16);

/// Length of the table: all levels from each place on.
const LENGTH: usize = 256 + PLACES;

/// Costs of a level against all intervals, by their place.
pub(super) struct LevelCosts {
    words: [u32; LENGTH / 4],
    /// The highest level less the lowest in each interval that is open at neither end.
    length: u8,
}

impl LevelCosts {
    /// Returns the costs for the intervals of these lowest and highest levels.
    pub(super) fn new(run: &CostRun<'_>, low: &[u8], high: &[u8]) -> Self {
        let mut lengths = low
            .iter()
            .zip(high)
            .filter(|&(&low, &high)| is_closed(low, high));
        let length = lengths
            .next()
            .map_or(0, |(low, high)| high.wrapping_sub(*low));
        let weight = u32::from(run.difference_weight_q4);
        let cost = |difference: usize| ((difference as u32 * weight) >> 4) as u8;
        let truncation = usize::from(run.difference_truncation);
        // By words, because what fills bytes is a function of the compiler's that takes four instructions a word.
        let mut words = [in_order(splat_u8(cost(truncation))); LENGTH / 4];
        let table: &mut [u8] = must_cast_slice_mut(words.as_mut_slice());
        let lows = [CLOSED, OPEN_ABOVE].map(usize::from);
        let ends = [CLOSED + u16::from(length), OPEN_BELOW].map(usize::from);
        let bounds = [usize::from(OPEN_ABOVE) - 255, LENGTH];
        for ((low, end), bound) in lows.into_iter().zip(ends).zip(bounds) {
            // Beside the interval, costs rise to either side.
            for difference in 1..truncation {
                let below = low.checked_sub(difference);
                if let Some(place) = below.and_then(|below| table.get_mut(below)) {
                    *place = cost(difference);
                }
                if let Some(place) = table
                    .get_mut(..bound)
                    .and_then(|table| table.get_mut(end + difference))
                {
                    *place = cost(difference);
                }
            }
            if let Some(inside) = table.get_mut(low..=end) {
                inside.fill(0);
            }
        }
        Self { words, length }
    }

    /// Writes the place of each interval; returns `None` if one has another length than the rest.
    pub(super) fn place(&self, low: &[u8], high: &[u8], places: &mut [u16]) -> Option<()> {
        for ((&low, &high), place) in low.iter().zip(high).zip(places) {
            *place = if low == 0 {
                OPEN_BELOW - u16::from(high)
            } else if high == u8::MAX {
                OPEN_ABOVE - u16::from(low)
            } else if high.wrapping_sub(low) == self.length {
                CLOSED - u16::from(low)
            } else {
                return None;
            };
        }
        Some(())
    }

    /// The costs of a level, by the place of the interval.
    #[inline(always)]
    pub(super) fn of(&self, level: u8) -> Option<&[u8; PLACES]> {
        let table: &[u8] = must_cast_slice(self.words.as_slice());
        table.get(level.into()..)?.first_chunk()
    }
}

/// Whether the interval of these levels reaches neither end of the range.
fn is_closed(low: u8, high: u8) -> bool {
    low > 0 && high < u8::MAX
}

/// The cost at a place.
#[inline(always)]
pub(super) fn cost_at(costs: &[u8; PLACES], place: u16) -> u32 {
    // The remainder changes nothing; it spares a bounds check.
    costs[usize::from(place) % PLACES].into()
}
