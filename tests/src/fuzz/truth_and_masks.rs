//! The readers of ground truth and of masks.

use vgstereo_sim::dataset::{SCALE_RANGE, StoredMask, Truth};
use vgstereo_sim::pfm::Pfm;

use super::{NAME, accepted, within_memory};

/// Reads a file as ground truth, as a mask and as a float map. The first byte gives the steps per px of
/// ground truth in a PNG.
pub fn run(bytes: &[u8]) {
    let Some((&steps, file)) = bytes.split_first() else {
        return;
    };
    // From 1/64 on; 255 stands for none.
    let scale = (steps < u8::MAX).then(|| f32::from(steps) * f32::from(steps) / 64.0);
    let bytes_max = memory_max(file);
    let truth = within_memory(bytes_max, || Truth::from_bytes(file, scale, NAME));
    if let Some(truth) = accepted(truth, NAME) {
        assert_eq!(truth.px.len(), pixels(truth.width, truth.height));
        // Known disparities are not negative.
        assert!(
            truth
                .px
                .iter()
                .all(|&px| px.is_nan() || (0.0..f32::INFINITY).contains(&px))
        );
        let is_png = !file.starts_with(b"P");
        assert!(!is_png || scale.is_some_and(|scale| SCALE_RANGE.contains(&scale)));
    }
    let mask = within_memory(bytes_max, || StoredMask::from_bytes(file, NAME));
    if let Some(mask) = accepted(mask, NAME) {
        assert_eq!(mask.pixels.len(), pixels(mask.width, mask.height));
        assert!(
            mask.pixels.iter().any(|&counts| counts),
            "a mask of nothing"
        );
    }
    let map = within_memory(bytes_max, || Pfm::from_bytes(file, NAME));
    if let Some(map) = accepted(map, NAME) {
        assert_eq!(map.values.len(), pixels(map.width, map.height));
        let again = Pfm::from_bytes(&map.to_bytes(), NAME).unwrap();
        let bits = |map: &Pfm| {
            map.values
                .iter()
                .map(|value| value.to_bits())
                .collect::<Vec<_>>()
        };
        assert_eq!(bits(&again), bits(&map));
    }
}

fn pixels(width: u32, height: u32) -> usize {
    width as usize * height as usize
}

/// Bytes that reading a file may take: a few for each pixel that its header states, and besides as
/// much as decoders need.
fn memory_max(file: &[u8]) -> u64 {
    let side = |at: usize| {
        let bytes = file.get(at..at + 4).and_then(|bytes| bytes.try_into().ok());
        u64::from(bytes.map_or(0, u32::from_be_bytes))
    };
    let pixels = if file.starts_with(b"\x89PNG") {
        // A PNG begins with the chunk that states its size. Larger ones than are read are refused.
        side(16)
            .saturating_mul(side(20))
            .min(vgstereo_sim::images::PIXELS_MAX)
    } else {
        0
    };
    // Four channels of 16 bits as they are stored, as numbers, and one of them kept.
    (4 << 20) + 32 * file.len() as u64 + 24 * pixels
}
