//! Arms of the cross-based region vote: runs of similar colour along a line.
//!
//! The arms of a pixel are the runs of pixels on its left and on its right whose colour is similar
//! to its own (Zhang, Lu and Lafruit 2009).

use super::unpack::MAX_CHANNELS;

/// A line along which to measure the arms of each pixel's cross.
#[derive(Debug, Clone, Copy)]
pub struct ArmsRow<'a> {
    /// Channels of the line, one level per pixel each.
    pub levels: [&'a [u8]; MAX_CHANNELS],
    /// Number of channels in use: 1 or 3.
    pub channels: usize,
    /// Longest arm, px, at most 127.
    pub reach: u8,
    /// Largest difference from the centre in any channel, levels, in the nearer half of the
    /// reach.
    pub near_step: u8,
    /// Largest difference from the centre in any channel, levels, in the farther half.
    pub far_step: u8,
}

/// Bytes of scratch of [`arms_row`] for lines of `width` pixels.
#[must_use]
pub const fn arms_scratch_bytes(width: usize) -> usize {
    4 * width
}

/// Writes the arms of each pixel of a line, px: that to the left in the low byte, that to the right
/// in the high byte. An arm ends before the first pixel that differs too much from the centre, at
/// the edge of the line, or at the reach.
///
/// The loop goes over distances, and at each over all pixels: whether two pixels at that distance
/// are similar concerns the arms of both.
#[inline(always)]
pub fn arms_row(row: &ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]) {
    let width = arms.len();
    let Some((goes_left, rest)) = scratch.split_at_mut_checked(width) else {
        return;
    };
    let Some((goes_right, rest)) = rest.split_at_mut_checked(width) else {
        return;
    };
    let Some((left, rest)) = rest.split_at_mut_checked(width) else {
        return;
    };
    let Some(right) = rest.get_mut(..width) else {
        return;
    };
    goes_left.fill(1);
    goes_right.fill(1);
    left.fill(0);
    right.fill(0);
    let [red, green, blue] = row.levels;
    // A single channel stands for all three.
    let (green, blue) = if row.channels == 1 {
        (red, red)
    } else {
        (green, blue)
    };
    for distance in 1..=usize::from(row.reach) {
        let step = if distance <= usize::from(row.reach / 2) {
            row.near_step
        } else {
            row.far_step
        };
        let pairs = width.saturating_sub(distance);
        let (Some(red_b), Some(green_b), Some(blue_b)) = (
            red.get(distance..),
            green.get(distance..),
            blue.get(distance..),
        ) else {
            break;
        };
        let (Some(goes_left), Some(left)) =
            (goes_left.get_mut(distance..), left.get_mut(distance..))
        else {
            break;
        };
        // Equal lengths, proven once.
        let (Some(red), Some(green), Some(blue)) =
            (red.get(..pairs), green.get(..pairs), blue.get(..pairs))
        else {
            break;
        };
        let (Some(red_b), Some(green_b), Some(blue_b)) = (
            red_b.get(..pairs),
            green_b.get(..pairs),
            blue_b.get(..pairs),
        ) else {
            break;
        };
        let (Some(goes_left), Some(left), Some(goes_on), Some(right)) = (
            goes_left.get_mut(..pairs),
            left.get_mut(..pairs),
            goes_right.get_mut(..pairs),
            right.get_mut(..pairs),
        ) else {
            break;
        };
        for x in 0..pairs {
            let difference = red[x]
                .abs_diff(red_b[x])
                .max(green[x].abs_diff(green_b[x]))
                .max(blue[x].abs_diff(blue_b[x]));
            let alike = u8::from(difference <= step);
            goes_on[x] &= alike;
            right[x] += goes_on[x];
            goes_left[x] &= alike;
            left[x] += goes_left[x];
        }
        // Longer arms end at the edge of the line.
    }
    for ((arms, &left), &right) in arms.iter_mut().zip(&*left).zip(&*right) {
        *arms = i16::from_le_bytes([left, right]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn arms_equal_those_measured_pixel_by_pixel() {
        for seed in 0..60 {
            let mut random = Pcg32::seed_from_u64(seed);
            let mut below = |bound: u32| (random.next_u32() % bound) as u8;
            let width = 1 + usize::from(below(60));
            let channels = if below(2) == 0 { 1 } else { 3 };
            let planes: Vec<Vec<u8>> = (0..channels)
                .map(|_| (0..width).map(|_| below(30)).collect())
                .collect();
            let mut levels = [&[][..]; MAX_CHANNELS];
            for (levels, plane) in levels.iter_mut().zip(&planes) {
                *levels = plane;
            }
            let row = ArmsRow {
                levels,
                channels,
                reach: below(20),
                near_step: below(30),
                far_step: below(30),
            };
            let mut arms = vec![-1; width];
            arms_row(&row, &mut vec![5; arms_scratch_bytes(width)], &mut arms);
            let arm = |x: usize, columns: &mut dyn Iterator<Item = usize>| {
                let within = columns
                    .take(row.reach.into())
                    .zip(1..)
                    .take_while(|&(other, px)| {
                        let step = if px <= row.reach / 2 {
                            row.near_step
                        } else {
                            row.far_step
                        };
                        planes
                            .iter()
                            .all(|plane| plane[x].abs_diff(plane[other]) <= step)
                    });
                within.count() as u8
            };
            for (x, found) in arms.iter().enumerate() {
                let expected = [arm(x, &mut (0..x).rev()), arm(x, &mut (x + 1..width))];
                assert_eq!(found.to_le_bytes(), expected, "seed {seed}, column {x}");
            }
        }
    }
}
