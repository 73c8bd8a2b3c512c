//! Smoothing: the mean of a pixel's neighbourhood, edges left out.
//!
//! If texture is faint, noise decides the cells of a pattern. A level becomes the binomial
//! mean of its neighbourhood of 3 x 3 pixels, in which a neighbour that differs by more than a
//! step counts as the centre level itself, so that edges stay: the sigma filter (Lee 1983),
//! with fixed weights.

use super::neighbours::neighbours;

/// Writes the smoothed levels of a row to `smoothed`. `rows` are the levels above the row, of
/// the row itself and below it, each with one more pixel at both ends. Neighbours that differ
/// by more than `step_max` levels do not take part.
///
/// The mean is formed of halves of sums, rounded down, as registers of bytes form them: first
/// of the corners and of the edges by pairs, then of the centre and the corners, and last of
/// that and the edges.
#[inline(always)]
pub fn smooth_row(rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
    let width = smoothed.len();
    let Some([[a, b, c], [d, e, f], [g, h, i]]) = neighbours(rows, width) else {
        return;
    };
    // Equal lengths, proven once: no check is left in the loop.
    let (a, b, c) = (&a[..width], &b[..width], &c[..width]);
    let (d, e, f) = (&d[..width], &e[..width], &f[..width]);
    let (g, h, i) = (&g[..width], &h[..width], &i[..width]);
    for x in 0..width {
        let own = e[x];
        let near = |level: u8| {
            let step = level.saturating_sub(own) | own.saturating_sub(level);
            if step <= step_max { level } else { own }
        };
        let corners = midpoint(
            midpoint(near(a[x]), near(c[x])),
            midpoint(near(g[x]), near(i[x])),
        );
        let edges = midpoint(
            midpoint(near(b[x]), near(h[x])),
            midpoint(near(d[x]), near(f[x])),
        );
        smoothed[x] = midpoint(edges, midpoint(own, corners));
    }
}

/// Half of the sum, in a form that stays 8 bits wide in vector code.
#[inline(always)]
const fn midpoint(a: u8, b: u8) -> u8 {
    (a & b) + ((a ^ b) >> 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smoothed(rows: [[u8; 5]; 3], step_max: u8) -> [u8; 3] {
        let mut smoothed = [0; 3];
        smooth_row(rows.each_ref().map(|row| &row[..]), step_max, &mut smoothed);
        smoothed
    }

    #[test]
    fn noise_goes_and_edges_stay() {
        // A ramp and a flat line stay. A single level that differs keeps a quarter of its
        // difference.
        assert_eq!(smoothed([[8, 10, 12, 14, 16]; 3], 4), [10, 12, 14]);
        let flat = [20; 5];
        assert_eq!(
            smoothed([flat, [20, 20, 24, 20, 20], flat], 4),
            [20, 21, 20]
        );
        // At an edge higher than `step_max`, both sides stay.
        assert_eq!(smoothed([[20, 20, 20, 90, 90]; 3], 4), [20, 20, 90]);
        // With the largest `step_max`, all levels take part in the mean; with 0, only the pixel's
        // own.
        assert_eq!(smoothed([[0, 0, 255, 0, 0]; 3], u8::MAX), [63, 127, 63]);
        assert_eq!(
            smoothed([flat, [20, 20, 24, 20, 20], flat], 0),
            [20, 24, 20]
        );
    }
}
