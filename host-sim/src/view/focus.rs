//! How sharp a view is: a figure that grows as its lens is turned into focus.

/// Returns the variance of the Laplacian (four neighbours) over the middle third of a grey view,
/// row-major in lines of `width` px; 0 of views without a middle.
///
/// The figure depends on the scene: compare it with itself while the lens is turned, and the two
/// views of one scene.
#[must_use]
pub fn focus(grey: &[u8], width: usize) -> f64 {
    let height = grey.len() / width.max(1);
    let middle = |side: usize| (side / 3).max(1)..(side - side / 3).min(side.saturating_sub(1));
    let (mut sum, mut squares, mut count) = (0_i64, 0_i64, 0_i64);
    for y in middle(height) {
        for x in middle(width) {
            let at = |x: usize, y: usize| i64::from(grey[y * width + x]);
            let around = at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1);
            let laplacian = around - 4 * at(x, y);
            sum += laplacian;
            squares += laplacian * laplacian;
            count += 1;
        }
    }
    if count == 0 {
        return 0.0;
    }
    let mean = sum as f64 / count as f64;
    squares as f64 / count as f64 - mean * mean
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chequered_view_has_the_variance_that_it_must_have() {
        // Each neighbour differs by 10 from its pixel: Laplacians of 40 and -40.
        let view: Vec<u8> = (0..24 * 24)
            .map(|i| 100 + 10 * ((i + i / 24) % 2) as u8)
            .collect();
        assert!((focus(&view, 24) - 1600.0).abs() < 1e-9);
        // A slope has none, and nor has what has no middle.
        let slope: Vec<u8> = (0..24 * 24).map(|i| (3 * (i % 24)) as u8).collect();
        assert_eq!(focus(&slope, 24), 0.0);
        for (pixels, width) in [(0, 0), (1, 1), (4, 2), (9, 9)] {
            assert_eq!(focus(&vec![7; pixels], width), 0.0);
        }
    }

    #[test]
    fn it_falls_as_a_view_is_blurred_and_the_borders_do_not_count() {
        let sharp: Vec<u8> = (0..60 * 60)
            .map(|i| if (i % 60) / 5 % 2 == 0 { 30 } else { 200 })
            .collect();
        let mut blurred = sharp.clone();
        for i in 1..sharp.len() - 1 {
            let sum: u16 = sharp[i - 1..=i + 1]
                .iter()
                .map(|&level| u16::from(level))
                .sum();
            blurred[i] = (sum / 3) as u8;
        }
        assert!(focus(&blurred, 60) < 0.5 * focus(&sharp, 60));
        let mut bordered = sharp.clone();
        bordered[..60 * 15].fill(0);
        assert_eq!(focus(&bordered, 60), focus(&sharp, 60));
    }
}
