//! Operations on lanes of `BITS` bits, 8 or 16, by a few instructions of Xpulp each, in place of a dozen ordinary ones.

const BYTES: u32 = 8;

/// Differences modulo 2^`BITS`.
#[inline(always)]
pub(crate) fn difference<const BITS: u32>(a: u32, b: u32) -> u32 {
    if BITS == BYTES {
        super::sub_u8x4(a, b)
    } else {
        super::sub_u16x2(a, b)
    }
}

/// Top bit of each lane in which `a` is at least `b`.
#[inline(always)]
pub(crate) fn tops_at_least<const BITS: u32>(a: u32, b: u32) -> u32 {
    let tops = if BITS == BYTES {
        0x8080_8080
    } else {
        0x8000_8000
    };
    at_least::<BITS>(a, b) & tops
}

/// All bits of the lanes in which `a` is at least `b`.
#[inline(always)]
pub(crate) fn at_least<const BITS: u32>(a: u32, b: u32) -> u32 {
    if BITS == BYTES {
        super::at_least_u8x4(a, b)
    } else {
        super::at_least_u16x2(a, b)
    }
}

#[inline(always)]
pub(crate) fn add_saturating<const BITS: u32>(a: u32, b: u32) -> u32 {
    // No lane carries.
    min::<BITS>(a, !b).wrapping_add(b)
}

#[inline(always)]
pub(crate) fn sub_saturating<const BITS: u32>(a: u32, b: u32) -> u32 {
    // No lane borrows.
    max::<BITS>(a, b).wrapping_sub(b)
}

#[inline(always)]
pub(crate) fn min<const BITS: u32>(a: u32, b: u32) -> u32 {
    if BITS == BYTES {
        super::min_u8x4(a, b)
    } else {
        super::min_u16x2(a, b)
    }
}

#[inline(always)]
pub(crate) fn max<const BITS: u32>(a: u32, b: u32) -> u32 {
    if BITS == BYTES {
        super::max_u8x4(a, b)
    } else {
        super::max_u16x2(a, b)
    }
}

#[inline(always)]
pub(crate) fn distance<const BITS: u32>(a: u32, b: u32) -> u32 {
    max::<BITS>(a, b).wrapping_sub(min::<BITS>(a, b))
}

#[inline(always)]
pub(crate) fn halve_sum<const BITS: u32>(a: u32, b: u32) -> u32 {
    (a & b).wrapping_add(halve::<BITS>(a ^ b))
}

#[inline(always)]
pub(crate) fn halve_difference<const BITS: u32>(a: u32, b: u32) -> u32 {
    difference::<BITS>(halve::<BITS>(a ^ b), !a & b)
}

#[inline(always)]
fn halve<const BITS: u32>(a: u32) -> u32 {
    if BITS == BYTES {
        super::halve_u8x4(a)
    } else {
        super::halve_u16x2(a)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{bytes, halfwords};
    use super::*;

    const HALFWORDS: u32 = 16;

    /// Compared with the same operation lane by lane, on pairs of 16-bit patterns in which all bytes occur beside various
    /// others.
    #[test]
    fn lanes_do_not_touch_each_other() {
        for word in 0..=u32::from(u16::MAX) {
            let a = word * 0x1_0001;
            let b = word.wrapping_mul(0x9e37_79b9) ^ a.rotate_left(8);
            let ge = |a: u8, b: u8| if a >= b { u8::MAX } else { 0 };
            let ge_wide = |a: u16, b: u16| if a >= b { u16::MAX } else { 0 };
            let halved = |a: u8, b: u8| ((i16::from(a) - i16::from(b)) >> 1) as u8;
            for (found, expected) in [
                (difference::<BYTES>(a, b), bytes(a, b, u8::wrapping_sub)),
                (tops_at_least::<BYTES>(a, b), bytes(a, b, ge) & 0x8080_8080),
                (at_least::<BYTES>(a, b), bytes(a, b, ge)),
                (
                    add_saturating::<BYTES>(a, b),
                    bytes(a, b, u8::saturating_add),
                ),
                (
                    sub_saturating::<BYTES>(a, b),
                    bytes(a, b, u8::saturating_sub),
                ),
                (min::<BYTES>(a, b), bytes(a, b, u8::min)),
                (max::<BYTES>(a, b), bytes(a, b, u8::max)),
                (distance::<BYTES>(a, b), bytes(a, b, u8::abs_diff)),
                (halve_sum::<BYTES>(a, b), bytes(a, b, u8::midpoint)),
                (halve_difference::<BYTES>(a, b), bytes(a, b, halved)),
                (at_least::<HALFWORDS>(a, b), halfwords(a, b, ge_wide)),
                (
                    tops_at_least::<HALFWORDS>(a, b),
                    halfwords(a, b, ge_wide) & 0x8000_8000,
                ),
                (min::<HALFWORDS>(a, b), halfwords(a, b, u16::min)),
                (
                    sub_saturating::<HALFWORDS>(a, b),
                    halfwords(a, b, u16::saturating_sub),
                ),
                (
                    add_saturating::<HALFWORDS>(a, b),
                    halfwords(a, b, u16::saturating_add),
                ),
                (halve_sum::<HALFWORDS>(a, b), halfwords(a, b, u16::midpoint)),
                (distance::<HALFWORDS>(a, b), halfwords(a, b, u16::abs_diff)),
            ] {
                assert_eq!(found, expected, "{a:#x} {b:#x}");
            }
        }
    }
}
