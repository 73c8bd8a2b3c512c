//! Cross-based region vote: a pixel that was rejected or is in doubt takes the most frequent
//! disparity of its region.
//!
//! The region is the cross of similar colour around the pixel: up and down from it, and left and
//! right from each pixel of that column (Zhang, Lu and Lafruit 2009; Mei et al. 2011). A quarter of its
//! pixels have a vote: see [`Voters`]. The vote is one pass in place, from the top left: a
//! pixel that has taken a disparity votes for those after it.

use super::surroundings::Surroundings;
use crate::config::{RegionVoteParameters, Voters};
use crate::disparity::{DisparityRange, STEPS_PER_PX};
use crate::kernel::{ArmsRow, Kernels, MAX_CHANNELS, arms_scratch_bytes};
use crate::rows::{Arena, Found, OutOfMemory, Part, Ring, RowStage, RowWindow, copy_common, words};

/// Largest number of lines of a window.
const MAX_LINES: usize = 31;

/// The vote over a ring of `2 reach_y + 1` rows, of stored values of [`Found`].
#[derive(Debug)]
pub(super) struct RegionVote<'m, K> {
    kernels: K,
    window: RowWindow<'m>,
    /// Arms of each pixel along its line: see [`arms_row`](crate::kernel::arms_row).
    arms: Ring<'m, i16>,
    arms_scratch: &'m mut [u8],
    /// Number of votes per disparity, px. A window of 255 columns and [`MAX_LINES`] has fewer
    /// pixels than 16 bits count.
    votes: &'m mut [i16],
    parameters: RegionVoteParameters,
}

impl RegionVote<'_, ()> {
    /// Demand of the vote: `4 y + 2` rows, four of bytes, and a counter per disparity. It reads
    /// back over its window of `2 y + 1` lines, and has a latency of `y` lines.
    pub(super) const fn part(
        width: usize,
        disparities: DisparityRange,
        parameters: &RegionVoteParameters,
    ) -> Part {
        let reach = parameters.reach_y_px as u32;
        Part {
            name: "region vote",
            words: RowWindow::words(width, 0, parameters.reach_y_px)
                + Ring::<i16>::words(width, 0, 2 * reach as usize + 1)
                + words(arms_scratch_bytes(width), 1)
                + words(disparities.count as usize + 1, size_of::<i16>()),
            look_back_lines: 2 * reach,
            latency_lines: reach,
        }
    }
}

impl<'m, K: Kernels> RegionVote<'m, K> {
    /// A vote for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has less left than [`RegionVote::part`] says.
    pub(super) fn new(
        width: usize,
        disparities: DisparityRange,
        parameters: RegionVoteParameters,
        kernels: K,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let depth = 2 * usize::from(parameters.reach_y_px) + 1;
        Ok(Self {
            kernels,
            window: RowWindow::new(width, 0, parameters.reach_y_px, arena)?,
            arms: Ring::new(width, 0, depth, 0, arena)?,
            arms_scratch: arena.take(arms_scratch_bytes(width))?,
            // The last place is for pixels without a disparity.
            votes: arena.take(usize::from(disparities.count) + 1)?,
            parameters,
        })
    }

    /// Measures the arms of the row that comes next.
    fn measure_arms(&mut self, around: &Surroundings<'_, '_, '_>) {
        let image_line = around.first_line + self.arms.rows_in();
        let mut levels = [&[][..]; MAX_CHANNELS];
        for (levels, channel) in levels.iter_mut().zip(around.channels) {
            *levels = channel.row(image_line);
        }
        let arms = ArmsRow {
            levels,
            channels: K::SCOPE.channels(around.channels.len()).min(MAX_CHANNELS),
            reach: self.parameters.reach_x_px,
            near_step: self.parameters.near_step,
            far_step: self.parameters.far_step,
        };
        self.kernels
            .arms_row(&arms, self.arms_scratch, self.arms.push());
    }

    /// Performs the vote for row `line`, if there is such a row, and copies the row to `output`;
    /// returns whether there is.
    fn vote(
        &mut self,
        line: Option<u32>,
        output: &mut [i16],
        around: &Surroundings<'_, '_, '_>,
    ) -> bool {
        let Some(line) = line else { return false };
        self.vote_row(line, around);
        copy_common(output, self.window.rows.row(line));
        true
    }

    /// Performs the vote for each pixel of a row whose disparity does not hold.
    // In one place for rows that come and rows that are flushed, as it is large.
    #[inline(never)]
    fn vote_row(&mut self, line: u32, around: &Surroundings<'_, '_, '_>) {
        let channels = around.channels;
        let there = self.window.around(line);
        // The lines of the window, looked up once per row.
        let mut lines = [[&[][..]; MAX_CHANNELS]; MAX_LINES];
        // Rows and arms have the same places in their rings.
        let mut starts = [0; MAX_LINES];
        for ((lines, start), row) in lines.iter_mut().zip(&mut starts).zip(there.clone()) {
            *start = self.window.rows.start(row);
            for (levels, channel) in lines.iter_mut().zip(channels) {
                *levels = channel.row(around.first_line + row);
            }
        }
        let centre = (line - there.start) as usize;
        let window = Window {
            lines: lines.get(..there.len()).unwrap_or_default(),
            channels: K::SCOPE.channels(channels.len()).min(MAX_CHANNELS),
            parameters: &self.parameters,
        };
        // The columns before the first pixel that holds are left to the border.
        let mut own = self.window.rows.row(line).iter();
        let first = own.position(|&found| Found::of(found).holds());
        let mut x = first.unwrap_or(usize::MAX);
        let own_start = self.window.rows.start(line);
        let doubtful = |&found: &i16| !Found::of(found).holds();
        while let Some(rest) = self.window.rows.row(line).get(x..)
            && let Some(ahead) = rest.iter().position(doubtful)
        {
            x += ahead;
            self.votes.fill(0);
            let above = window.reach_up(centre, x);
            let below = window.reach_down(centre, x);
            let region = starts.get(centre - above..=centre + below);
            let region = region.unwrap_or_default();
            let (rows, arms) = (self.window.rows.values(), self.arms.values());
            // The run of the region along a line, given the line's start in the rings.
            let run = |start: usize| {
                let at = start + x;
                let arms = arms.get(at).copied().unwrap_or(0);
                // Within the row.
                let [left, right] = arms.to_le_bytes().map(usize::from);
                rows.get(at - left..=at + right).unwrap_or_default()
            };
            let mut total = 0;
            match self.parameters.voters {
                Voters::OtherLines => {
                    // The pixel's own line is among them.
                    for &start in region.iter().skip(above % 2).step_by(2) {
                        total += count_votes::<2>(run(start), self.votes);
                    }
                }
                Voters::EveryLine => {
                    // Staggered from line to line.
                    let mut is_odd = (line as usize - above) % 2 == 1;
                    for &start in region {
                        let run = run(start);
                        let later = run.get(2..).filter(|run| is_odd && !run.is_empty());
                        total += count_votes::<4>(later.unwrap_or(run), self.votes);
                        is_odd = !is_odd;
                    }
                }
            }
            if let Some(elected_q4) = self.elect(total)
                && let Some(pixel) = self.window.rows.values_mut().get_mut(own_start + x)
            {
                *pixel = elected_q4;
            }
            x += 1;
        }
    }

    /// The disparity that wins with `total` votes cast, counted from the lowest, 1/16 px; `None` if
    /// none has enough votes.
    fn elect(&self, total: usize) -> Option<i16> {
        let (&none, votes) = self.votes.split_last()?;
        let total = total - usize::from(none.cast_unsigned());
        if total <= usize::from(self.parameters.support_min) {
            return None;
        }
        // A reduction, which is vectorised if the target has vectors.
        let most = votes.iter().fold(0, |a, &b| a.max(b));
        let share_min = usize::from(self.parameters.share_min_percent);
        if usize::from(most.cast_unsigned()) * 100 <= total * share_min {
            return None;
        }
        let first = votes.iter().position(|&votes| votes == most)?;
        // Within the range, and so within 1/16 px.
        Some(first as i16 * STEPS_PER_PX)
    }
}

impl<K: Kernels> RowStage<Surroundings<'_, '_, '_>> for RegionVote<'_, K> {
    const IS_IN_SCOPE: bool = K::SCOPE.region_vote;

    fn reset(&mut self) {
        self.window.clear();
        self.arms.clear();
    }

    fn push(&mut self, row: &mut [i16], around: &mut Surroundings<'_, '_, '_>) -> bool {
        self.measure_arms(around);
        let due = self.window.push(row);
        self.vote(due, row, around)
    }

    fn flush(&mut self, row: &mut [i16], around: &mut Surroundings<'_, '_, '_>) -> bool {
        let next = self.window.flush();
        self.vote(next, row, around)
    }
}

/// Counts the votes of every `STEP`th pixel of a run, for its disparity rounded to px; pixels whose
/// disparity does not hold are counted in the last place. Returns the number of votes cast.
#[inline(always)]
fn count_votes<const STEP: usize>(run_q4: &[i16], votes: &mut [i16]) -> usize {
    let Some(last) = votes.len().checked_sub(1) else {
        return 0;
    };
    for &found_q4 in run_q4.iter().step_by(STEP) {
        // Negative where rejected or in doubt, and then beyond every disparity.
        let rounded_px = (usize::from(found_q4.cast_unsigned()) + 8) >> 4;
        if let Some(votes) = votes.get_mut(rounded_px.min(last)) {
            *votes += 1;
        }
    }
    run_q4.len().div_ceil(STEP)
}

/// The lines around a row, over which vertical arms are measured.
struct Window<'a> {
    lines: &'a [[&'a [u8]; MAX_CHANNELS]],
    channels: usize,
    parameters: &'a RegionVoteParameters,
}

impl Window<'_> {
    /// Length of the arm upwards from column `x` of line `index`, lines.
    fn reach_up(&self, index: usize, x: usize) -> usize {
        let above = self.lines.get(..index).unwrap_or_default();
        self.reach(index, x, above.iter().rev())
    }

    /// Length of the arm downwards from column `x` of line `index`, lines.
    fn reach_down(&self, index: usize, x: usize) -> usize {
        let below = self.lines.get(index + 1..).unwrap_or_default();
        self.reach(index, x, below.iter())
    }

    /// Number of successive lines of `path` whose pixel in column `x` is similar to that of line
    /// `index`. The largest difference is `near_step` in the nearer half of the reach, `far_step`
    /// beyond.
    #[inline]
    fn reach<'l>(
        &self,
        index: usize,
        x: usize,
        path: impl Iterator<Item = &'l [&'l [u8]; MAX_CHANNELS]>,
    ) -> usize {
        if self.channels == 1 {
            self.reach_in::<1>(index, x, path)
        } else {
            self.reach_in::<MAX_CHANNELS>(index, x, path)
        }
    }

    /// [`Window::reach`], of lines of `CHANNELS` channels.
    #[inline(always)]
    fn reach_in<'l, const CHANNELS: usize>(
        &self,
        index: usize,
        x: usize,
        path: impl Iterator<Item = &'l [&'l [u8]; MAX_CHANNELS]>,
    ) -> usize {
        let parameters = self.parameters;
        let reach = usize::from(parameters.reach_y_px);
        let near = reach / 2;
        let levels = |rows: &[&[u8]; MAX_CHANNELS]| -> [u8; CHANNELS] {
            core::array::from_fn(|channel| {
                let row = rows.get(channel);
                row.and_then(|row| row.get(x)).copied().unwrap_or(0)
            })
        };
        let own = self.lines.get(index).map_or([0; CHANNELS], levels);
        let mut count = 0;
        for other in path.take(reach) {
            let step = if count < near {
                parameters.near_step
            } else {
                parameters.far_step
            };
            let pairs = own.iter().zip(levels(other));
            let largest = pairs.fold(0, |most, (own, other)| own.abs_diff(other).max(most));
            if largest > step {
                break;
            }
            count += 1;
        }
        count
    }
}
