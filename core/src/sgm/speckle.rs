//! Speckle removal: small regions of disparity are rejected.
//!
//! Neighbours above, below, left and right belong to one region when both have a disparity,
//! in doubt or not, and the two differ little. A pixel is a speckle when its region has too
//! few pixels within the lines of a window around the pixel's own line.

use super::surroundings::Surroundings;
use crate::config::SpeckleParameters;
use crate::rows::{Arena, Found, OutOfMemory, Part, RowStage, RowWindow, copy_common, words};

/// Largest number of lines of a window.
const MAX_LINES: usize = 31;

/// A run: neighbours along a line that belong to one region, as line of the window, first column
/// and number of pixels. Counting may stop as soon as a run is long enough.
type Run = [u16; 3];

/// Speckle removal over a ring of `2 reach_y + 1` rows.
///
/// A region is followed from run to run until it is known to be large enough: from each of
/// its fewer than `size_min` pixels to those above and below. Runs that are long enough are
/// not followed at all.
///
/// The [`RowStage`] takes rows of stored values of [`Found`]; speckles come out without a
/// disparity and lose their confidence. What has no disparity has no confidence.
#[derive(Debug)]
pub(super) struct Speckle<'m> {
    window: RowWindow<'m>,
    /// The runs of a region that were found so far.
    region: &'m mut [Run],
    parameters: SpeckleParameters,
}

impl<'m> Speckle<'m> {
    /// Demand of the stage: `2 reach_y + 1` rows, 6 bytes per pixel of the largest speckle, and
    /// `reach_y` lines of latency.
    pub(super) const fn part(width: usize, parameters: &SpeckleParameters) -> Part {
        Part {
            name: "speckle removal",
            words: RowWindow::words(width, 0, parameters.reach_y_px)
                + words(parameters.size_min as usize, size_of::<Run>()),
            look_back_lines: 0,
            latency_lines: parameters.reach_y_px as u32,
        }
    }

    /// A stage for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has less left than [`Speckle::part`] says.
    pub(super) fn new(
        width: usize,
        parameters: SpeckleParameters,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        Ok(Self {
            window: RowWindow::new(width, 0, parameters.reach_y_px, arena)?,
            region: arena.take(usize::from(parameters.size_min))?,
            parameters,
        })
    }

    /// Whether there is memory for regions of fewer than `size_min` pixels.
    pub(super) fn has_room_for(&self, size_min: u8) -> bool {
        usize::from(size_min) <= self.region.len()
    }

    /// Takes other bounds of speckles, for which there is room; the reach stays.
    pub(super) fn set_bounds(&mut self, size_min: u8, step_q4: u8) {
        self.parameters.size_min = size_min;
        self.parameters.step_q4 = step_q4;
    }

    /// Copies row `line`, if there is such a row, to `output` without its speckles; returns whether
    /// there is.
    fn remove(
        &mut self,
        line: Option<u32>,
        output: &mut [i16],
        around: &mut Surroundings<'_, '_, '_>,
    ) -> bool {
        let Some(line) = line else { return false };
        copy_common(output, self.window.rows.row(line));
        let there = self.window.around(line);
        // The lines of the window, looked up once per row.
        let mut lines = [&[][..]; MAX_LINES];
        for (values, row) in lines.iter_mut().zip(there.clone()) {
            *values = self.window.rows.row(row);
        }
        let enough = usize::from(self.parameters.size_min);
        let mut search = Search {
            lines: lines.get(..there.len()).unwrap_or_default(),
            region: self.region,
            found: 0,
            pixels: 0,
            enough,
            step_q4: self.parameters.step_q4.into(),
        };
        // Within the window.
        let centre = (line - there.start) as u16;
        let confidences = around.confidences.row_mut(line);
        let mut rest = &mut *output;
        let mut column = 0;
        while !rest.is_empty() {
            let gap = rest
                .iter()
                .take_while(|&&found| !Found::of(found).is_found());
            let gap = gap.count();
            let from = rest.get_mut(gap..).unwrap_or_default();
            column += gap;
            let length = search.run_length(from.iter());
            let Some((run, after)) = from.split_at_mut_checked(length) else {
                break;
            };
            if length < enough && search.is_small(centre, column, length) {
                run.fill(Found::NOT_FOUND.stored());
                if let Some(confidences) = confidences.get_mut(column..column + length) {
                    confidences.fill(0);
                }
            }
            column += run.len();
            rest = after;
        }
        true
    }
}

impl RowStage<Surroundings<'_, '_, '_>> for Speckle<'_> {
    fn reset(&mut self) {
        self.window.clear();
    }

    fn push(&mut self, row: &mut [i16], around: &mut Surroundings<'_, '_, '_>) -> bool {
        let due = self.window.push(row);
        self.remove(due, row, around)
    }

    fn flush(&mut self, row: &mut [i16], around: &mut Surroundings<'_, '_, '_>) -> bool {
        let next = self.window.flush();
        self.remove(next, row, around)
    }
}

/// The search for the region of a run.
struct Search<'a> {
    /// The lines of the window.
    lines: &'a [&'a [i16]],
    /// The region's runs that were found so far.
    region: &'a mut [Run],
    /// Number of these runs.
    found: usize,
    /// Number of their pixels.
    pixels: usize,
    /// Number of pixels of a region that is large enough.
    enough: usize,
    /// Largest difference between neighbours of one region, 1/16 px.
    step_q4: i32,
}

impl Search<'_> {
    /// Number of pixels, from the first on, that belong to one region along the line; 0 when the
    /// first has no disparity.
    #[inline(always)]
    fn run_length<'v>(&self, mut values: impl Iterator<Item = &'v i16>) -> usize {
        let Some(&first) = values.next().filter(|&&first| Found::of(first).is_found()) else {
            return 0;
        };
        let mut before = disparity(first);
        let connected = values.take_while(|&&value| {
            let value = disparity(value);
            let is_connected = self.are_connected(before, value);
            before = value;
            is_connected
        });
        1 + connected.count()
    }

    /// Whether neighbours, one of which has a disparity, belong to one region.
    #[inline(always)]
    fn are_connected(&self, a: i32, b: i32) -> bool {
        (a - b + self.step_q4).cast_unsigned() <= 2 * self.step_q4.cast_unsigned()
    }

    /// Whether the region of a run is too small within the window.
    fn is_small(&mut self, line: u16, start: usize, length: usize) -> bool {
        (self.found, self.pixels) = (0, 0);
        self.take(line, start, length);
        let mut next = 0;
        while next < self.found
            && self.pixels < self.enough
            && let Some(&run) = self.region.get(next)
        {
            next += 1;
            self.follow(run, run[0].wrapping_sub(1));
            self.follow(run, run[0] + 1);
        }
        self.pixels < self.enough
    }

    /// Adds the runs of `line` that neighbour a run and belong to its region.
    fn follow(&mut self, [own, start, length]: Run, line: u16) {
        let own = self.lines.get(usize::from(own));
        let (Some(own), Some(beside)) = (own, self.lines.get(usize::from(line))) else {
            return;
        };
        let mut column = usize::from(start);
        let end = column + usize::from(length);
        while column < end && self.pixels < self.enough {
            let Some((up_to, from)) = beside.split_at_checked(column) else {
                return;
            };
            let (Some(&value), Some(&neighbour)) = (own.get(column), from.first()) else {
                return;
            };
            column += 1;
            if self.are_connected(disparity(value), disparity(neighbour)) {
                // Counting stops when there are enough.
                let after = self.run_length(from.iter().take(self.enough));
                let before = core::iter::once(&neighbour).chain(up_to.iter().rev());
                let before = self.run_length(before.take(self.enough)) - 1;
                self.take(line, column - 1 - before, before + after);
                column += after - 1;
            }
        }
    }

    /// Adds a run to the region, unless it is there already.
    fn take(&mut self, line: u16, start: usize, length: usize) {
        // Columns fit 16 bits, as the width does.
        let run = [line, start as u16, length as u16];
        let there = self.region.get(..self.found).unwrap_or_default();
        if there.contains(&run) {
            return;
        }
        if let Some(slot) = self.region.get_mut(self.found) {
            *slot = run;
        }
        self.found += 1;
        self.pixels += length;
    }
}

/// The disparity of a stored value, in doubt or not, plus one, 1/16 px; if there is none, a number that is
/// far from all disparities.
#[inline(always)]
fn disparity(stored: i16) -> i32 {
    // None is the largest number, which becomes the smallest.
    Found::of(stored).index_q4().wrapping_add(1).into()
}

#[cfg(test)]
mod tests {
    use std::string::String;
    use std::vec;
    use std::vec::Vec;

    use super::*;
    use crate::disparity::INVALID;
    use crate::rows::Ring;

    const WIDTH: usize = 8;

    /// Streams a picture, px as digits, through the stage.
    fn cleaned(picture: &[&str], parameters: SpeckleParameters) -> Vec<String> {
        let digit = |&found: &i16| match found {
            INVALID => '.',
            found => char::from(b'0' + (found / 16) as u8),
        };
        let mut memory = vec![u32::MAX; Speckle::part(WIDTH, &parameters).words];
        let mut speckle = Speckle::new(WIDTH, parameters, &mut Arena::new(&mut memory)).unwrap();
        let depth = 2 * usize::from(parameters.reach_y_px) + 1;
        let mut memory = vec![0; Ring::<u8>::words(WIDTH, 0, depth)];
        let mut confidences = Ring::new(WIDTH, 0, depth, 0, &mut Arena::new(&mut memory)).unwrap();
        let mut done = 0;
        let mut output = vec![];
        let mut row = [INVALID; WIDTH];
        for line in picture {
            for (found, digit) in row.iter_mut().zip(line.bytes()) {
                *found = match digit {
                    b'.' => INVALID,
                    digit => i16::from(digit - b'0') * 16,
                };
            }
            for (confidence, &found) in confidences.push().iter_mut().zip(&row) {
                *confidence = if found == INVALID { 0 } else { 9 };
            }
            let around = &mut Surroundings {
                channels: &[],
                first_line: 0,
                confidences: &mut confidences,
            };
            if speckle.push(&mut row, around) {
                output.push(row.iter().map(digit).collect());
                // A speckle loses its confidence with its disparity.
                let kept = row.map(|found| if found == INVALID { 0 } else { 9 });
                assert_eq!(confidences.row(done), kept);
                done += 1;
            }
        }
        let around = &mut Surroundings {
            channels: &[],
            first_line: 0,
            confidences: &mut confidences,
        };
        while speckle.flush(&mut row, around) {
            output.push(row.iter().map(digit).collect());
        }
        output
    }

    #[test]
    fn small_regions_within_the_window_are_rejected() {
        let parameters = SpeckleParameters {
            size_min: 4,
            step_q4: 16,
            reach_y_px: 1,
        };
        // Neighbours that differ by 1 belong together, those that differ by 2 do not; diagonal
        // neighbours do not.
        assert_eq!(
            cleaned(
                &["1123.5..", ".....55.", "9.9.9...", "99..999."],
                parameters
            ),
            ["1123....", "........", "....9...", "....999."]
        );
        // A column is seen over no more than three lines.
        assert_eq!(
            cleaned(&["7.......", "7.......", "7......."], parameters),
            ["........"; 3]
        );
        let taller = SpeckleParameters {
            reach_y_px: 3,
            ..parameters
        };
        let column = ["7......."; 4];
        assert_eq!(cleaned(&column, taller), column);
        let off = SpeckleParameters {
            size_min: 0,
            ..parameters
        };
        assert_eq!(cleaned(&["1.3.5.7."], off), ["1.3.5.7."]);
    }
}
