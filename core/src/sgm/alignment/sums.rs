//! Sums over the matches of lines, from which offsets of lines follow by least squares.

use crate::kernel::LevelConversion;
use crate::rows::RowOffsets;

/// Largest difference of levels that is used: larger ones stem from wrong matches or occlusion
/// rather than from the offset.
const DIFFERENCE_MAX: u32 = 24;
/// Largest difference between the lines above and below that is used: larger ones are edges, at
/// which levels do not follow the gradient.
const GRADIENT_MAX: u32 = 64;
/// Fading of the sums: they lose 1/8 with every line.
const FADING_SHIFT: u32 = 3;
/// Length of the running means along the line: about 8 matches.
const MEAN_SHIFT: u32 = 3;

/// Rows of grey around a row that is matched, in stored order.
#[derive(Debug, Clone, Copy)]
pub(in crate::sgm) struct GreyRows<'a> {
    /// The row of the reference view.
    pub(in crate::sgm) own: &'a [u8],
    /// Rows of the other view: above the row, at it, and below it.
    pub(in crate::sgm) others: [&'a [u8]; 3],
}

/// A match whose levels are compared, as positions in the stored order of each view.
#[derive(Debug, Clone, Copy)]
pub(in crate::sgm) struct Match {
    /// Position in the row of the reference view.
    pub(in crate::sgm) position: usize,
    /// Position in the row of the other view, in whole pixels.
    pub(in crate::sgm) other_position: usize,
    /// Sub-pixel step from that position to the match, 1/16 px, in stored order.
    pub(in crate::sgm) subpixel_q4: i16,
}

/// Sums over the matches of lines: of the squares of the gradients, where a gradient is the line below less
/// the line above, and of the products of gradients and differences; each also with the position x of the
/// match in the other view, from the middle of its line.
#[derive(Debug, Default)]
pub(super) struct Sums {
    pub(super) squares: i64,
    pub(super) squares_x: i64,
    pub(super) squares_xx: i64,
    pub(super) products: i64,
    pub(super) products_x: i64,
}

impl Sums {
    /// The sums of the matches of a row, given in the order of the line, whose pixels were moved by `offsets` or
    /// by `reach_q24` if that is less: where it is less they teach nothing. `conversion` is that of grey levels.
    // Apart, so that all registers are its own.
    #[inline(never)]
    pub(super) fn of(
        matches: impl Iterator<Item = Match>,
        rows: GreyRows<'_>,
        conversion: &LevelConversion,
        offsets: RowOffsets,
        reach_q24: i32,
    ) -> Self {
        let middle = (rows.own.len() / 2) as i32;
        let (mut squares, mut products) = (0_i32, 0_i32);
        let (mut squares_x, mut squares_xx, mut products_x) = (0_i64, 0_i64, 0_i64);
        let (mut mean_difference_q3, mut mean_gradient_q3) = (0, 0);
        for found in matches {
            let Some((difference, gradient)) = compare(found, rows, conversion) else {
                continue;
            };
            if difference.unsigned_abs() > DIFFERENCE_MAX || gradient.unsigned_abs() > GRADIENT_MAX
            {
                continue;
            }
            // Within 2^15 of the middle.
            let x = found.other_position as i32 - middle;
            let moved_q24 = offsets.shift_q24 + offsets.tilt_q24 * x;
            if moved_q24.abs() > reach_q24 {
                continue;
            }
            mean_difference_q3 += difference - (mean_difference_q3 >> MEAN_SHIFT);
            mean_gradient_q3 += gradient - (mean_gradient_q3 >> MEAN_SHIFT);
            let difference_q3 = (difference << MEAN_SHIFT) - mean_difference_q3;
            let gradient_q3 = (gradient << MEAN_SHIFT) - mean_gradient_q3;
            // Each is at most (16 * 64)^2 / 64, and fewer than 2^15 matches of a line are used.
            let square = (gradient_q3 * gradient_q3) >> (2 * MEAN_SHIFT);
            let product = (gradient_q3 * difference_q3) >> (2 * MEAN_SHIFT);
            squares += square;
            products += product;
            squares_x += i64::from(square) * i64::from(x);
            squares_xx += i64::from(square * x) * i64::from(x);
            products_x += i64::from(product) * i64::from(x);
        }
        Self {
            squares: squares.into(),
            squares_x,
            squares_xx,
            products: products.into(),
            products_x,
        }
    }

    /// Adds the sums of a row to those of the rows above, which fade.
    pub(super) fn add(&mut self, row: &Self) {
        for (sum, row) in [
            (&mut self.squares, row.squares),
            (&mut self.squares_x, row.squares_x),
            (&mut self.squares_xx, row.squares_xx),
            (&mut self.products, row.products),
            (&mut self.products_x, row.products_x),
        ] {
            *sum += row - (*sum >> FADING_SHIFT);
        }
    }
}

/// The level of the reference view less that of the match in the reference camera's exposure,
/// and the line below the match less the line above it. `None` at the edge of the row.
#[inline]
fn compare(found: Match, rows: GreyRows<'_>, conversion: &LevelConversion) -> Option<(i32, i32)> {
    let at = found.other_position;
    let [above, middle, below] = rows.others;
    let around = middle.get(at.checked_sub(1)?..)?.first_chunk()?;
    let [before, level, after] = around.map(i32::from);
    let [own, above, below] = [
        *rows.own.get(found.position)?,
        *above.get(at)?,
        *below.get(at)?,
    ]
    .map(i32::from);
    let between = ((after - before) * i32::from(found.subpixel_q4)) >> 5;
    let matched = (level + between).clamp(0, 255) as u8;
    Some((own - i32::from(conversion.apply(matched)), below - above))
}
