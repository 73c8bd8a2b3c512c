//! Checks of selected disparities, two pixels at once.

use vgstereo_core::disparity::INVALID;
use vgstereo_core::kernel::{self, CheckRow};

use super::simd::{
    max_i16x2, pair_of, saturate_to_u8x2, select_ge_i16x2, select_ge_u16x2, splat_u16,
    sub_saturating_u16x2,
};

/// Equals [`kernel::check_row`] bit for bit.
#[inline(never)]
pub(super) fn check_row(row: &CheckRow<'_>, found: &mut [i16], confidences: &mut [u8]) {
    let lengths = [
        row.refined_index_q4.len(),
        row.margins.len(),
        found.len(),
        confidences.len(),
    ];
    if lengths != [row.best.len(); 4] {
        kernel::check_row(row, found, confidences);
        return;
    }
    // First the indices of the matches, one by one, in place of the states.
    let mut position = row.first;
    for (&best, other) in row.best.iter().zip(&mut *found) {
        let match_of = row.others.get(position.wrapping_add(best.into()) as usize);
        *other = match_of
            .map_or(u16::MAX, |&index| index as u16)
            .cast_signed();
        position = position.wrapping_sub(1);
    }
    let tolerance = splat_u16(row.tolerance_px.into());
    let margin_min = splat_u16(row.margin.cast_unsigned());
    let invalid = splat_u16(INVALID.cast_unsigned());
    let (bests, best_rest) = row.best.as_chunks::<2>();
    let (refined, refined_rest) = row.refined_index_q4.as_chunks();
    let (margins, margins_rest) = row.margins.as_chunks();
    let (found, found_rest) = found.as_chunks_mut();
    let (confidences, confidences_rest) = confidences.as_chunks_mut();
    let inputs = bests.iter().zip(refined).zip(margins);
    let outputs = found.iter_mut().zip(confidences);
    for (((&[a, b], refined), margins), (found, confidences)) in inputs.zip(outputs) {
        let (others, bests) = (pair_of(found), u32::from(b) << 16 | u32::from(a));
        let difference = sub_saturating_u16x2(others, bests) | sub_saturating_u16x2(bests, others);
        let agree = select_ge_u16x2(tolerance, difference, u32::MAX, 0);
        let margins = pair_of(margins);
        let are_clear = select_ge_i16x2(margins, margin_min, u32::MAX, 0);
        let states = (pair_of(refined) ^ !are_clear) & agree | invalid & !agree;
        *found = [states as u16, (states >> 16) as u16].map(u16::cast_signed);
        let clamped = max_i16x2(saturate_to_u8x2(margins), splat_u16(1));
        let holding = clamped & are_clear & agree;
        *confidences = [holding as u8, (holding >> 16) as u8];
    }
    let position = row.first.wrapping_sub(2 * bests.len() as u32);
    let rest = CheckRow {
        best: best_rest,
        refined_index_q4: refined_rest,
        margins: margins_rest,
        first: position,
        ..*row
    };
    kernel::check_row(&rest, found_rest, confidences_rest);
}
