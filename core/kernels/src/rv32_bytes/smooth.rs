//! Smoothing between edges, four pixels to a register.

use vgstereo_core::kernel;

use super::instructions::{align, at_least_u8x4, distance_u8x4, halve_sum_u8x4};
use super::quads::{Quads, join_all};
use crate::armv7em::simd::splat_u8;

/// Pixels per word.
const LANES: usize = 4;

/// Equals [`kernel::smooth_row`] bit for bit.
#[inline(never)]
pub(super) fn smooth_row(rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
    let done = smooth(rows, step_max, smoothed).unwrap_or(0);
    let rest = smoothed.get_mut(done..).unwrap_or_default();
    let rows = rows.map(|row| row.get(done..).unwrap_or_default());
    kernel::smooth_row(rows, step_max, rest);
}

/// Smooths the first pixels and returns how many, or `None` if a row is too short for the last of all.
#[inline(always)]
fn smooth(rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) -> Option<usize> {
    let width = smoothed.len();
    let step = splat_u8(step_max);
    let mut quads = [Quads::new(&[]); 3];
    for (quads, row) in quads.iter_mut().zip(rows) {
        *quads = Quads::new(row.get(..width + 2)?);
    }
    // The first of the row, and those behind it.
    let mut left = quads.map(|row| row.left);
    let [above, own, below] = quads.map(|row| row.words.split_first());
    let (above, own, below) = (above?, own?, below?);
    let [mut above_quad] = join_all(&mut left[0], [*above.0]);
    let [mut own_quad] = join_all(&mut left[1], [*own.0]);
    let [mut below_quad] = join_all(&mut left[2], [*below.0]);
    let words = above.1.iter().zip(own.1).zip(below.1);
    let mut done = 0;
    for (output, ((&above, &own), &below)) in
        smoothed.as_chunks_mut::<LANES>().0.iter_mut().zip(words)
    {
        let [above] = join_all(&mut left[0], [above]);
        let [own] = join_all(&mut left[1], [own]);
        let [below] = join_all(&mut left[2], [below]);
        let columns = |quad: u32, next: u32| [quad, align::<1>(quad, next), align::<2>(quad, next)];
        let [a, b, c] = columns(above_quad, above);
        let [d, level, f] = columns(own_quad, own);
        let [g, h, i] = columns(below_quad, below);
        let distances = [a, b, c, d, f, g, h, i].map(|other| distance_u8x4(other, level));
        let are_near = distances.map(|distance| at_least_u8x4(step, distance));
        let near = |other: u32, is_near: u32| level ^ ((other ^ level) & is_near);
        let [a, b, c, d, f, g, h, i] = [
            near(a, are_near[0]),
            near(b, are_near[1]),
            near(c, are_near[2]),
            near(d, are_near[3]),
            near(f, are_near[4]),
            near(g, are_near[5]),
            near(h, are_near[6]),
            near(i, are_near[7]),
        ];
        let pairs = [(a, g), (c, i), (b, h), (d, f)].map(|(a, b)| halve_sum_u8x4(a, b));
        let corners = halve_sum_u8x4(pairs[0], pairs[1]);
        let edges = halve_sum_u8x4(pairs[2], pairs[3]);
        let smoothed = halve_sum_u8x4(edges, halve_sum_u8x4(level, corners));
        *output = smoothed.to_le_bytes();
        (above_quad, own_quad, below_quad) = (above, own, below);
        done += LANES;
    }
    Some(done)
}
