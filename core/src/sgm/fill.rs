//! Fill: a pixel without a disparity takes that of the background beside it.
//!
//! A surface that only one view sees (occlusion) belongs to the background: the smaller of the
//! nearest disparities on the left and on the right (Hirschmueller 2008, Section 2.5).

use super::border::Border;
use super::surroundings::Surroundings;
use crate::config::Config;
use crate::disparity::STEPS_PER_PX;
use crate::rows::{Found, RowStage};

/// Fill of a row: extends the border, keeps the disparities still in doubt, and fills the gaps. It
/// takes rows of stored values of [`Found`], and returns rows of disparities counted from the
/// lowest, 1/16 px, without latency. A row without any disparity stays without.
#[derive(Debug)]
pub(super) struct Fill {
    border: Border,
    largest_index_q4: i16,
}

impl Fill {
    /// A fill for the disparities of `config`.
    pub(super) fn new(config: &Config) -> Self {
        // The number of disparities is bounded so that this fits 16 bits.
        let largest_px = config.disparities.count.saturating_sub(1) as i16;
        Self {
            border: Border::default(),
            largest_index_q4: largest_px * STEPS_PER_PX,
        }
    }
}

impl RowStage<Surroundings<'_, '_, '_>> for Fill {
    fn reset(&mut self) {
        self.border.reset();
    }

    fn push(&mut self, row: &mut [i16], _: &mut Surroundings<'_, '_, '_>) -> bool {
        self.border.extend(row, self.largest_index_q4);
        fill_row(row);
        true
    }

    fn flush(&mut self, _: &mut [i16], _: &mut Surroundings<'_, '_, '_>) -> bool {
        false
    }
}

/// Turns a row of stored values of [`Found`] into disparities, those in doubt too, and fills the gaps. A row
/// without any disparity stays [`INVALID`](crate::disparity::INVALID).
fn fill_row(row: &mut [i16]) {
    let mut x = 0;
    // Disparities that hold stay as they are.
    let doubtful = |&found: &i16| !Found::of(found).holds();
    while let Some(ahead) = row.get(x..).and_then(|rest| rest.iter().position(doubtful)) {
        x += ahead;
        let Some(found) = row.get_mut(x) else { return };
        if Found::of(*found).is_found() {
            *found = Found::of(*found).index_q4();
            x += 1;
            continue;
        }
        let is_gap = |&&found: &&i16| !Found::of(found).is_found();
        let end = x + row.iter().skip(x).take_while(is_gap).count();
        let before = x.checked_sub(1).and_then(|left| row.get(left).copied());
        let after = row.get(end).map(|&found| Found::of(found).index_q4());
        if let (Some(disparity), Some(gap)) =
            (before.into_iter().chain(after).min(), row.get_mut(x..end))
        {
            gap.fill(disparity);
        }
        x = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disparity::INVALID;

    #[test]
    fn gaps_take_the_smaller_neighbour() {
        const X: i16 = INVALID;
        let filled = |mut row: [i16; 8]| {
            fill_row(&mut row);
            row
        };
        assert_eq!(filled([X, X, 5, X, 9, X, 7, X]), [5, 5, 5, 5, 9, 7, 7, 7]);
        assert_eq!(filled([1, X, X, !0, X, X, 2, !3]), [1, 0, 0, 0, 0, 0, 2, 3]);
        assert_eq!(filled([X; 8]), [INVALID; 8]);
        assert_eq!(filled([1, 2, 3, 4, 5, 6, 7, 8]), [1, 2, 3, 4, 5, 6, 7, 8]);
    }
}
