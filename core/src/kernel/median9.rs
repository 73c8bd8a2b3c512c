//! Median of 3 x 3 pixels, by minima and maxima alone, which become vector code.

use super::neighbours::neighbours;

/// Writes to `output` the median of the 3 x 3 pixels around each pixel of a row. `rows` are the
/// values above the row, of the row itself and below it, each with one more value at both ends.
///
/// The columns of three are sorted first; the median is the middle one of the largest of
/// their least, the middle one of their middle ones, and the least of their largest.
#[inline(always)]
pub fn median9_row(rows: [&[i16]; 3], output: &mut [i16]) {
    let width = output.len();
    let Some([[a, b, c], [d, e, f], [g, h, i]]) = neighbours(rows, width) else {
        return;
    };
    // Equal lengths, proven once: no check is left in the loop.
    let (a, b, c) = (&a[..width], &b[..width], &c[..width]);
    let (d, e, f) = (&d[..width], &e[..width], &f[..width]);
    let (g, h, i) = (&g[..width], &h[..width], &i[..width]);
    for x in 0..width {
        let (low_a, middle_a, high_a) = sorted(a[x], b[x], c[x]);
        let (low_b, middle_b, high_b) = sorted(d[x], e[x], f[x]);
        let (low_c, middle_c, high_c) = sorted(g[x], h[x], i[x]);
        let low = low_a.max(low_b).max(low_c);
        let (_, middle, _) = sorted(middle_a, middle_b, middle_c);
        let high = high_a.min(high_b).min(high_c);
        (_, output[x], _) = sorted(low, middle, high);
    }
}

#[inline(always)]
fn sorted(a: i16, b: i16, c: i16) -> (i16, i16, i16) {
    let (low, high) = (a.min(b), a.max(b));
    (low.min(c), low.max(high.min(c)), high.max(c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    #[test]
    fn the_median_is_the_fifth_of_the_sorted_nine() {
        for seed in 0..50 {
            let mut random = Pcg32::seed_from_u64(seed);
            let rows: [[i16; 9]; 3] =
                core::array::from_fn(|_| core::array::from_fn(|_| (random.next_u32() % 7) as i16));
            let mut medians = [0; 7];
            median9_row(rows.each_ref().map(|row| &row[..]), &mut medians);
            for (x, &median) in medians.iter().enumerate() {
                let mut nine: std::vec::Vec<i16> = rows
                    .iter()
                    .flat_map(|row| &row[x..x + 3])
                    .copied()
                    .collect();
                nine.sort_unstable();
                assert_eq!(median, nine[4], "seed {seed}, column {x}");
            }
        }
    }
}
