//! Frames of lines, some of which are missing.

use vgstereo_link::board::FrameBegun;
use vgstereo_link::{FrameAssembler, Line, Packed, Region, Values};

const BEGUN: FrameBegun = FrameBegun {
    frame: 9,
    timestamp_us: 0,
    region: Region {
        x_px: 10,
        y_lines: 5,
        width_px: 3,
        height_lines: 40,
    },
};

fn line(frame: u32, line: u32, column: u16, values: &[u16]) -> Line<'_, u16> {
    Line {
        frame,
        line,
        column,
        values: Values::Plain(values),
    }
}

#[test]
fn lines_find_their_places_and_the_missing_ones_are_told() {
    let (mut values, mut present) = ([7; 130], [!0; 2]);
    let mut assembler = FrameAssembler::<u16>::new(&mut values, &mut present);
    assert!(!assembler.push(&line(9, 5, 10, &[1, 2, 3])));
    assert!(assembler.begin(&BEGUN));
    assert_eq!(assembler.values(), [0; 120]);
    // In any order, and twice.
    for at in [44, 5, 5, 37] {
        assert!(assembler.push(&line(9, at, 10, &[at as u16, 2, 3])));
    }
    // A part of a line.
    assert!(assembler.push(&line(9, 6, 11, &[8, 9])));
    for (frame, at, column, values) in [
        (8, 7, 10, &[1, 1, 1][..]),
        (9, 4, 10, &[1, 1, 1]),
        (9, 45, 10, &[1, 1, 1]),
        (9, u32::MAX, u16::MAX, &[1, 1, 1]),
        (9, 7, 9, &[1, 1, 1]),
        (9, 7, 11, &[1, 1, 1]),
    ] {
        assert!(!assembler.push(&line(frame, at, column, values)));
    }
    let broken = Line {
        values: Values::Packed(Packed::new(3, &[1, 4])),
        ..line(9, 7, 10, &[])
    };
    assert!(!assembler.push(&broken));
    assert_eq!(assembler.lines(), 4);
    assert!(assembler.missing().eq((7..37).chain(38..44)));
    assert_eq!(assembler.values()[..9], [5, 2, 3, 0, 8, 9, 0, 0, 0]);
    assert_eq!(assembler.values()[96..99], [37, 2, 3]);
    assert_eq!(assembler.values()[117..], [44, 2, 3]);

    assert!(assembler.begin(&BEGUN));
    assert_eq!((assembler.lines(), assembler.missing().count()), (0, 40));
}

#[test]
fn frames_that_do_not_fit_are_not_begun() {
    for (values, present) in [(119, 2), (120, 1)] {
        let (mut values, mut present) = (vec![0; values], vec![0; present]);
        let mut assembler = FrameAssembler::<u16>::new(&mut values, &mut present);
        assert!(!assembler.begin(&BEGUN));
        assert!(!assembler.push(&line(9, 5, 10, &[1, 2, 3])));
        assert_eq!(
            (assembler.values().len(), assembler.missing().count()),
            (0, 0)
        );
    }
    assert_eq!(FrameAssembler::<u16>::present_words(40), 2);
}
