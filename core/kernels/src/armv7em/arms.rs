//! Arms of the cross-based region vote, four pixels per word.

use vgstereo_core::kernel::{ArmsRow, MAX_CHANNELS};

use super::simd::{distance_u8x4, even_bytes, load, odd_bytes, select_ge_u8x4, splat_u8};

/// Pixels per word.
const LANES: usize = 4;

/// Equals [`vgstereo_core::kernel::arms_row`] bit for bit.
#[inline(always)]
pub(super) fn arms_row(row: &ArmsRow<'_>, arms: &mut [i16]) {
    if row.channels == 1 {
        arms_of([row.levels[0]], row, arms);
    } else {
        arms_of::<MAX_CHANNELS>(row.levels, row, arms);
    }
}

#[inline(never)]
fn arms_of<const CHANNELS: usize>(levels: [&[u8]; CHANNELS], row: &ArmsRow<'_>, arms: &mut [i16]) {
    let steps = Steps {
        reach: row.reach.into(),
        near: row.near_step,
        far: row.far_step,
    };
    let width = arms.len();
    let (blocks, rest) = arms.as_chunks_mut();
    let mut x = 0;
    for block in blocks {
        *block = block_at(levels, &steps, width, x);
        x += LANES;
    }
    if !rest.is_empty() {
        let block = block_at(levels, &steps, width, x);
        for (arms, &block) in rest.iter_mut().zip(&block) {
            *arms = block;
        }
    }
}

/// Returns the arms of the four pixels from `x` on, those of pixels beyond the line of any length.
#[inline(always)]
fn block_at<const CHANNELS: usize>(
    levels: [&[u8]; CHANNELS],
    steps: &Steps,
    width: usize,
    x: usize,
) -> [i16; LANES] {
    let (reach, half) = (steps.reach, steps.half());
    // Distances at which all four pixels are within the line.
    let inside = if x + LANES <= width { reach } else { 0 };
    let (before, after) = (inside.min(x), inside.min(width.saturating_sub(x + LANES)));
    let run = |from: usize, pixels: usize| {
        // Four pixels at a time, each one further.
        levels.map(|levels| {
            let run = levels.get(from..from + pixels + LANES - 1);
            run.unwrap_or_default()
        })
    };
    let arms = Arms::new(levels, x);

    let mut left = arms;
    let nearer = before.min(half);
    let runs = run(x - nearer, nearer).map(|run| run.array_windows().rev());
    if left.extend(runs, steps.near) {
        let farther = run(x - before, before - nearer);
        left.extend(farther.map(|run| run.array_windows().rev()), steps.far);
    }
    if before < reach {
        left.finish(before, |x, distance| {
            distance <= x && steps.are_like(levels, x, x - distance, distance)
        });
    }

    let mut right = arms;
    let nearer = after.min(half);
    let runs = run(x + 1, nearer).map(<[u8]>::array_windows);
    if right.extend(runs, steps.near) {
        let farther = run(x + 1 + nearer, after - nearer);
        right.extend(farther.map(<[u8]>::array_windows), steps.far);
    }
    if after < reach {
        right.finish(after, |x, distance| {
            x + distance < width && steps.are_like(levels, x, x + distance, distance)
        });
    }

    let even = even_bytes(left.lengths) | even_bytes(right.lengths) << 8;
    let odd = odd_bytes(left.lengths) | odd_bytes(right.lengths) << 8;
    [even, odd, even >> 16, odd >> 16].map(|arms| arms as i16)
}

/// Largest differences from the centre that continue an arm, levels.
struct Steps {
    /// Longest arm, px.
    reach: usize,
    /// Largest difference in the nearer half of the reach.
    near: u8,
    /// Largest difference in the farther half of the reach.
    far: u8,
}

impl Steps {
    /// Last distance of the nearer half, px.
    #[inline(always)]
    fn half(&self) -> usize {
        self.reach / 2
    }

    /// Whether a pixel at a distance from the pixel `x` continues its arm.
    #[inline(always)]
    fn are_like<const CHANNELS: usize>(
        &self,
        levels: [&[u8]; CHANNELS],
        x: usize,
        other: usize,
        distance: usize,
    ) -> bool {
        let step = if distance <= self.half() {
            self.near
        } else {
            self.far
        };
        let level = |levels: &[u8], at: usize| levels.get(at).copied().unwrap_or(0);
        let differences = levels.map(|levels| level(levels, x).abs_diff(level(levels, other)));
        distance <= self.reach && differences.iter().all(|&difference| difference <= step)
    }
}

/// Arms of four pixels in one direction.
#[derive(Clone, Copy)]
struct Arms<const CHANNELS: usize> {
    /// The first pixel.
    x: usize,
    centres: [u32; CHANNELS],
    /// 1 in the bytes of pixels whose arm goes on.
    going_on: u32,
    /// Lengths so far, px, one per byte.
    lengths: u32,
}

impl<const CHANNELS: usize> Arms<CHANNELS> {
    #[inline(always)]
    fn new(levels: [&[u8]; CHANNELS], x: usize) -> Self {
        let centre = |levels: &[u8]| levels.get(x..)?.first_chunk().map(load);
        Self {
            x,
            centres: levels.map(|levels| centre(levels).unwrap_or(0)),
            going_on: splat_u8(1),
            lengths: 0,
        }
    }

    /// Extends the arms along the runs of four pixels at successive distances, with differences of up
    /// to `step`. Returns whether one of the arms goes on.
    #[inline(always)]
    fn extend<'a>(
        &mut self,
        mut runs: [impl Iterator<Item = &'a [u8; LANES]>; CHANNELS],
        step: u8,
    ) -> bool {
        let step = splat_u8(step);
        loop {
            let mut going_on = self.going_on;
            for (runs, centre) in runs.iter_mut().zip(self.centres) {
                let Some(four) = runs.next() else {
                    return true;
                };
                let difference = distance_u8x4(centre, load(four));
                going_on = select_ge_u8x4(step, difference, going_on, 0);
            }
            self.going_on = going_on;
            if going_on == 0 {
                return false;
            }
            self.lengths += going_on;
        }
    }

    /// Extends the arms that go on beyond the distance `within`, pixel by pixel, as long as `continues`
    /// says so of a pixel and a distance.
    #[inline(always)]
    fn finish(&mut self, within: usize, continues: impl Fn(usize, usize) -> bool) {
        let mut lengths = self.lengths.to_le_bytes();
        let lanes = lengths.iter_mut().zip(self.going_on.to_le_bytes());
        for (x, (length, goes_on)) in (self.x..).zip(lanes) {
            let distances =
                (within + 1..).take_while(|&distance| goes_on > 0 && continues(x, distance));
            *length += distances.count() as u8;
        }
        self.lengths = u32::from_le_bytes(lengths);
    }
}
