//! Smoothing between edges, four pixels at once.

use vgstereo_core::kernel;

use super::simd::{
    add_saturating_u8x4, halve_sum_u8x4, load, select_ge_u8x4, splat_u8, store,
    sub_saturating_u8x4, sub_wrapping_u8x4,
};

/// Pixels per word.
const LANES: usize = 4;

/// Equals [`kernel::smooth_row`] bit for bit.
#[inline(never)]
pub(super) fn smooth_row(rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
    let done = smoothed.len() / LANES * LANES;
    if smooth(rows, step_max, smoothed).is_some() {
        let rest = smoothed.get_mut(done..).unwrap_or_default();
        let rows = rows.map(|row| row.get(done..).unwrap_or_default());
        kernel::smooth_row(rows, step_max, rest);
    } else {
        kernel::smooth_row(rows, step_max, smoothed);
    }
}

#[inline(always)]
fn smooth(rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) -> Option<()> {
    let width = smoothed.len();
    let outputs = smoothed.as_chunks_mut::<LANES>().0;
    let step = splat_u8(step_max);
    let mut windows = [&[][..]; 3];
    for (windows, row) in windows.iter_mut().zip(rows) {
        // Rows that are too short for the last pixel leave the whole output unchanged.
        *windows = row.get(..width + 2)?;
    }
    let [above, own, below] = windows.map(|row| row.windows(LANES + 2).step_by(LANES));
    let pixels = outputs.iter_mut().zip(above).zip(own).zip(below);
    for (((output, above), own), below) in pixels {
        let [above, own, below] = [above, own, below].map(columns);
        let level = own[1];
        let low = sub_saturating_u8x4(level, step);
        // The difference of a level below `low` wraps round to more than `range`.
        let range = sub_wrapping_u8x4(add_saturating_u8x4(level, step), low);
        let near = |other: u32| select_ge_u8x4(range, sub_wrapping_u8x4(other, low), other, level);
        let corners = halve_sum_u8x4(
            halve_sum_u8x4(near(above[0]), near(below[0])),
            halve_sum_u8x4(near(above[2]), near(below[2])),
        );
        let edges = halve_sum_u8x4(
            halve_sum_u8x4(near(above[1]), near(below[1])),
            halve_sum_u8x4(near(own[0]), near(own[2])),
        );
        let smoothed = halve_sum_u8x4(edges, halve_sum_u8x4(level, corners));
        store(smoothed, output);
    }
    Some(())
}

/// Loads four pixels from each of the first three positions of a window.
#[inline(always)]
fn columns(window: &[u8]) -> [u32; 3] {
    core::array::from_fn(|column| {
        let quad = window.get(column..).and_then(|rest| rest.first_chunk());
        quad.map_or(0, load)
    })
}
