//! Speckle removal: disparities that hardly any neighbour shares are rejected.
//!
//! Neighbours above, below, left and right belong to one region when both have a disparity,
//! in doubt or not, and these differ little. A pixel is a speckle when its region has too
//! few pixels within the lines of a window around the pixel's own line.

use super::ring::RowRing;
use crate::config::SpeckleParameters;
use crate::disparity::INVALID;
use crate::memory::{Arena, OutOfMemory, words};

/// Most lines of a window.
const MAX_LINES: usize = 31;

/// A run, neighbours along a line that are one region: line of the window, first column and
/// number of pixels; of one that is long enough not necessarily all.
type Run = [u16; 3];

/// Speckle removal over a ring of `2 reach_y + 1` rows.
///
/// A region is followed from run to run until it is known to be large enough: from each of
/// its fewer than `size_min` pixels to those above and below. Runs that are long enough are
/// not followed at all.
#[derive(Debug)]
pub struct Speckle<'m> {
    rows: RowRing<'m>,
    /// The runs of a region that were found so far.
    region: &'m mut [Run],
    parameters: SpeckleParameters,
}

impl<'m> Speckle<'m> {
    /// Words of memory: `2 reach_y + 1` rows and 6 bytes per pixel of the largest speckle.
    #[must_use]
    pub const fn memory_words(width: usize, parameters: SpeckleParameters) -> usize {
        let size = parameters.size_min as usize;
        RowRing::memory_words(width, 0, 2 * parameters.reach_y_px as usize + 1)
            + words(size, size_of::<Run>())
    }

    /// A stage for rows of `width` pixels.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has fewer than [`Speckle::memory_words`] left.
    pub fn new(
        width: usize,
        parameters: SpeckleParameters,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let depth = 2 * usize::from(parameters.reach_y_px) + 1;
        let size = usize::from(parameters.size_min);
        Ok(Self {
            rows: RowRing::new(width, 0, depth, parameters.reach_y_px, INVALID, arena)?,
            region: arena.take(size)?,
            parameters,
        })
    }

    /// Forgets the frame.
    pub fn reset(&mut self) {
        self.rows.reset();
    }

    /// Takes a row as [`RowCheck::write`](crate::aggregation::RowCheck::write) gives it.
    /// When this completes one, puts that in its place, speckles [`INVALID`], and gives its
    /// number, from 0.
    pub fn push(&mut self, row: &mut [i16]) -> Option<u32> {
        let line = self.rows.push(row);
        self.remove(line, row)
    }

    /// After the last row: completes the next of the rows still to come; `None` when there
    /// are no more.
    pub fn flush(&mut self, row: &mut [i16]) -> Option<u32> {
        let line = self.rows.flush();
        self.remove(line, row)
    }

    fn remove(&mut self, line: Option<u32>, output: &mut [i16]) -> Option<u32> {
        let line = line?;
        for (output, &row) in output.iter_mut().zip(self.rows.row(line)) {
            *output = row;
        }
        let there = self.rows.around(line, self.parameters.reach_y_px);
        // The lines of the window, looked up once per row.
        let mut lines = [&[][..]; MAX_LINES];
        for (values, row) in lines.iter_mut().zip(there.clone()) {
            *values = self.rows.row(row);
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
        let mut rest = output;
        let mut column = 0;
        while !rest.is_empty() {
            let length = search.run_length(rest.iter());
            let Some((run, after)) = rest.split_at_mut_checked(length.max(1)) else {
                break;
            };
            let is_short = length > 0 && length < enough;
            if is_short && search.is_small(centre, column, length) {
                run.fill(INVALID);
            }
            column += run.len();
            rest = after;
        }
        Some(line)
    }
}

/// The search for the region of a run.
struct Search<'a> {
    /// The lines of the window.
    lines: &'a [&'a [i16]],
    /// The region's runs that were found so far, `found` of them with `pixels` in all.
    region: &'a mut [Run],
    found: usize,
    pixels: usize,
    /// Pixels that are enough.
    enough: usize,
    step_q4: i32,
}

impl Search<'_> {
    /// Pixels from the first on that are one region along the line; 0 when the first has
    /// no disparity.
    #[inline(always)]
    fn run_length<'v>(&self, mut values: impl Iterator<Item = &'v i16>) -> usize {
        let Some(&first) = values.next().filter(|&&first| first != INVALID) else {
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

    /// Takes the runs of a line beside a run that belong to one region with it.
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
                // No more than is enough.
                let after = self.run_length(from.iter().take(self.enough));
                let before = core::iter::once(&neighbour).chain(up_to.iter().rev());
                let before = self.run_length(before.take(self.enough)) - 1;
                self.take(line, column - 1 - before, before + after);
                column += after - 1;
            }
        }
    }

    /// Takes a run into the region, unless it is there already.
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

/// A disparity that holds or is in doubt, 1/16 px; where there is none, one that is far from
/// all others.
#[inline(always)]
fn disparity(value: i16) -> i32 {
    let value = i32::from(value);
    if value == INVALID.into() {
        1 << 20
    } else {
        value ^ (value >> 31)
    }
}

#[cfg(test)]
mod tests {
    use std::string::String;
    use std::vec;
    use std::vec::Vec;

    use super::*;

    const WIDTH: usize = 8;

    /// Streams a picture, px as digits, through the stage.
    fn cleaned(picture: &[&str], parameters: SpeckleParameters) -> Vec<String> {
        let digit = |&found: &i16| match found {
            INVALID => '.',
            found => char::from(b'0' + (found / 16) as u8),
        };
        let mut memory = vec![u32::MAX; Speckle::memory_words(WIDTH, parameters)];
        let mut speckle = Speckle::new(WIDTH, parameters, &mut Arena::new(&mut memory)).unwrap();
        let mut output = vec![];
        let mut row = [INVALID; WIDTH];
        for line in picture {
            for (found, digit) in row.iter_mut().zip(line.bytes()) {
                *found = match digit {
                    b'.' => INVALID,
                    digit => i16::from(digit - b'0') * 16,
                };
            }
            if speckle.push(&mut row).is_some() {
                output.push(row.iter().map(digit).collect());
            }
        }
        while speckle.flush(&mut row).is_some() {
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
        // A step of one joins, one of two does not; corners do not join.
        assert_eq!(
            cleaned(
                &["1123.5..", ".....55.", "9.9.9...", "99..999."],
                parameters
            ),
            ["1123....", "........", "....9...", "....999."]
        );
        // Of a column, no more than three lines are seen.
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
