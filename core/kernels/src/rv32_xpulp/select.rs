//! Winner-take-all selection from up to 64 disparities, two keys to a register, as in
//! [`rv32_bytes`](crate::rv32_bytes). The keys of the positions of the other view lie in order, so that those of a pixel are
//! words at any halfword.

use bytemuck::{must_cast_slice_mut, try_cast_slice};
use vgstereo_core::kernel::{self, AggregateRow};

use crate::armv7em::select::{DISPARITIES_MIN, INDEX_BITS, Subpixel};
use crate::armv7em::simd::{even_bytes, in_order, odd_bytes, splat_u16};
use crate::rv32_bytes::select::{Keys, NO_KEYS, select, unpack};
use crate::xpulp::{high_halves, low_halves, min_u16x2};

/// Equals [`kernel::select_row`] bit for bit.
pub(super) fn select_row(row: &mut AggregateRow<'_>) {
    let fits = (DISPARITIES_MIN..=row.stride).contains(&row.disparities);
    let selected = match row.stride {
        16 if fits => select_pixels::<4>(row),
        32 if fits => select_pixels::<8>(row),
        48 if fits => select_pixels::<12>(row),
        64 if fits => select_pixels::<16>(row),
        _ => None,
    };
    if selected.is_none() {
        kernel::select_row(row);
    }
}

/// Selects from the sums of path costs of `4 * WORDS` disparities; returns `None` if the rows are not aligned to words, or
/// that of the other view's best is too short.
#[inline(never)]
fn select_pixels<const WORDS: usize>(row: &mut AggregateRow<'_>) -> Option<()> {
    let from_left: &[u32] = try_cast_slice(row.costs).ok()?;
    let from_right: &[u32] = try_cast_slice(row.from_right).ok()?;
    let from_above: &[u32] = try_cast_slice(row.from_above).ok()?;
    let subpixel = Subpixel::new(&row.subpixel);
    let (count, disparities) = (row.best.len(), row.disparities);
    // The keys of all positions, packed, lie in the first half of the row.
    let reached = (count + disparities).saturating_sub(1);
    row.other_best.get(..reached.max(count + row.stride))?;
    row.other_best.fill(NO_KEYS);
    let others: &mut [u8] = must_cast_slice_mut(row.other_best);
    let mut keys: Keys = [NO_KEYS; _];
    let paths = from_left
        .as_chunks::<WORDS>()
        .0
        .iter()
        .zip(from_right.as_chunks::<WORDS>().0)
        .zip(from_above.as_chunks::<WORDS>().0);
    let outputs = row.best.iter_mut().zip(row.refined_index_q4.iter_mut());
    let outputs = outputs.zip(row.margins.iter_mut());
    for ((((left, right), above), ((best, refined_index_q4), margin)), start) in
        paths.zip(outputs).zip((0..count).rev())
    {
        let others = others.get_mut(2 * start..)?.as_chunks_mut().0;
        let others = others.get_mut(..2 * WORDS)?;
        let key = meet([left, right, above], others, &mut keys);
        let selected = select(min_u16x2, key, &mut keys, disparities, WORDS, &subpixel);
        *best = selected.index;
        *refined_index_q4 = selected.refined_index_q4;
        *margin = selected.margin;
    }
    unpack(row.other_best, reached);
    Some(())
}

/// Makes the keys of a pixel, meets them with those of the positions of the other view that its disparities reach, and
/// returns the least.
#[inline(always)]
fn meet<const WORDS: usize>(
    [left, right, above]: [&[u32; WORDS]; 3],
    others: &mut [[u8; 4]],
    [_, keys @ ..]: &mut Keys,
) -> u32 {
    let (mut least, mut indices) = (NO_KEYS, 2 << 16);
    // Not by a closure or a loop, which the compiler would not unroll so often.
    macro_rules! meet {
        ($($word:literal)+) => {
            $(if $word < WORDS {
                let path = |path: &[u32; WORDS]| path[$word % WORDS];
                let [even, odd] = sums(path(left), path(right), path(above));
                let even = (even << INDEX_BITS) + indices;
                let odd = (odd << INDEX_BITS) + (indices + splat_u16(1));
                indices += splat_u16(4);
                least = min_u16x2(least, min_u16x2(even, odd));
                let found = [low_halves(odd, even), high_halves(odd, even)];
                for (found, place) in found.into_iter().zip(2 * $word..) {
                    keys[place] = found;
                    if let Some(other) = others.get_mut(place) {
                        *other = min_u16x2(u32::from_le_bytes(*other), found).to_le_bytes();
                    }
                }
                if $word % 2 == 1 {
                    // Not all words at once, because there are too few registers.
                    indices = in_order(indices);
                }
            })+
        };
    }
    meet!(0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);
    let _ = indices;
    min_u16x2(least, least >> 16) & 0xffff
}

/// The sums of three path costs each, of even and of odd disparities.
#[inline(always)]
fn sums(left: u32, right: u32, above: u32) -> [u32; 2] {
    [
        even_bytes(left) + even_bytes(right) + even_bytes(above),
        odd_bytes(left) + odd_bytes(right) + odd_bytes(above),
    ]
}
