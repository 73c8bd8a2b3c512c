//! The reader of a scene's `meta.toml`.

use vgstereo_sim::dataset::{Meta, SCALE_RANGE};

use super::{NAME, accepted, within_memory};

/// Reads any text: what is accepted is within its bounds and is read back from what is written.
pub fn run(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    let bytes_max = (1 << 16) + 1024 * bytes.len() as u64;
    let read = within_memory(bytes_max, || Meta::parse(text, NAME));
    let Some(meta) = accepted(read, NAME) else {
        return;
    };
    assert!(
        meta.gt_scale
            .is_none_or(|scale| SCALE_RANGE.contains(&scale))
    );
    let written = toml::to_string(&meta).unwrap();
    assert_eq!(Meta::parse(&written, NAME).unwrap(), meta, "{written}");
}
