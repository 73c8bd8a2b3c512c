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

/// Speckle removal over a ring of `2 reach_y + 1` rows.
///
/// A row takes at most `size_min` looks at a pixel and its neighbours for each of its
/// pixels; runs along the line that are long enough take none.
#[derive(Debug)]
pub struct Speckle<'m> {
    rows: RowRing<'m>,
    /// The pixels of a region that were found so far: line of the window, column.
    region: &'m mut [[u16; 2]],
    /// Their disparities: while a region is counted, its pixels have none in the ring.
    values: &'m mut [i16],
    width: usize,
    parameters: SpeckleParameters,
}

impl<'m> Speckle<'m> {
    /// Words of memory: `2 reach_y + 1` rows and 6 bytes per pixel of the largest speckle.
    #[must_use]
    pub const fn memory_words(width: usize, parameters: SpeckleParameters) -> usize {
        let size = parameters.size_min as usize;
        RowRing::memory_words(width, 0, 2 * parameters.reach_y_px as usize + 1)
            + words(size, size_of::<[u16; 2]>())
            + words(size, size_of::<i16>())
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
            values: arena.take(size)?,
            width,
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
        let mut starts = [0; MAX_LINES];
        for (start, row) in starts.iter_mut().zip(there.clone()) {
            *start = self.rows.row_start(row);
        }
        let starts = starts.get(..there.len()).unwrap_or_default();
        // Within the window.
        let centre = (line - there.start) as u16;
        let enough = usize::from(self.parameters.size_min);
        let mut rest = output;
        let mut column = 0;
        while !rest.is_empty() {
            let length = self.run_length(rest);
            let Some((run, after)) = rest.split_at_mut_checked(length.max(1)) else {
                break;
            };
            let is_short = length > 0 && length < enough;
            // Columns fit 16 bits, as the width does.
            if is_short && self.is_small(starts, [centre, column as u16]) {
                run.fill(INVALID);
            }
            column += run.len();
            rest = after;
        }
        Some(line)
    }

    /// Pixels from the first on that are one region along the line; 0 when the first has
    /// no disparity.
    fn run_length(&self, row: &[i16]) -> usize {
        if row.first().is_none_or(|&first| first == INVALID) {
            return 0;
        }
        let pairs = row.iter().zip(row.iter().skip(1));
        let connected = pairs.take_while(|&(&a, &b)| self.are_connected(a, b));
        1 + connected.count()
    }

    /// Whether neighbours, of which the first has a disparity, belong to one region.
    fn are_connected(&self, a: i16, b: i16) -> bool {
        b != INVALID && disparity(a).abs_diff(disparity(b)) <= self.parameters.step_q4.into()
    }

    /// Whether the region of a pixel that has a disparity is too small within the window.
    fn is_small(&mut self, starts: &[usize], place: [u16; 2]) -> bool {
        let enough = usize::from(self.parameters.size_min);
        let mut found = self.take(starts, place, 0);
        let mut next = 0;
        while next < found && found < enough {
            let (Some(&[line, column]), Some(&value)) =
                (self.region.get(next), self.values.get(next))
            else {
                break;
            };
            next += 1;
            for place in [
                [line, column.wrapping_sub(1)],
                [line, column + 1],
                [line.wrapping_sub(1), column],
                [line + 1, column],
            ] {
                let neighbour = self.at(starts, place).copied();
                if found < enough
                    && neighbour.is_some_and(|neighbour| self.are_connected(value, neighbour))
                {
                    found = self.take(starts, place, found);
                }
            }
        }
        for index in 0..found {
            let (Some(&place), Some(&value)) = (self.region.get(index), self.values.get(index))
            else {
                break;
            };
            if let Some(pixel) = self.at(starts, place) {
                *pixel = value;
            }
        }
        found < enough
    }

    /// Takes a pixel out of the ring into the region, that of `found` pixels so far; gives
    /// how many there are then.
    fn take(&mut self, starts: &[usize], place: [u16; 2], found: usize) -> usize {
        let Some(pixel) = self.at(starts, place) else {
            return found;
        };
        let value = core::mem::replace(pixel, INVALID);
        if let (Some(kept_place), Some(kept)) =
            (self.region.get_mut(found), self.values.get_mut(found))
        {
            (*kept_place, *kept) = (place, value);
        }
        found + 1
    }

    /// A pixel of the window; beyond the ends of a line and of the window there is none.
    fn at(&mut self, starts: &[usize], [line, column]: [u16; 2]) -> Option<&mut i16> {
        let start = starts.get(usize::from(line))?;
        let column = Some(usize::from(column)).filter(|&column| column < self.width)?;
        self.rows.values_mut().get_mut(start + column)
    }
}

/// A disparity that holds or is in doubt, 1/16 px.
fn disparity(value: i16) -> i16 {
    if value < 0 { !value } else { value }
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
