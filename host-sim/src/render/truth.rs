//! The ground truth of the rendered scene: exact disparities and the masks of the benchmark.

use rayon::prelude::*;
use vgstereo_courtyard::{Courtyard, Side};

use crate::scene::{GroundTruth, Mask};

/// Neighbours whose disparities differ by more than this are at a discontinuity, px.
const JUMP_PX: f32 = 1.5;
/// How far the mask `disc` reaches from a discontinuity, px: windows of 9 x 9 pixels.
const JUMP_REACH_PX: usize = 4;

/// Returns the disparities of both views and the three masks. Each disparity comes from one ray
/// through the centre of its pixel.
pub(super) fn ground_truth(yard: &Courtyard, width: u32, height: u32) -> GroundTruth {
    let columns = width as usize;
    let pixels = columns * height as usize;
    let disparity = |side: Side, x: usize, y: usize| {
        yard.look(side, x as f64, y as f64)
            .map_or(f32::NAN, |seen| yard.disparity_px(seen.depth) as f32)
    };
    let mut left_px = vec![f32::NAN; pixels];
    let mut right_px = vec![f32::NAN; pixels];
    let mut nonocc = vec![false; pixels];
    left_px
        .par_chunks_exact_mut(columns)
        .zip(right_px.par_chunks_exact_mut(columns))
        .zip(nonocc.par_chunks_exact_mut(columns))
        .enumerate()
        .for_each(|(y, ((left, right), nonocc))| {
            for (x, ((left, right), nonocc)) in left.iter_mut().zip(right).zip(nonocc).enumerate() {
                *right = disparity(Side::Right, x, y);
                let Some(seen) = yard.look(Side::Left, x as f64, y as f64) else {
                    continue;
                };
                let d_px = yard.disparity_px(seen.depth);
                *left = d_px as f32;
                let x_right_px = x as f64 - d_px;
                // The right camera's ray to the same point must not end before it.
                *nonocc = x_right_px >= 0.0
                    && yard
                        .look(Side::Right, x_right_px, y as f64)
                        .is_some_and(|other| other.depth >= seen.depth * (1.0 - 1e-6));
            }
        });
    let all: Vec<bool> = left_px.iter().map(|d| d.is_finite()).collect();
    let near = near_jumps(&left_px, columns);
    let disc: Vec<bool> = nonocc.iter().zip(near).map(|(&a, b)| a && b).collect();
    GroundTruth {
        left_px,
        right_px: Some(right_px),
        nonocc: Some(Mask::from(nonocc)),
        all: Some(Mask::from(all)),
        disc: Some(Mask::from(disc)),
    }
}

/// Returns which pixels are within [`JUMP_REACH_PX`] columns and lines of a jump between
/// neighbours.
fn near_jumps(disparity_px: &[f32], columns: usize) -> Vec<bool> {
    let jump = |a: f32, b: f32| (a - b).abs() > JUMP_PX;
    let mut jumps = vec![false; disparity_px.len()];
    for (index, &here) in disparity_px.iter().enumerate() {
        let right = index + 1;
        if right % columns != 0 && jump(here, disparity_px[right]) {
            jumps[index] = true;
            jumps[right] = true;
        }
        let below = index + columns;
        if below < disparity_px.len() && jump(here, disparity_px[below]) {
            jumps[index] = true;
            jumps[below] = true;
        }
    }
    // A square window is a window along lines, then one along columns.
    let mut wide = vec![false; jumps.len()];
    for (line, wide) in jumps
        .chunks_exact(columns)
        .zip(wide.chunks_exact_mut(columns))
    {
        for (x, wide) in wide.iter_mut().enumerate() {
            let from = x.saturating_sub(JUMP_REACH_PX);
            let to = (x + JUMP_REACH_PX + 1).min(columns);
            *wide = line[from..to].contains(&true);
        }
    }
    let lines = wide.len() / columns;
    let mut near = vec![false; wide.len()];
    for (y, near) in near.chunks_exact_mut(columns).enumerate() {
        let from = y.saturating_sub(JUMP_REACH_PX);
        let to = (y + JUMP_REACH_PX + 1).min(lines);
        for line in wide[from * columns..to * columns].chunks_exact(columns) {
            for (near, &wide) in near.iter_mut().zip(line) {
                *near |= wide;
            }
        }
    }
    near
}
