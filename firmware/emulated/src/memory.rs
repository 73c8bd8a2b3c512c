//! Check of the functions that copy and fill memory. Some boards have their own, in assembly, which no
//! test on the host reaches; so every run begins with it.

use core::hint::black_box;

/// Largest number of bytes copied or filled: several turns of every loop.
const MOST: usize = 70;
/// Bytes of each buffer: [`MOST`] at an offset of up to 3, and a byte after them.
const BUFFER: usize = MOST + 4;

/// Whether copies and fills of up to [`MOST`] bytes at every alignment write what they should, and
/// nothing beside it. Overwrites the memory, and needs 38 words of it.
pub(crate) fn is_moved_rightly(memory: &mut [u32]) -> bool {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(memory);
    let Some((from, rest)) = bytes.split_at_mut_checked(BUFFER) else {
        return false;
    };
    let Some(to) = rest.get_mut(2..2 + BUFFER) else {
        return false;
    };
    for (byte, value) in from.iter_mut().zip(1..) {
        *byte = value;
    }
    (0..=MOST).all(|length| {
        (0..4).all(|start| {
            let is_filled = run(to, start, length, |_| 0xa5, |to| to.fill(black_box(0xa5)));
            let is_cleared = run(to, start, length, |_| 0, |to| to.fill(0));
            is_filled
                && is_cleared
                && (0..4).all(|first| {
                    let from = from.get(first..first + length).unwrap_or_default();
                    let copy = |to: &mut [u8]| to.copy_from_slice(black_box(from));
                    run(to, start, length, |index| (first + index + 1) as u8, copy)
                })
        })
    })
}

/// Whether `write`, given `length` bytes from `start` on of a buffer of ones, writes the `expected` bytes
/// and leaves the others.
fn run(
    buffer: &mut [u8],
    start: usize,
    length: usize,
    expected: impl Fn(usize) -> u8,
    write: impl FnOnce(&mut [u8]),
) -> bool {
    for byte in buffer.iter_mut() {
        *byte = black_box(u8::MAX);
    }
    if let Some(run) = buffer.get_mut(start..start + black_box(length)) {
        write(run);
    }
    buffer.iter().enumerate().all(|(at, &byte)| {
        let index = at.wrapping_sub(start);
        let right = if index < length {
            expected(index)
        } else {
            u8::MAX
        };
        black_box(byte) == right
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_processor_moves_memory_rightly() {
        assert!(is_moved_rightly(&mut [0; 38]));
        assert!(!is_moved_rightly(&mut [0; 37]), "too little memory");
    }

    #[test]
    fn what_is_written_beside_or_left_out_is_noticed() {
        let mut buffer = [0; BUFFER];
        assert!(run(&mut buffer, 1, 9, |_| 7, |to| to.fill(7)));
        assert!(!run(&mut buffer, 1, 9, |_| 7, |to| to[1..].fill(7)));
        assert!(!run(&mut buffer, 1, 9, |_| 7, |to| to[..8].fill(7)));
        assert!(!run(
            &mut buffer,
            1,
            9,
            |index| index as u8,
            |to| to.fill(7)
        ));
    }
}
