//! Arms of the cross-based region vote, four pixels per word.

use vgstereo_core::kernel::{ArmsRow, MAX_CHANNELS};

use super::simd::{distance_u8x4, load, select_ge_u8x4, splat_u8};

/// Pixels per word.
const LANES: usize = 4;

/// Equals [`vgstereo_core::kernel::arms_row`] bit for bit.
#[inline(never)]
pub(super) fn arms_row(row: &ArmsRow<'_>, arms: &mut [i16]) {
    if row.channels == 1 {
        arms_of([row.levels[0]], row, arms);
    } else {
        arms_of::<MAX_CHANNELS>(row.levels, row, arms);
    }
}

#[inline(always)]
fn arms_of<const CHANNELS: usize>(levels: [&[u8]; CHANNELS], row: &ArmsRow<'_>, arms: &mut [i16]) {
    let reach = usize::from(row.reach);
    let width = arms.len();
    let steps = Steps {
        near: splat_u8(row.near_step),
        far: splat_u8(row.far_step),
        half: reach / 2,
    };
    for (block, arms) in arms.chunks_mut(LANES).enumerate() {
        let x = block * LANES;
        // Blocks near the ends of the line are measured pixel by pixel.
        let left = if x >= reach && x + LANES <= width {
            steps.reach(levels, x, |levels| {
                let before = levels.get(x - reach..x + LANES - 1).unwrap_or_default();
                before.array_windows().rev()
            })
        } else {
            steps.reach_at_end(levels, x, |x| reach.min(x), |x, distance| x - distance)
        };
        let right = if x + reach + LANES <= width {
            steps.reach(levels, x, |levels| {
                let after = levels.get(x + 1..x + reach + LANES).unwrap_or_default();
                after.array_windows()
            })
        } else {
            let most = |x: usize| reach.min(width.saturating_sub(x + 1));
            steps.reach_at_end(levels, x, most, |x, distance| x + distance)
        };
        let both = left.to_le_bytes().into_iter().zip(right.to_le_bytes());
        for (arm, (left, right)) in arms.iter_mut().zip(both) {
            *arm = i16::from_le_bytes([left, right]);
        }
    }
}

/// Largest differences from the centre that continue an arm, levels.
struct Steps {
    /// Largest difference in the nearer half of the reach, in all four bytes.
    near: u32,
    /// Largest difference in the farther half of the reach, in all four bytes.
    far: u32,
    /// Last distance of the nearer half, px.
    half: usize,
}

impl Steps {
    #[inline(always)]
    fn at(&self, distance: usize) -> u32 {
        if distance <= self.half {
            self.near
        } else {
            self.far
        }
    }

    /// Returns the arm lengths of the four pixels from `x` on, px, one per byte. `path` turns a
    /// channel's levels into the runs of four pixels at distance 1, 2, and so on.
    #[inline(always)]
    fn reach<'a, const CHANNELS: usize, I: Iterator<Item = &'a [u8; LANES]>>(
        &self,
        levels: [&'a [u8]; CHANNELS],
        x: usize,
        path: impl Fn(&'a [u8]) -> I,
    ) -> u32 {
        let centres = levels.map(|levels| {
            let run = levels.get(x..).and_then(|run| run.first_chunk());
            run.map_or(0, load)
        });
        let mut paths = levels.map(path);
        let (mut goes_on, mut count) = (splat_u8(1), 0);
        for (step, most) in [(self.near, self.half), (self.far, usize::MAX)] {
            for _ in 0..most {
                for (path, centre) in paths.iter_mut().zip(centres) {
                    let Some(four) = path.next() else {
                        return count;
                    };
                    let difference = distance_u8x4(centre, load(four));
                    goes_on = select_ge_u8x4(step, difference, goes_on, 0);
                }
                if goes_on == 0 {
                    return count;
                }
                count += goes_on;
            }
        }
        count
    }

    /// Returns the arm lengths of the four pixels from `x` on where the line may end within the
    /// reach. `most` gives the longest possible arm at a pixel, and `place` the pixel at a distance
    /// from another.
    #[inline(always)]
    fn reach_at_end<const CHANNELS: usize>(
        &self,
        levels: [&[u8]; CHANNELS],
        x: usize,
        most: impl Fn(usize) -> usize,
        place: impl Fn(usize, usize) -> usize,
    ) -> u32 {
        let level = |levels: &[u8], at: usize| levels.get(at).copied().unwrap_or(0);
        let mut counts = [0_u8; LANES];
        for (x, count) in (x..).zip(&mut counts) {
            for distance in 1..=most(x) {
                let step = self.at(distance) as u8;
                let is_like = levels.iter().all(|levels| {
                    level(levels, x).abs_diff(level(levels, place(x, distance))) <= step
                });
                if !is_like {
                    break;
                }
                *count += 1;
            }
        }
        u32::from_le_bytes(counts)
    }
}
