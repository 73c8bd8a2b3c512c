//! Region vote: a pixel rejected or in doubt takes the disparity most of its surface has.
//!
//! The surface is the cross of like colour around the pixel: up and down from it, and
//! left and right from each pixel of that (Zhang, Lu and Lafruit 2009; Mei et al. 2011).
//! Every other pixel of every other line of it votes.
//! One pass in place, from the top left: a pixel that was voted for votes further on.

use super::ring::RowRing;
use crate::config::RegionVoteParameters;
use crate::disparity::{DisparityRange, INVALID, STEPS_PER_PX};
use crate::kernel::Kernels;
use crate::matching::MAX_CHANNELS;
use crate::memory::{Arena, OutOfMemory, words};
use crate::strip::Strip;

/// Most lines of a window.
const MAX_LINES: usize = 31;

/// The vote over a ring of `2 reach_y + 1` rows.
#[derive(Debug)]
pub struct RegionVote<'m, K> {
    kernels: K,
    rows: RowRing<'m>,
    /// How far the surface of each pixel reaches along its line: left, and right times 256.
    arms: RowRing<'m>,
    arms_row: &'m mut [i16],
    arms_scratch: &'m mut [u8],
    /// At most one of every pixel of a window of 255 columns and [`MAX_LINES`].
    votes: &'m mut [i16],
    parameters: RegionVoteParameters,
    done: u32,
}

impl RegionVote<'_, ()> {
    /// Words of memory: `4 y + 3` rows, four of bytes, and a counter per disparity.
    #[must_use]
    pub const fn memory_words(
        width: usize,
        disparities: DisparityRange,
        parameters: RegionVoteParameters,
    ) -> usize {
        2 * RowRing::memory_words(width, 0, 2 * parameters.reach_y_px as usize + 1)
            + words(width, size_of::<i16>())
            + words(arms_scratch_bytes(width), 1)
            + words(disparities.count as usize + 1, size_of::<i16>())
    }
}

impl<'m, K: Kernels> RegionVote<'m, K> {
    /// A vote for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`RegionVote::memory_words`] left.
    pub fn new(
        width: usize,
        disparities: DisparityRange,
        parameters: RegionVoteParameters,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let depth = 2 * usize::from(parameters.reach_y_px) + 1;
        let mut ring = || RowRing::new(width, 0, depth, parameters.reach_y_px, INVALID, arena);
        let (rows, arms) = (ring()?, ring()?);
        Ok(Self {
            kernels,
            rows,
            arms,
            arms_row: arena.take(width)?,
            arms_scratch: arena.take(arms_scratch_bytes(width))?,
            // The last place is for pixels without a disparity.
            votes: arena.take(usize::from(disparities.count) + 1)?,
            parameters,
            done: 0,
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        self.rows.reset();
        self.arms.reset();
    }

    /// Takes a row as [`RowCheck::write`](crate::aggregation::RowCheck::write) gives it. True
    /// when this completes a row, then [`RegionVote::row`].
    /// `channels` are the reference view's, with the rows of the window still there; row
    /// 0 of the ring is line `first_line` of theirs.
    pub fn push(&mut self, row: &[i16], channels: &[Strip<'_>], first_line: u32) -> bool {
        let image_line = first_line + self.rows.rows_in();
        let mut levels = [&[][..]; MAX_CHANNELS];
        for (levels, channel) in levels.iter_mut().zip(channels) {
            *levels = channel.row(image_line);
        }
        let arms = ArmsRow {
            levels,
            channels: channels.len().min(MAX_CHANNELS),
            reach: self.parameters.reach_x_px,
            near_step: self.parameters.near_step,
            far_step: self.parameters.far_step,
        };
        self.kernels
            .arms_row(&arms, self.arms_scratch, self.arms_row);
        self.arms.push(self.arms_row);
        let line = self.rows.push(row);
        self.vote_row(line, channels, first_line)
    }

    /// After the last row: completes the next of the rows still to come; false when
    /// there are no more.
    pub fn flush(&mut self, channels: &[Strip<'_>], first_line: u32) -> bool {
        let line = self.rows.flush();
        self.vote_row(line, channels, first_line)
    }

    /// The row last completed.
    #[must_use]
    pub fn row(&self) -> &[i16] {
        self.rows.row(self.done)
    }

    fn vote_row(&mut self, line: Option<u32>, channels: &[Strip<'_>], first_line: u32) -> bool {
        let Some(line) = line else { return false };
        self.done = line;
        let there = self.rows.around(line, self.parameters.reach_y_px);
        // The lines of the window, looked up once per row.
        let mut lines = [[&[][..]; MAX_CHANNELS]; MAX_LINES];
        // Rows and arms have the same places in their rings.
        let mut starts = [0; MAX_LINES];
        for ((lines, start), row) in lines.iter_mut().zip(&mut starts).zip(there.clone()) {
            *start = self.rows.row_start(row);
            for (levels, channel) in lines.iter_mut().zip(channels) {
                *levels = channel.row(first_line + row);
            }
        }
        let centre = (line - there.start) as usize;
        let window = Window {
            lines: lines.get(..there.len()).unwrap_or_default(),
            channels: channels.len().min(MAX_CHANNELS),
            parameters: &self.parameters,
        };
        // What lies before the first pixel that holds is the border's, not the vote's.
        let first = self.rows.row(line).iter().position(|&found| found >= 0);
        let width = self.rows.row(line).len();
        let own_start = self.rows.row_start(line);
        for x in first.unwrap_or(width)..width {
            let Some(&own) = self.rows.values().get(own_start + x) else {
                break;
            };
            if own >= 0 {
                continue;
            }
            self.votes.fill(0);
            let mut total = 0;
            let above = window.reach_up(centre, x);
            let below = window.reach_down(centre, x);
            let surface = starts.get(centre - above..=centre + below);
            // The pixel's own line among them.
            for start in surface
                .unwrap_or_default()
                .iter()
                .skip(above % 2)
                .step_by(2)
            {
                let at = start + x;
                let arms = self.arms.values().get(at).copied().unwrap_or(0);
                // Within the row.
                let [left, right] = arms.to_le_bytes().map(usize::from);
                let run = self.rows.values().get(at - left..=at + right);
                total += count_votes(run.unwrap_or_default(), self.votes);
            }
            if let Some(elected_q4) = self.elect(total)
                && let Some(pixel) = self.rows.values_mut().get_mut(own_start + x)
            {
                *pixel = elected_q4;
            }
        }
        true
    }

    /// The disparity that wins, 1/16 px, of so many votes in all.
    fn elect(&self, total: usize) -> Option<i16> {
        let (&none, votes) = self.votes.split_last()?;
        let total = total - usize::from(none.cast_unsigned());
        // A reduction, which becomes vector code where there is any.
        let most = votes.iter().fold(0, |a, &b| a.max(b));
        let first = votes.iter().position(|&votes| votes == most)?;
        let share_min = usize::from(self.parameters.share_min_percent);
        let wins = total > usize::from(self.parameters.support_min)
            && usize::from(most.cast_unsigned()) * 100 > total * share_min;
        // Within the range, and so within 1/16 px.
        wins.then_some(first as i16 * STEPS_PER_PX)
    }
}

/// Counts every other disparity of a run, rounded to px; those that do not hold in the last
/// place. Gives how many.
fn count_votes(run_q4: &[i16], votes: &mut [i16]) -> usize {
    let Some(last) = votes.len().checked_sub(1) else {
        return 0;
    };
    for &found_q4 in run_q4.iter().step_by(2) {
        // Negative where rejected or in doubt, and then beyond every disparity.
        let rounded_px = (usize::from(found_q4.cast_unsigned()) + 8) >> 4;
        if let Some(votes) = votes.get_mut(rounded_px.min(last)) {
            *votes += 1;
        }
    }
    run_q4.len().div_ceil(2)
}

/// The lines around a row, and how far the surface of a pixel reaches in them.
struct Window<'a> {
    lines: &'a [[&'a [u8]; MAX_CHANNELS]],
    channels: usize,
    parameters: &'a RegionVoteParameters,
}

impl Window<'_> {
    /// How many pixels above `x` of a line, one after another, are like it.
    fn reach_up(&self, index: usize, x: usize) -> usize {
        self.reach(index, x, (0..index).rev())
    }

    /// The same below.
    fn reach_down(&self, index: usize, x: usize) -> usize {
        self.reach(index, x, index + 1..self.lines.len())
    }

    /// How many pixels of a column on a path, one after another, are like that of line
    /// `index`: less so is enough in the nearer half of the reach.
    #[inline]
    fn reach(&self, index: usize, x: usize, path: impl Iterator<Item = usize>) -> usize {
        let reach = self.parameters.reach_y_px;
        let near = usize::from(reach / 2);
        let rows = |index: usize| {
            let rows = self.lines.get(index).into_iter().flatten();
            rows.take(self.channels)
        };
        let level = |row: &[u8]| row.get(x).copied().unwrap_or(0);
        let mut own = [0; MAX_CHANNELS];
        for (own, row) in own.iter_mut().zip(rows(index)) {
            *own = level(row);
        }
        let mut count = 0;
        for other in path.take(reach.into()) {
            let step = if count < near {
                self.parameters.near_step
            } else {
                self.parameters.far_step
            };
            let differences = own.iter().zip(rows(other));
            let largest =
                differences.fold(0, |most, (own, row)| own.abs_diff(level(row)).max(most));
            if largest > step {
                break;
            }
            count += 1;
        }
        count
    }
}

/// A line of which to find how far the surface of each pixel reaches.
#[derive(Debug, Clone, Copy)]
pub struct ArmsRow<'a> {
    /// The line's channels.
    pub levels: [&'a [u8]; MAX_CHANNELS],
    /// Channels in use: 1 or 3.
    pub channels: usize,
    /// Largest reach, px, at most 127.
    pub reach: u8,
    /// Largest difference in any channel in the nearer half of the reach.
    pub near_step: u8,
    /// The same in the farther half.
    pub far_step: u8,
}

/// Bytes of scratch for lines of `width` pixels.
#[must_use]
pub const fn arms_scratch_bytes(width: usize) -> usize {
    4 * width
}

/// Writes how far each pixel's surface reaches: to the left in the low byte, to the right
/// in the high one. Inlined so that a caller may compile it for its own instruction set.
///
/// Distance by distance, all pixels at once: a pair of pixels that far apart is alike or
/// not, for both.
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
    // Where there is one channel, it stands for all.
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
        // The others end at the edge of the line.
    }
    for ((arms, &left), &right) in arms.iter_mut().zip(&*left).zip(&*right) {
        *arms = i16::from_le_bytes([left, right]);
    }
}
