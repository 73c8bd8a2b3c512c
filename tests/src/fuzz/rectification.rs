//! The reader of rectifications, and the rectifier that uses them.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::geometry::Interpolation;
use vgstereo_core::geometry::{Rectification, Rectifier};
use vgstereo_core::{ColourRows, Kernels, Line, Portable};
use vgstereo_kernels::{Armv7em, NativeKernels};

/// Bytes of a rectification before its maps.
const HEADER_BYTES: usize = 40;
/// Frames of larger raw or rectified views are not rectified here, because they take long.
const FRAME_MAX_PX: u64 = 1 << 13;
/// Content is not made longer than this, to have the length that a header states.
const LENGTH_MAX: usize = 1 << 17;

/// Reads a rectification. The first byte, if it is odd, has the rest changed such that its beginning, its
/// length, its numbers of lines and its checksum are right, as those of random bytes never are.
pub fn run(bytes: &[u8]) {
    let Some((&mends, content)) = bytes.split_first() else {
        return;
    };
    let mut content = content.to_vec();
    if mends % 2 == 1 {
        mend(&mut content);
    }
    let Ok(rectification) = Rectification::from_bytes(&content) else {
        return;
    };
    rectify_frames(&rectification);
}

/// Makes right what tells a rectification from other bytes.
fn mend(content: &mut Vec<u8>) {
    if content.len() < HEADER_BYTES {
        return;
    }
    content[..6].copy_from_slice(b"VGRF\x01\0");
    content[6] = 2 + content[6] % 5;
    content[7] %= 2;
    let side = |at: usize| usize::from(u16::from_le_bytes([content[at], content[at + 1]]));
    let (width, height) = (side(12), side(14));
    let step = 1 << content[6];
    let knots = (width.div_ceil(step) + 1) * (height.div_ceil(step) + 1);
    let length = HEADER_BYTES + 8 * (knots + height);
    if length <= LENGTH_MAX {
        content.resize(length, 0);
    }
    let seal = |content: &mut Vec<u8>| {
        let checksum = crc32fast::hash(content);
        content.extend(checksum.to_le_bytes());
    };
    seal(content);
    if let Ok([left, right]) = Rectification::needed_lines_of(content) {
        content[16..18].copy_from_slice(&left.to_le_bytes());
        content[18..20].copy_from_slice(&right.to_le_bytes());
        content.truncate(content.len() - 4);
        seal(content);
    }
}

/// Rectifies two frames in exactly the memory that is stated, in grey and in colour: every line comes, the
/// last with the last raw one at the latest, no level is beyond those of the raw line around, unless a
/// cubic made it, and all kernel sets give the same.
///
/// # Panics
/// If one of this does not hold.
pub fn rectify_frames(rectification: &Rectification<'_>) {
    let &Rectification {
        raw_width,
        raw_height,
        width,
        height,
        ..
    } = rectification;
    let pixels = |width: u16, height: u16| u64::from(width) * u64::from(height);
    if pixels(raw_width, raw_height).max(pixels(width, height)) > FRAME_MAX_PX {
        return;
    }
    for colour in [false, true] {
        let words = Rectifier::words(rectification, colour);
        let mut short = vec![u32::MAX; words.saturating_sub(1)];
        let refused = Rectifier::new(*rectification, colour, Portable, &mut short);
        assert!(words == 0 || refused.is_err());
        let expected = frames(rectification, colour, Portable);
        assert_eq!(expected.len(), usize::from(height));
        assert!(frames(rectification, colour, Armv7em) == expected);
        for kernels in NativeKernels::available() {
            assert!(frames(rectification, colour, kernels) == expected);
        }
    }
}

/// Rectifies part of a frame, which leaves nothing behind, and two whole frames, which are alike; returns
/// the lines of one.
fn frames(
    rectification: &Rectification<'_>,
    colour: bool,
    kernels: impl Kernels,
) -> Vec<[Vec<u8>; 2]> {
    let raw_height = rectification.raw_height;
    let mut memory = vec![u32::MAX; Rectifier::words(rectification, colour)];
    let mut rectifier = Rectifier::new(*rectification, colour, kernels, &mut memory).unwrap();
    let broken = frame(&mut rectifier, raw_height / 2);
    assert!(broken.len() <= usize::from(rectification.height));
    rectifier.reset();
    let first = frame(&mut rectifier, raw_height);
    rectifier.reset();
    assert!(frame(&mut rectifier, raw_height) == first);
    first
}

/// Gives a rectifier this many raw lines of random levels; returns the rectified ones of both views.
fn frame<K: Kernels>(rectifier: &mut Rectifier<'_, '_, K>, raw_lines: u16) -> Vec<[Vec<u8>; 2]> {
    let is_bounded = rectifier.rectification().interpolation == Interpolation::Bilinear;
    let is_inside = |level: &u8| !is_bounded || (40..210).contains(level);
    let raw_width = usize::from(rectifier.rectification().raw_width);
    let mut random = Pcg32::seed_from_u64(1);
    // A range within which all levels must stay.
    let mut line = || -> Vec<u8> {
        (0..raw_width)
            .map(|_| 40 + (random.next_u32() % 170) as u8)
            .collect()
    };
    let mut lines = Vec::new();
    for _ in 0..raw_lines {
        let [left, right] = [(); 2].map(|()| [line(), line()]);
        let [left, right] = [&left, &right].map(|[grey, colour]| ColourRows {
            grey,
            channels: [colour; 3],
        });
        rectifier.push(&left, &right).unwrap();
        while let Some(pair) = rectifier.next_pair() {
            lines.push(pair.map(|line| {
                let mut row = vec![0; line.width()];
                line.write_grey(&mut row);
                assert!(row.iter().all(is_inside));
                for channel in 0..3 {
                    let mut levels = vec![0; line.width()];
                    line.write_channel(channel, &mut levels);
                    assert!(levels.iter().all(is_inside));
                    row.extend(levels);
                }
                row
            }));
        }
    }
    lines
}
