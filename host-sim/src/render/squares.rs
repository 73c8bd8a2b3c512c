//! A board of squares in many poses before the distorted cameras, as it is shown to them to
//! calibrate them.

use core::f64::consts::FRAC_PI_2;

use anyhow::{Context, Result};
use glam::DVec2;
use rand_core::Rng;
use rand_pcg::Pcg32;

use vgstereo_courtyard::half_sides_m;

use crate::calibration::RectifiedPair;

/// Range of the depth of the board's middle, m: nearer than any object of the scene.
const DEPTHS: [f64; 2] = [0.6, 1.0];
/// Largest angle by which the board is turned out of the picture plane, and within it, parts of a right
/// angle.
const TILT: f64 = 0.4;
const ROLL: f64 = 0.25;
/// How far from the borders of the pictures the whole board is, px.
const CLEAR_PX: f64 = 3.0;
/// Poses that are tried, of which that nearest to the wanted place is taken.
const TRIES: u32 = 300;

/// Where a board is, from the left rectified camera: its middle, m, and the directions of its long and its short side,
/// each along the columns, the lines and the optical axis.
pub(super) type Pose = ([f64; 3], [[f64; 3]; 2]);

/// Returns the pose of this number: the board goes through nine parts of the left picture, then of the right one, as far
/// as both cameras see it whole. `baseline` is in m.
///
/// # Errors
/// Fails when no pose is seen whole by both cameras.
pub(super) fn pose(pair: &RectifiedPair, baseline: f64, seed: u64, pose: u32) -> Result<Pose> {
    let mut random = Pcg32::new(seed, (u64::from(pose) << 1 | 1) + (1 << 32));
    let mut share = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let view = (pose / 9 % 2) as usize;
    let size = DVec2::from_array(pair.raw_size.map(f64::from));
    let part = DVec2::new(f64::from(pose % 3), f64::from(pose / 3 % 3));
    let wanted = (part + 0.5) / 3.0 * size;
    let mut best: Option<(f64, Pose)> = None;
    for _ in 0..TRIES {
        let nearness = share();
        let middle_px = 0.5 * size + nearness * (wanted - 0.5 * size);
        let depth = DEPTHS[0] + share() * (DEPTHS[1] - DEPTHS[0]);
        let mut angle = |largest: f64| (2.0 * share() - 1.0) * largest * FRAC_PI_2;
        let angles = [angle(TILT), angle(TILT), angle(ROLL)];
        if best.as_ref().is_some_and(|&(best, _)| best >= nearness) {
            continue;
        }
        let Some(tangents) = pair.rectified_ray(view, middle_px) else {
            continue;
        };
        let from_left = if view == 0 { 0.0 } else { baseline };
        let middle = [tangents.x * depth + from_left, tangents.y * depth, depth];
        let axes = axes(angles);
        if is_whole(pair, baseline, middle, axes) {
            best = Some((nearness, (middle, axes)));
        }
    }
    let (_, pose) = best.context("no pose of the board is seen whole by both cameras")?;
    Ok(pose)
}

/// The directions of the long and the short side, for rotations about the columns, the lines and
/// the optical axis, rad. By libm, which is the same on every platform.
fn axes([x, y, z]: [f64; 3]) -> [[f64; 3]; 2] {
    let [(sx, cx), (sy, cy), (sz, cz)] =
        [x, y, z].map(|angle| (libm::sin(angle), libm::cos(angle)));
    [
        [cz * cy, sz * cy, -sy],
        [cz * sy * sx - sz * cx, sz * sy * sx + cz * cx, cy * sx],
    ]
}

/// Whether both cameras see all of the board's outline.
fn is_whole(
    pair: &RectifiedPair,
    baseline: f64,
    middle: [f64; 3],
    [along, across]: [[f64; 3]; 2],
) -> bool {
    let [half_along, half_across] = half_sides_m();
    let size = DVec2::from_array(pair.raw_size.map(f64::from));
    let steps = [-1.0, -0.5, 0.0, 0.5, 1.0];
    steps.into_iter().all(|u| {
        steps.into_iter().all(|v| {
            let [x, y, z] = [0, 1, 2].map(|axis| {
                middle[axis] + u * half_along * along[axis] + v * half_across * across[axis]
            });
            [0.0, baseline]
                .into_iter()
                .enumerate()
                .all(|(view, from_left)| {
                    let tangents = DVec2::new(x - from_left, y) / z;
                    let pixel = tangents * pair.focal_px + pair.principal_px[view];
                    let (at, is_seen) = pair.raw_position(view, pixel);
                    let borders = at.min(size - 1.0 - at);
                    is_seen && borders.min_element() >= CLEAR_PX
                })
        })
    })
}
