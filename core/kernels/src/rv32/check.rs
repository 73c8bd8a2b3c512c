//! Checks of selected disparities, pixel by pixel. The reference avoids branches, which cost a large processor more than
//! the masks in their place, and makes two passes; here one pass with branches takes fewer instructions.

use vgstereo_core::disparity::INVALID;
use vgstereo_core::kernel::CheckRow;

/// Equals [`check_row`](vgstereo_core::kernel::check_row) bit for bit.
#[inline(never)]
pub(super) fn check_row(row: &CheckRow<'_>, found: &mut [i16], confidences: &mut [u8]) {
    let mut position = row.first;
    let pixels = row.best.iter().zip(row.refined_index_q4).zip(row.margins);
    let outputs = found.iter_mut().zip(confidences);
    for (((&best, &refined_index_q4), &margin), (found, confidence)) in pixels.zip(outputs) {
        let other = row.others.get(position.wrapping_add(best.into()) as usize);
        let other = other.map_or(u16::MAX, |&other| other as u16);
        position = position.wrapping_sub(1);
        let agrees = other.abs_diff(best) <= row.tolerance_px.into();
        (*found, *confidence) = match (agrees, margin >= row.margin) {
            (false, _) => (INVALID, 0),
            (true, false) => (!refined_index_q4, 0),
            (true, true) => (refined_index_q4, margin.clamp(1, 255) as u8),
        };
    }
}
