//! Whether a board of squares is seen whole in a picture, as those that calibrate cameras by it need it.

use std::collections::HashSet;

use anyhow::Result;
use calib_targets_chessboard::{
    ChessboardDetector, ChessboardParams, GrayImageView, default_chess_config, detect_corners,
};

/// Smallest side of a picture in which a board is looked for, px. Three by three corners take more.
const SIDE_MIN_PX: usize = 16;

/// A board of squares that is looked for in pictures.
pub struct Chessboard {
    /// Inner corners across and down, where four squares meet.
    corners: [usize; 2],
    detector: ChessboardDetector,
}

/// How much of a board of squares a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sight {
    /// All of it.
    Whole,
    /// A part with so many corners.
    Part(usize),
    /// A board of squares with more corners than it has, across and down.
    Larger([usize; 2]),
    /// Nothing.
    Nothing,
}

impl Chessboard {
    /// A board with so many inner corners across and down.
    ///
    /// # Errors
    /// Fails when the detector cannot look for such a board.
    pub fn new(corners: [usize; 2]) -> Result<Self> {
        let detector = ChessboardDetector::new(ChessboardParams::default())?;
        Ok(Self { corners, detector })
    }

    /// Looks for the board in a grey picture, row-major in lines of `width` px. It may lie on its side.
    #[must_use]
    pub fn sight(&self, grey: &[u8], width: usize) -> Sight {
        let height = grey.len() / width.max(1);
        if width.min(height) < SIDE_MIN_PX || width * height != grey.len() {
            return Sight::Nothing;
        }
        let view = GrayImageView {
            width,
            height,
            data: grey,
        };
        let corners = detect_corners(&view, &default_chess_config());
        let Some(found) = self.detector.detect(&corners) else {
            return Sight::Nothing;
        };
        let labels = found.corners.iter().map(|corner| corner.grid);
        self.judge(&labels.map(|grid| [grid.u, grid.v]).collect())
    }

    /// Compares found corners, each with its column and row, with those of the board.
    fn judge(&self, found: &HashSet<[i32; 2]>) -> Sight {
        let [across, down] = self.corners;
        let of_board = across * down;
        let is_whole = [[across, down], [down, across]]
            .into_iter()
            .any(|size| has_all(found, size));
        // Squares of the surroundings may seem to go on with it at a corner or two.
        if is_whole && found.len() < of_board + across.min(down) {
            return Sight::Whole;
        }
        if found.len() <= of_board {
            return match found.len() {
                0 => Sight::Nothing,
                count => Sight::Part(count),
            };
        }
        Sight::Larger([0, 1].map(|axis| {
            let places = || found.iter().map(|place| place[axis]);
            let (first, last) = (places().min(), places().max());
            let count = last.zip(first).map_or(0, |(last, first)| last - first + 1);
            usize::try_from(count).unwrap_or_default()
        }))
    }
}

/// Whether a part of this size is there without a gap.
fn has_all(found: &HashSet<[i32; 2]>, size: [usize; 2]) -> bool {
    let [Ok(columns), Ok(rows)] = size.map(i32::try_from) else {
        return false;
    };
    found.iter().any(|&[u, v]| {
        let mut places = (0..rows).flat_map(|y| (0..columns).map(move |x| [u + x, v + y]));
        places.all(|place| found.contains(&place))
    })
}

#[cfg(test)]
mod tests {
    use rand_core::Rng;
    use rand_pcg::Pcg32;

    use super::*;

    fn grid(columns: std::ops::Range<i32>, rows: std::ops::Range<i32>) -> HashSet<[i32; 2]> {
        rows.flat_map(|v| columns.clone().map(move |u| [u, v]))
            .collect()
    }

    #[test]
    fn whole_boards_are_told_from_parts_and_from_larger_ones() {
        let board = Chessboard::new([9, 6]).unwrap();
        assert_eq!(board.judge(&grid(0..9, 0..6)), Sight::Whole);
        assert_eq!(
            board.judge(&grid(-2..4, 3..12)),
            Sight::Whole,
            "on its side"
        );
        let mut spoilt = grid(0..9, 0..6);
        spoilt.insert([9, 2]);
        assert_eq!(board.judge(&spoilt), Sight::Whole, "something beside it");
        spoilt.remove(&[4, 4]);
        assert_eq!(board.judge(&spoilt), Sight::Part(54), "a gap");
        assert_eq!(board.judge(&grid(0..9, 0..5)), Sight::Part(45));
        assert_eq!(board.judge(&grid(0..10, 0..7)), Sight::Larger([10, 7]));
        assert_eq!(board.judge(&HashSet::new()), Sight::Nothing);
    }

    /// Squares of `side` px, of which `corners` have corners on all sides, on white, or on the grey of
    /// the surroundings.
    fn drawn(corners: [usize; 2], side: usize, size: [usize; 2]) -> Vec<u8> {
        let [columns, rows] = corners.map(|count| count + 1);
        let [width, height] = size;
        let (left, top) = (
            (width.saturating_sub(columns * side)) / 2,
            (height.saturating_sub(rows * side)) / 2,
        );
        let level = |i: usize| {
            let (x, y) = (
                (i % width).wrapping_sub(left),
                (i / width).wrapping_sub(top),
            );
            let (column, row) = (x / side, y / side);
            let is_black = column < columns && row < rows && (column + row).is_multiple_of(2);
            if is_black { 20 } else { 230 }
        };
        (0..width * height).map(level).collect()
    }

    #[test]
    fn a_drawn_board_is_seen_and_a_cut_one_is_not_whole() {
        let board = Chessboard::new([9, 6]).unwrap();
        let picture = drawn([9, 6], 20, [320, 240]);
        assert_eq!(board.sight(&picture, 320), Sight::Whole);
        let on_its_side = drawn([6, 9], 20, [320, 240]);
        assert_eq!(board.sight(&on_its_side, 320), Sight::Whole);
        // The last column of corners is beyond the border.
        let cut: Vec<u8> = picture
            .chunks(320)
            .flat_map(|row| &row[..230])
            .copied()
            .collect();
        let sight = board.sight(&cut, 230);
        assert!(matches!(sight, Sight::Part(1..54)), "{sight:?}");
        let larger = drawn([11, 8], 20, [320, 240]);
        assert_eq!(board.sight(&larger, 320), Sight::Larger([11, 8]));
    }

    #[test]
    fn pictures_of_any_size_without_a_board_have_none() {
        let board = Chessboard::new([9, 6]).unwrap();
        let mut random = Pcg32::new(7, 1);
        for [width, height] in [
            [0, 0],
            [1, 1],
            [3, 700],
            [15, 15],
            [16, 16],
            [17, 33],
            [160, 120],
        ] {
            let flat = vec![90; width * height];
            assert_eq!(board.sight(&flat, width), Sight::Nothing);
            let noise: Vec<u8> = flat.iter().map(|_| random.next_u32() as u8).collect();
            let sight = board.sight(&noise, width);
            assert!(
                matches!(sight, Sight::Nothing | Sight::Part(_)),
                "{sight:?}"
            );
        }
        assert_eq!(board.sight(&[1, 2, 3], 2), Sight::Nothing);
    }
}
