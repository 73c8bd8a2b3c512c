//! The rectifier: raw lines of two cameras in, rectified lines out.

use core::fmt;
use core::ops::Range;

use super::rectification::{Rectification, ViewMap};
use crate::kernel::{Interpolation, Kernels, MAX_CHANNELS, Portable, ResampleRow};
use crate::rows::{Arena, Line, OutOfMemory, Ring, words};

/// A pair of raw lines was refused; the rectifier is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RawLineError {
    /// A line does not have the width of the raw views.
    Width,
    /// A line has no colour, though the rectifier was built for colour.
    Colour,
    /// The frame has all its lines already.
    TooManyLines,
    /// A rectified pair that is ready was not taken: take pairs until there are none.
    NotTaken,
}

impl fmt::Display for RawLineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Width => "the raw line does not have the width that the rectification is for",
            Self::Colour => "the raw line has no colour, which the rectifier was built for",
            Self::TooManyLines => "the raw frame has more lines than the rectification is for",
            Self::NotTaken => "a rectified pair that is ready was not taken",
        })
    }
}

impl core::error::Error for RawLineError {}

/// Rectifies a stream of pairs of raw lines in bounded memory.
///
/// Raw lines go in from the top. A rectified pair is ready as soon as the raw lines that it is
/// interpolated from have come: after a raw pair, none, one or several. The last is ready with
/// the last raw pair of a frame at the latest.
#[derive(Debug)]
pub struct Rectifier<'m, 'r, K = Portable> {
    kernels: K,
    rectification: Rectification<'r>,
    views: [RawView<'m>; 2],
    /// Number of raw pairs taken of this frame.
    lines_in: u16,
    /// The next rectified pair.
    next_line: u16,
    /// Number of raw pairs with which that is complete; kept, as it takes a walk along the line.
    next_complete: u16,
}

/// The newest raw lines of one camera, and the positions of the row that is resampled from them.
#[derive(Debug)]
struct RawView<'m> {
    grey: Ring<'m, u8>,
    /// Empty without colour.
    colour: [Ring<'m, u8>; MAX_CHANNELS],
    /// Where the lines from `first_line` on begin in the rings.
    starts: &'m mut [u32],
    first_line: u16,
    knots: &'m mut [[i32; 2]],
    step_shift: u32,
    interpolation: Interpolation,
}

impl<'m> RawView<'m> {
    const fn words(map: &ViewMap<'_>, raw_width: u16, colour: bool) -> usize {
        let lines = map.kept_lines as usize;
        let channels = if colour { 1 + MAX_CHANNELS } else { 1 };
        channels * Ring::<u8>::words(raw_width as usize, 0, lines)
            + words(lines, size_of::<u32>())
            + words(map.knots_per_row(), size_of::<[i32; 2]>())
    }

    fn new(
        map: &ViewMap<'_>,
        raw_width: u16,
        colour: bool,
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let (width, lines) = (usize::from(raw_width), usize::from(map.kept_lines));
        let mut ring = |lines| Ring::new(width, 0, lines, 0, arena);
        let (grey, coloured) = (ring(lines)?, if colour { lines } else { 0 });
        let colour = [ring(coloured)?, ring(coloured)?, ring(coloured)?];
        Ok(Self {
            grey,
            colour,
            starts: arena.take(lines)?,
            first_line: 0,
            knots: arena.take(map.knots_per_row())?,
            step_shift: map.step_shift(),
            interpolation: map.interpolation(),
        })
    }

    fn has_colour(&self) -> bool {
        self.colour.iter().any(|ring| ring.depth() > 0)
    }

    fn push(&mut self, line: &(impl Line + ?Sized)) {
        line.write_grey(self.grey.push());
        if self.has_colour() {
            for (channel, ring) in self.colour.iter_mut().enumerate() {
                line.write_channel(channel, ring.push());
            }
        }
    }

    fn clear(&mut self) {
        self.grey.clear();
        for ring in &mut self.colour {
            ring.clear();
        }
    }

    /// Looks up where line `y` of the rectified view lies in the lines that are kept.
    fn locate(&mut self, map: &ViewMap<'_>, y: u16) {
        for (column, knot) in self.knots.iter_mut().enumerate() {
            *knot = map.knot(column, y);
        }
        let end = self.grey.rows_in();
        let kept = u32::try_from(self.starts.len()).unwrap_or(end).min(end);
        let first = end - kept;
        for (start, place) in self.starts.iter_mut().zip(self.grey.starts(first..end)) {
            // A ring in lent memory is far smaller than 2^32.
            *start = place as u32;
        }
        // Frames have at most 2^12 lines.
        self.first_line = first as u16;
    }

    fn resample(&self, ring: &Ring<'_, u8>, kernels: &impl Kernels, output: &mut [u8]) {
        let kept = self.grey.rows_in() as usize;
        let row = ResampleRow {
            levels: ring.values(),
            starts: self.starts.get(..kept).unwrap_or(self.starts),
            first_line: self.first_line,
            width: ring.width(),
            knots: self.knots,
            step_shift: self.step_shift,
            interpolation: self.interpolation,
        };
        kernels.resample_row(&row, output);
    }
}

impl Rectifier<'_, '_> {
    /// Words of 32 bits that [`Rectifier::new`] takes: the raw lines to keep, and for each view the
    /// positions of a row.
    #[must_use]
    pub const fn words(rectification: &Rectification<'_>, colour: bool) -> usize {
        let raw_width = rectification.raw_width;
        RawView::words(&rectification.left, raw_width, colour)
            + RawView::words(&rectification.right, raw_width, colour)
    }
}

impl<'m, 'r, K: Kernels> Rectifier<'m, 'r, K> {
    /// Builds a rectifier in lent memory of at least [`Rectifier::words`]. With `colour`, red, green
    /// and blue are rectified besides grey.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the memory is too small.
    pub fn new(
        rectification: Rectification<'r>,
        colour: bool,
        kernels: K,
        memory: &'m mut [u32],
    ) -> Result<Self, OutOfMemory> {
        let mut arena = Arena::new(memory);
        let mut view = |map| RawView::new(map, rectification.raw_width, colour, &mut arena);
        Ok(Self {
            kernels,
            views: [view(&rectification.left)?, view(&rectification.right)?],
            next_complete: rectification.lines_until(0),
            rectification,
            lines_in: 0,
            next_line: 0,
        })
    }

    /// The rectification.
    #[must_use]
    pub fn rectification(&self) -> &Rectification<'r> {
        &self.rectification
    }

    /// Takes the next pair of raw lines of the frame. Afterwards, take the rectified pairs that are
    /// ready with [`Rectifier::next_pair`].
    ///
    /// # Errors
    /// [`RawLineError`]; the rectifier is then unchanged.
    pub fn push(
        &mut self,
        left: &(impl Line + ?Sized),
        right: &(impl Line + ?Sized),
    ) -> Result<(), RawLineError> {
        let width = usize::from(self.rectification.raw_width);
        if left.width() != width || right.width() != width {
            return Err(RawLineError::Width);
        }
        let [view, _] = &self.views;
        if view.has_colour() && !(left.has_colour() && right.has_colour()) {
            return Err(RawLineError::Colour);
        }
        if self.lines_in >= self.rectification.raw_height {
            return Err(RawLineError::TooManyLines);
        }
        if self.is_ready() {
            return Err(RawLineError::NotTaken);
        }
        let [left_view, right_view] = &mut self.views;
        left_view.push(left);
        right_view.push(right);
        self.lines_in += 1;
        Ok(())
    }

    /// Returns the next rectified pair, from the top, left and right, if the raw lines that it
    /// needs have come.
    pub fn next_pair(&mut self) -> Option<[RectifiedLine<'_, K>; 2]> {
        if !self.is_ready() {
            return None;
        }
        let y = self.next_line;
        self.go_to(y + 1);
        let [left, right] = &mut self.views;
        left.locate(&self.rectification.left, y);
        right.locate(&self.rectification.right, y);
        let width = usize::from(self.rectification.width);
        let kernels = self.kernels;
        let line = |view, map: &ViewMap<'_>| RectifiedLine {
            kernels,
            view,
            line: y,
            width,
            valid: map.valid_columns(y),
        };
        let Rectification {
            left: left_map,
            right: right_map,
            ..
        } = &self.rectification;
        Some([line(left, left_map), line(right, right_map)])
    }

    /// Forgets the frame: the next raw pair is its first.
    pub fn reset(&mut self) {
        for view in &mut self.views {
            view.clear();
        }
        self.lines_in = 0;
        self.go_to(0);
    }

    /// Whether the raw lines of the next rectified pair have come.
    fn is_ready(&self) -> bool {
        self.next_line < self.rectification.height && self.lines_in >= self.next_complete
    }

    fn go_to(&mut self, next_line: u16) {
        self.next_line = next_line;
        self.next_complete = self.rectification.lines_until(next_line);
    }
}

/// A line of a rectified view, which is resampled from raw lines where it is written.
#[derive(Debug, Clone)]
pub struct RectifiedLine<'a, K = Portable> {
    kernels: K,
    view: &'a RawView<'a>,
    line: u16,
    width: usize,
    valid: Range<u16>,
}

impl<K> RectifiedLine<'_, K> {
    /// Number of the line in the rectified view, from 0.
    #[must_use]
    pub fn line(&self) -> u16 {
        self.line
    }
}

impl<K: Kernels> Line for RectifiedLine<'_, K> {
    fn width(&self) -> usize {
        self.width
    }

    fn valid_columns(&self) -> Range<usize> {
        self.valid.start.into()..self.valid.end.into()
    }

    fn has_colour(&self) -> bool {
        self.view.has_colour()
    }

    fn write_grey(&self, row: &mut [u8]) {
        self.view.resample(&self.view.grey, &self.kernels, row);
    }

    fn write_channel(&self, channel: usize, row: &mut [u8]) {
        match self.view.colour.get(channel) {
            Some(ring) if ring.depth() > 0 => self.view.resample(ring, &self.kernels, row),
            _ => self.write_grey(row),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::rectification::tests::{Stored, crooked};
    use crate::rows::ColourRows;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec;
    use std::vec::Vec;

    /// A raw frame of four channels, grey and three of colour, row-major.
    struct Frame {
        size: [usize; 2],
        channels: [Vec<u8>; 4],
    }

    impl Frame {
        fn random(size: [u16; 2], seed: u64) -> Self {
            let mut random = Pcg32::seed_from_u64(seed);
            let size = size.map(usize::from);
            let mut channel = || {
                (0..size[0] * size[1])
                    .map(|_| random.next_u32() as u8)
                    .collect()
            };
            Self {
                size,
                channels: [channel(), channel(), channel(), channel()],
            }
        }

        fn line(&self, y: usize) -> ColourRows<'_> {
            let row = |channel: usize| &self.channels[channel][y * self.size[0]..][..self.size[0]];
            ColourRows {
                grey: row(0),
                channels: [row(1), row(2), row(3)],
            }
        }

        /// The level at a position in 1/16 px, between whole pixels in floating point.
        fn level(&self, interpolation: Interpolation, channel: usize, at_q4: [i32; 2]) -> u8 {
            let at = at_q4.map(|at| f64::from(at) / 16.0);
            let [across, down] = at.map(|at| weights(interpolation, at - at.floor()));
            let mut sum = 0.0;
            for (y, below) in (0..).zip(down) {
                for (x, right) in (0..).zip(across) {
                    let [x, y] = [(at[0], x, self.size[0]), (at[1], y, self.size[1])].map(
                        |(at, place, side)| {
                            let pixel = at.floor() + f64::from(place) - 1.0;
                            pixel.clamp(0.0, side as f64 - 1.0) as usize
                        },
                    );
                    let level = self.channels[channel][y * self.size[0] + x];
                    sum += f64::from(level) * right * below;
                }
            }
            (sum + 0.5).floor().clamp(0.0, 255.0) as u8
        }
    }

    /// The weights of the pixels from one before a position to two after, by its distance from the
    /// pixel before it; those of the cubic in 1/128.
    fn weights(interpolation: Interpolation, t: f64) -> [f64; 4] {
        if interpolation == Interpolation::Bilinear {
            return [0.0, 1.0 - t, t, 0.0];
        }
        let q7 = |weight: f64| (weight * 128.0).round() / 128.0;
        let outer = |t: f64| q7(-0.75 * t * (1.0 - t) * (1.0 - t));
        let u = 1.0 - t;
        let inner = q7(1.25 * u * u * u - 2.25 * u * u + 1.0);
        [outer(t), 1.0 - outer(t) - inner - outer(u), inner, outer(u)]
    }

    /// Pushes a frame through a rectifier and compares the valid columns of every line with the
    /// whole frame; returns how many differ. `most_at_once` becomes the largest number of pairs
    /// that a raw pair completed.
    fn differing(
        rectifier: &mut Rectifier<'_, '_>,
        frames: &[Frame; 2],
        most_at_once: &mut usize,
    ) -> usize {
        let rectification = *rectifier.rectification();
        let interpolation = rectification.interpolation;
        let (mut differing, mut y) = (0, 0);
        for raw in 0..frames[0].size[1] {
            rectifier
                .push(&frames[0].line(raw), &frames[1].line(raw))
                .unwrap();
            let mut at_once = 0;
            while let Some(pair) = rectifier.next_pair() {
                let maps = [&rectification.left, &rectification.right];
                for ((line, frame), map) in pair.iter().zip(frames).zip(maps) {
                    let mut row = vec![0; usize::from(rectification.width)];
                    for channel in 0..4 {
                        match channel {
                            0 => line.write_grey(&mut row),
                            _ => line.write_channel(channel - 1, &mut row),
                        }
                        let channel = if line.has_colour() { channel } else { 0 };
                        for x in map.valid_columns(y) {
                            let found = row[usize::from(x)];
                            let position = expected_position_q4(map, x, y);
                            differing +=
                                usize::from(found != frame.level(interpolation, channel, position));
                        }
                    }
                }
                (y, at_once) = (y + 1, at_once + 1);
            }
            *most_at_once = at_once.max(*most_at_once);
        }
        assert_eq!(y, rectification.height, "every line comes out");
        differing
    }

    /// Where a rectified pixel lies in the raw view: the four knots around it, weighted in floating
    /// point, to the nearest 1/16 px.
    fn expected_position_q4(map: &ViewMap<'_>, x: u16, y: u16) -> [i32; 2] {
        let step = 1 << map.step_shift();
        let cell = usize::from(x) / step;
        let share = f64::from(x % step as u16) / step as f64;
        let unit = (64 * step) as f64;
        let [start, end] = [map.knot(cell, y), map.knot(cell + 1, y)];
        [0, 1].map(|axis| {
            let position = f64::from(start[axis]) * (1.0 - share) + f64::from(end[axis]) * share;
            (position / unit * 16.0 + 0.5).floor() as i32
        })
    }

    fn cameras() -> Vec<Stored> {
        let mut cameras = vec![
            Stored::new(3, [64, 48], [61, 43], crooked),
            // Barrel distortion, larger steps, and a view larger than the sensors'.
            Stored::new(4, [70, 50], [90, 66], |view, x, y| {
                let [x, y] = [x - 44.0, y - 33.0];
                let shrink = -0.00006 * (x * x + y * y) * [1.0, 0.8][view];
                [shrink * x - 10.0, shrink * y - 8.0 + [0.0, 1.5][view]]
            }),
            // A part of the sensor alone.
            Stored::new(2, [40, 40], [9, 3], |_, _, _| [12.3, 30.6]),
        ];
        // A line that no camera saw.
        cameras[0].maps[0].1[20] = [0, 0];
        // All of them with the other interpolation as well, which reads further.
        for mut camera in cameras.clone() {
            camera.interpolation = Interpolation::Cubic;
            camera.kept_lines = camera.needed_lines();
            cameras.push(camera);
        }
        cameras
    }

    #[test]
    fn lines_equal_those_resampled_from_the_whole_frame() {
        let mut most_at_once = 0;
        for (seed, camera) in (0..).zip(cameras()) {
            let bytes = camera.bytes();
            let rectification = Rectification::from_bytes(&bytes).unwrap();
            let frame = |seed| Frame::random(camera.raw, seed);
            for colour in [false, true] {
                let mut memory = vec![0; Rectifier::words(&rectification, colour)];
                let mut rectifier =
                    Rectifier::new(rectification, colour, Portable, &mut memory).unwrap();
                // A frame that breaks off, and one after it.
                let frames = [frame(2 * seed), frame(2 * seed + 1)];
                for raw in 0..5 {
                    rectifier
                        .push(&frames[1].line(raw), &frames[0].line(raw))
                        .unwrap();
                    while rectifier.next_pair().is_some() {}
                }
                rectifier.reset();
                assert_eq!(differing(&mut rectifier, &frames, &mut most_at_once), 0);
            }
        }
        assert!(most_at_once > 1, "a raw pair completes several lines");
    }

    #[test]
    fn a_line_fewer_is_not_enough_and_neither_is_a_word() {
        for (seed, camera) in (0..).zip(cameras()) {
            let bytes = camera.bytes();
            let rectification = Rectification::from_bytes(&bytes).unwrap();
            let words = Rectifier::words(&rectification, true);
            let mut memory = vec![0; words - 1];
            assert!(Rectifier::new(rectification, true, Portable, &mut memory).is_err());
            let frames = [
                Frame::random(camera.raw, seed),
                Frame::random(camera.raw, !seed),
            ];
            for view in [0, 1] {
                let mut fewer = rectification;
                [&mut fewer.left, &mut fewer.right][view].kept_lines -= 1;
                let mut memory = vec![0; words];
                let mut rectifier = Rectifier::new(fewer, false, Portable, &mut memory).unwrap();
                assert!(
                    differing(&mut rectifier, &frames, &mut 0) > 0,
                    "camera {seed}, view {view}"
                );
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let bytes = Stored::new(3, [64, 48], [61, 43], crooked).bytes();
        let rectification = Rectification::from_bytes(&bytes).unwrap();
        let frame = Frame::random([64, 48], 1);
        let mut memory = vec![0; Rectifier::words(&rectification, true)];
        let mut rectifier = Rectifier::new(rectification, true, Portable, &mut memory).unwrap();
        let line = frame.line(0);
        assert_eq!(rectifier.push(&[0; 63], &line), Err(RawLineError::Width));
        assert_eq!(rectifier.push(&line, &[0; 64]), Err(RawLineError::Colour));
        assert!(rectifier.next_pair().is_none());
        let mut refused = None;
        for raw in 0..48 {
            if let Err(error) = rectifier.push(&frame.line(raw), &frame.line(raw)) {
                refused = Some(error);
                break;
            }
        }
        assert_eq!(refused, Some(RawLineError::NotTaken));
        rectifier.reset();
        for raw in 0..48 {
            rectifier.push(&frame.line(raw), &frame.line(raw)).unwrap();
            while rectifier.next_pair().is_some() {}
        }
        assert_eq!(
            rectifier.push(&line, &line),
            Err(RawLineError::TooManyLines)
        );
    }
}
