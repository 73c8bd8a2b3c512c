//! The lines of one stream of a frame, and which of them are missing.
//!
//! Unlike the assembler of the link, which works in lent memory, a plane takes memory as lines
//! come: the host does not know the board's size beforehand.

/// Largest number of values of a plane. It holds the views of any camera in sight, and bounds the
/// memory that a board can take.
pub const VALUES_MAX: usize = 1 << 25;

/// Values of a part of a frame, line after line, and the lines that have come.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plane<T> {
    /// Values in a line.
    pub width: usize,
    /// Column of the frame that the first value of a line belongs to.
    pub x: u32,
    /// Number in the frame of the first line.
    pub y: u32,
    /// The values; `none` where none has come.
    pub values: Vec<T>,
    has_come: Vec<bool>,
    none: T,
}

impl<T: Copy> Plane<T> {
    /// A plane of `height` lines of `width` values, none of which has come; `None` above
    /// [`VALUES_MAX`] values, or without any.
    #[must_use]
    pub fn new([x, y]: [u32; 2], [width, height]: [u32; 2], none: T) -> Option<Self> {
        let [width, height] = [width, height].map(|side| usize::try_from(side).ok());
        let (width, height) = (width?, height?);
        let values = width.checked_mul(height)?;
        (1..=VALUES_MAX).contains(&values).then(|| Self {
            width,
            x,
            y,
            values: vec![none; values],
            has_come: vec![false; height],
            none,
        })
    }

    /// Takes values of the line with this number in the frame, from this column of the frame on, as
    /// `fill` writes them. Returns whether they lie within the plane and `fill` could write them;
    /// what it could not is as if it had not come.
    pub fn put(
        &mut self,
        line: u32,
        column: u32,
        count: usize,
        fill: impl FnOnce(&mut [T]) -> bool,
    ) -> bool {
        let row = line
            .checked_sub(self.y)
            .and_then(|row| usize::try_from(row).ok());
        let first = column
            .checked_sub(self.x)
            .and_then(|x| usize::try_from(x).ok());
        let (Some(row), Some(first)) = (row, first) else {
            return false;
        };
        let Some(has_come) = self.has_come.get_mut(row) else {
            return false;
        };
        if first.saturating_add(count) > self.width {
            return false;
        }
        let start = row * self.width + first;
        let Some(place) = self.values.get_mut(start..start + count) else {
            return false;
        };
        if !fill(place) {
            place.fill(self.none);
            return false;
        }
        *has_come = true;
        true
    }

    /// The plane of as many lines of `width` values that `convert` writes, given the values of a
    /// line. Of missing lines, it is given [`Plane::new`]'s.
    #[must_use]
    pub fn converted<U: Copy + Default>(
        &self,
        width: usize,
        mut convert: impl FnMut(&[T], &mut [U]),
    ) -> Plane<U> {
        let mut values = vec![U::default(); width * self.height()];
        let lines = self.values.chunks_exact(self.width.max(1));
        for (from, to) in lines.zip(values.chunks_exact_mut(width.max(1))) {
            convert(from, to);
        }
        Plane {
            width,
            x: self.x,
            y: self.y,
            values,
            has_come: self.has_come.clone(),
            none: U::default(),
        }
    }

    /// The values of a whole view of this width and height, of which this plane is a part; `none` outside
    /// of it. `None` where the plane is no part of such a view, or that is too large.
    #[must_use]
    pub fn in_view(&self, [width, height]: [u32; 2], none: T) -> Option<Vec<T>> {
        let mut values = Self::new([0, 0], [width, height], none)?.values;
        let (width, x) = (usize::try_from(width).ok()?, usize::try_from(self.x).ok()?);
        let y = usize::try_from(self.y).ok()?;
        if x.checked_add(self.width)? > width
            || y.checked_add(self.height())? > values.len() / width
        {
            return None;
        }
        let lines = values.chunks_exact_mut(width).skip(y);
        for (line, part) in lines.zip(self.values.chunks_exact(self.width)) {
            line.get_mut(x..x + self.width)?.copy_from_slice(part);
        }
        Some(values)
    }

    /// Number of lines.
    #[must_use]
    pub fn height(&self) -> usize {
        self.has_come.len()
    }

    /// The runs of missing lines, from the top: the first, counted in the plane, and how many.
    #[must_use]
    pub fn missing(&self) -> Vec<[usize; 2]> {
        let mut runs: Vec<[usize; 2]> = Vec::new();
        for (row, _) in self.has_come.iter().enumerate().filter(|(_, come)| !**come) {
            match runs.last_mut() {
                Some([first, count]) if *first + *count == row => *count += 1,
                _ => runs.push([row, 1]),
            }
        }
        runs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn takes_what_lies_within_and_tells_the_missing_lines_in_runs() {
        let mut plane = Plane::new([4, 10], [3, 6], -1).unwrap();
        let write = |values: [i32; 2]| {
            move |place: &mut [i32]| {
                place.copy_from_slice(&values);
                true
            }
        };
        assert!(plane.put(11, 5, 2, write([7, 8])));
        assert!(plane.put(14, 4, 2, write([1, 2])));
        for (line, column) in [
            (9, 4),
            (16, 4),
            (10, 3),
            (10, 6),
            (u32::MAX, 4),
            (10, u32::MAX),
        ] {
            assert!(
                !plane.put(line, column, 2, write([9, 9])),
                "{line} {column}"
            );
        }
        assert_eq!(plane.missing(), [[0, 1], [2, 2], [5, 1]]);
        assert_eq!(plane.values[3..6], [-1, 7, 8]);
        // A part that is damaged leaves no value behind.
        assert!(!plane.put(12, 4, 2, |place| {
            place[0] = 5;
            false
        }));
        assert_eq!(plane.values[6..9], [-1, -1, -1]);
        assert_eq!(plane.missing(), [[0, 1], [2, 2], [5, 1]]);
    }

    #[test]
    fn a_part_lies_in_its_view() {
        let mut plane = Plane::new([1, 2], [2, 1], 0).unwrap();
        assert!(plane.put(2, 1, 2, |place| {
            place.copy_from_slice(&[5, 6]);
            true
        }));
        let expected = [9, 9, 9, 9, 9, 9, 9, 9, 9, 5, 6, 9];
        assert_eq!(plane.in_view([4, 3], 9).unwrap(), expected);
        for size in [[2, 3], [4, 2], [u32::MAX, u32::MAX], [0, 0]] {
            assert_eq!(plane.in_view(size, 9), None, "{size:?}");
        }
    }

    #[test]
    fn sizes_beyond_the_bound_take_no_memory() {
        assert!(Plane::new([0, 0], [u32::MAX, u32::MAX], 0_u8).is_none());
        assert!(Plane::new([0, 0], [1 << 13, (1 << 12) + 1], 0_u8).is_none());
        assert!(Plane::new([0, 0], [0, 5], 0_u8).is_none());
    }
}
