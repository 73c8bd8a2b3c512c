//! Conversion of levels to the reference camera's exposure, four pixels at once.

use vgstereo_core::kernel::{self, LevelConversion};

use super::simd::{
    add_saturating_u8x4, load, select_ge_u8x4, splat_u8, store, sub_saturating_u8x4,
};

/// Equals [`kernel::convert_row`] bit for bit.
pub(super) fn convert_row(
    conversion: &LevelConversion,
    levels: &[u8],
    low: &mut [u8],
    high: &mut [u8],
) {
    let count = levels.len().min(low.len()).min(high.len());
    let whole = count / 4 * 4;
    let (Some((levels, rest)), Some((low, low_rest)), Some((high, high_rest))) = (
        levels.split_at_checked(whole),
        low.split_at_mut_checked(whole),
        high.split_at_mut_checked(whole),
    ) else {
        return;
    };
    let zone = splat_u8(conversion.dead_zone);
    let quads = levels.as_chunks::<4>().0.iter();
    let outputs = low.as_chunks_mut().0.iter_mut();
    let outputs = outputs.zip(high.as_chunks_mut().0);
    for (quad, (low, high)) in quads.zip(outputs) {
        let levels = load(quad);
        let converted = load(&quad.map(|level| conversion.apply(level)));
        // A level at either end of the range may have been clipped, so its interval stays open
        // there.
        let less = sub_saturating_u8x4(converted, zone);
        store(select_ge_u8x4(levels, splat_u8(1), less, levels), low);
        let more = add_saturating_u8x4(converted, zone);
        store(select_ge_u8x4(levels, u32::MAX, levels, more), high);
    }
    kernel::convert_row(conversion, rest, low_rest, high_rest);
}
