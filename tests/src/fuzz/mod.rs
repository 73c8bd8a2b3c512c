//! Fuzzing: for each target a function that takes any bytes and panics when what it promises does
//! not hold.
//!
//! The programs in `tests/fuzz/fuzz_targets` give these functions the inputs of libFuzzer, and
//! `tests/tests/corpora.rs` those that are stored. A target is a module with a function `run`, listed in
//! [`TARGETS`].

pub mod calibration;
pub mod images;
pub mod link_decoder;
pub mod link_lines;
pub mod live;
pub mod matcher;
pub mod meta;
pub mod parameters;
pub mod recording;
pub mod rectification;
pub mod session;
pub mod truth_and_masks;

/// What a target does with the bytes of an input.
pub type Target = fn(&[u8]);

/// The names of the targets, which are also those of their corpora, and their functions.
pub const TARGETS: [(&str, Target); 12] = [
    ("calibration", calibration::run),
    ("images", images::run),
    ("link_decoder", link_decoder::run),
    ("link_lines", link_lines::run),
    ("live", live::run),
    ("matcher", matcher::run),
    ("meta", meta::run),
    ("parameters", parameters::run),
    ("recording", recording::run),
    ("rectification", rectification::run),
    ("session", session::run),
    ("truth_and_masks", truth_and_masks::run),
];

/// The name of files in memory, which their errors must state.
const NAME: &str = "input-file";

/// Runs a reader and panics when it holds more than `bytes_max` of allocated memory at a time.
fn within_memory<T>(bytes_max: u64, reader: impl FnOnce() -> T) -> T {
    let mut result = None;
    let allocated = allocation_counter::measure(|| result = Some(reader()));
    assert!(
        allocated.bytes_max <= bytes_max,
        "{} bytes are allocated at a time, and {bytes_max} are allowed",
        allocated.bytes_max
    );
    let Some(result) = result else {
        unreachable!("the reader has run");
    };
    result
}

/// What was read, or `None` after a refusal that must name the file `name`.
fn accepted<T>(result: anyhow::Result<T>, name: &str) -> Option<T> {
    match result {
        Ok(read) => Some(read),
        Err(error) => {
            let message = format!("{error:#}");
            assert!(
                message.contains(name),
                "a refusal without the name: {message}"
            );
            None
        }
    }
}
