//! Penalties of larger steps of disparity, four pixels at once.

use vgstereo_core::kernel::{self, Penalty};

use super::simd::{
    distance_u8x4, even_bytes, load, max_u8x4, odd_bytes, saturate_to_u8x2, splat_u8, store,
    sub_saturating_u8x4,
};

/// Equals [`kernel::penalty_row`] bit for bit.
pub(super) fn penalty_row(penalty: &Penalty, own: &[u8], neighbours: &[u8], p2: &mut [u8]) {
    let count = own.len().min(neighbours.len()).min(p2.len()) / 4 * 4;
    let (Some((own, own_rest)), Some((neighbours, rest)), Some((p2, p2_rest))) = (
        own.split_at_checked(count),
        neighbours.split_at_checked(count),
        p2.split_at_mut_checked(count),
    ) else {
        return;
    };
    let [most, floor, step_min] = [penalty.most, penalty.floor, penalty.step_min].map(splat_u8);
    let quads = own.as_chunks().0.iter().zip(neighbours.as_chunks().0);
    for ((own, neighbours), p2) in quads.zip(p2.as_chunks_mut().0) {
        let steps = sub_saturating_u8x4(distance_u8x4(load(own), load(neighbours)), step_min);
        // A fall by 255 or more leads to the floor.
        let falls = |steps: u32| {
            let falls_q4 = steps * u32::from(penalty.adaptation_q4);
            saturate_to_u8x2(falls_q4 >> 4 & 0x0fff_0fff)
        };
        let falls = falls(even_bytes(steps)) | falls(odd_bytes(steps)) << 8;
        store(max_u8x4(sub_saturating_u8x4(most, falls), floor), p2);
    }
    kernel::penalty_row(penalty, own_rest, rest, p2_rest);
}
