//! The README's example of a board: it is what `docs/board.rs` has, and it matches.

// What an application exports is not reachable from here.
#[allow(unreachable_pub)]
mod board {
    include!("../../docs/board.rs");
}

use vgstereo_core::STEPS_PER_PX;

#[test]
fn the_example_of_the_readme_is_the_one_that_is_built() {
    let readme = include_str!("../../README.md");
    let blocks: Vec<&str> = readme.split("```rust\n").skip(1).collect();
    let [block] = blocks[..] else {
        panic!("{} blocks of Rust", blocks.len());
    };
    let (code, _) = block.split_once("```").unwrap();
    assert_eq!(code, include_str!("../../docs/board.rs"));
}

#[test]
fn the_example_matches_a_shifted_texture() {
    const SHIFT: usize = 9;
    let texture = |x: usize, y: usize| (((x * 7919 + y * 104_729) * 31) >> 3) as u8;
    let mut matcher = board::matcher().unwrap();
    assert!(board::matcher().is_none(), "its memory is lent once");
    for _ in 0..2 {
        let mut pairs = (0..40).map(|y| {
            [0, SHIFT].map(|shift| std::array::from_fn::<u8, 320, _>(|x| texture(x + shift, y)))
        });
        let mut lines = vec![];
        board::match_frame(
            &mut matcher,
            || pairs.next(),
            |line, disparities_q4| lines.push((line, disparities_q4[200])),
        )
        .unwrap();
        assert!(lines.iter().map(|&(line, _)| line).eq(0..40));
        // The sub-pixel step is within a sixteenth.
        let expected_q4 = SHIFT as i16 * STEPS_PER_PX;
        assert!(
            lines
                .iter()
                .all(|&(_, disparity_q4)| disparity_q4.abs_diff(expected_q4) <= 1)
        );
    }
}
