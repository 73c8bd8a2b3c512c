//! Operations on the four bytes or two halfwords of a register.
//!
//! Lane 0 is the lowest, which is the first in memory. Of this set, only this module and loops of assembly in
//! [`path`](super::path), [`mask`](super::mask), [`select`](super::select), [`pack`](super::pack) and
//! [`smooth`](super::smooth) have `unsafe` code.
//! Here each use is an instruction that reads and writes only registers and flags, or loads words of a reference, or it
//! is empty assembly that holds back the optimiser, or a list that is written without a test of its end for each item.

/// Defines a function that is one instruction of two operands, or plain code on other targets.
macro_rules! instruction {
    ($(#[$doc:meta])* $name:ident, $text:literal, $plain:expr) => {
        $(#[$doc])*
        #[inline(always)]
        #[must_use]
        pub(super) fn $name(a: u32, b: u32) -> u32 {
            #[cfg(dsp_extension)]
            {
                let result;
                // SAFETY: the instruction works on registers alone.
                unsafe {
                    core::arch::asm!(
                        concat!($text, " {}, {}, {}"),
                        lateout(reg) result, in(reg) a, in(reg) b,
                        options(pure, nomem, nostack, preserves_flags),
                    );
                }
                result
            }
            #[cfg(not(dsp_extension))]
            {
                $plain(a, b)
            }
        }
    };
}

instruction! {
    /// Adds bytes; sums above 255 become 255.
    add_saturating_u8x4, "uqadd8", lanes::add_saturating::<BYTES>
}
instruction! {
    /// Subtracts bytes; differences below 0 become 0.
    sub_saturating_u8x4, "uqsub8", lanes::sub_saturating::<BYTES>
}
instruction! {
    /// Halves the sums of bytes, rounded down.
    halve_sum_u8x4, "uhadd8", lanes::halve_sum::<BYTES>
}
instruction! {
    /// Halves the differences of bytes, rounded down; the top bit is set if the difference is
    /// negative.
    halve_difference_u8x4, "uhsub8", lanes::halve_difference::<BYTES>
}
instruction! {
    /// Subtracts halfwords; differences below 0 become 0.
    sub_saturating_u16x2, "uqsub16", lanes::sub_saturating::<HALFWORDS>
}
instruction! {
    /// Adds signed halfwords; sums above 32767 become 32767, and those below -32768 become -32768.
    add_saturating_i16x2, "qadd16", |a, b| signed_halfwords(a, b, i16::saturating_add)
}
instruction! {
    /// Subtracts signed halfwords; differences beyond -32768 or 32767 become the nearer of the two.
    sub_saturating_i16x2, "qsub16", |a, b| signed_halfwords(a, b, i16::saturating_sub)
}
instruction! {
    /// Halves the sums of halfwords, rounded down.
    halve_sum_u16x2, "uhadd16", lanes::halve_sum::<HALFWORDS>
}

instruction! {
    /// Adds bytes 0 and 2 of `b` to halfwords `a`.
    add_even_bytes, "uxtab16", |a: u32, b| a.wrapping_add(even_bytes(b))
}

/// Multiplies the signed halfwords of `a` with those of `b`, and adds both products to `sum`, modulo
/// 2^32.
#[inline(always)]
#[must_use]
pub(super) fn add_products_i16x2(a: u32, b: u32, sum: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        let result;
        // SAFETY: the instruction works on registers and a flag alone.
        unsafe {
            core::arch::asm!(
                "smlad {}, {}, {}, {}",
                lateout(reg) result, in(reg) a, in(reg) b, in(reg) sum,
                options(pure, nomem, nostack),
            );
        }
        result
    }
    #[cfg(not(dsp_extension))]
    {
        let signed = |word: u32| i32::from(word as i16);
        let low = signed(a).wrapping_mul(signed(b));
        let high = signed(a >> 16).wrapping_mul(signed(b >> 16));
        sum.wrapping_add_signed(low).wrapping_add_signed(high)
    }
}

/// Returns `sum - a * b`, modulo 2^32.
#[inline(always)]
#[must_use]
pub(super) fn subtract_product(sum: u32, a: u32, b: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        let result;
        // SAFETY: the instruction works on registers alone.
        unsafe {
            core::arch::asm!(
                "mls {}, {}, {}, {}",
                lateout(reg) result, in(reg) a, in(reg) b, in(reg) sum,
                options(pure, nomem, nostack, preserves_flags),
            );
        }
        result
    }
    #[cfg(not(dsp_extension))]
    {
        sum.wrapping_sub(a.wrapping_mul(b))
    }
}

/// Adds bytes 1 and 3 of `b` to halfwords `a`.
#[inline(always)]
#[must_use]
pub(super) fn add_odd_bytes(a: u32, b: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        let result;
        // SAFETY: the instruction works on registers alone.
        unsafe {
            core::arch::asm!(
                "uxtab16 {}, {}, {}, ror #8",
                lateout(reg) result, in(reg) a, in(reg) b,
                options(pure, nomem, nostack, preserves_flags),
            );
        }
        result
    }
    #[cfg(not(dsp_extension))]
    {
        a.wrapping_add(odd_bytes(b))
    }
}

/// Clamps two signed halfwords to 0 to 255; the results are bytes 0 and 2.
#[inline(always)]
#[must_use]
pub(super) fn saturate_to_u8x2(a: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        let result;
        // SAFETY: the instruction works on a register and a flag alone.
        unsafe {
            core::arch::asm!(
                "usat16 {}, #8, {}",
                lateout(reg) result, in(reg) a,
                options(pure, nomem, nostack),
            );
        }
        result
    }
    #[cfg(not(dsp_extension))]
    {
        signed_halfwords(a, 0, |a, _| a.clamp(0, 255))
    }
}

/// Subtracts bytes modulo 256.
#[cfg(not(dsp_extension))]
#[inline(always)]
#[must_use]
pub(super) fn sub_wrapping_u8x4(a: u32, b: u32) -> u32 {
    lanes::difference::<BYTES>(a, b)
}

/// Defines a function that compares all lanes, and selects by the flags that the comparison sets.
/// On other targets, `$plain` returns the comparison as all bits of a lane or none.
macro_rules! selection {
    ($(#[$doc:meta])* $name:ident, $text:literal, $plain:expr) => {
        $(#[$doc])*
        #[inline(always)]
        #[must_use]
        pub(super) fn $name(a: u32, b: u32, yes: u32, no: u32) -> u32 {
            #[cfg(dsp_extension)]
            {
                let result;
                // SAFETY: the instructions work on registers and the flags that they set alone.
                unsafe {
                    core::arch::asm!(
                        concat!($text, " {result}, {a}, {b}"),
                        "sel {result}, {yes}, {no}",
                        result = out(reg) result,
                        a = in(reg) a, b = in(reg) b, yes = in(reg) yes, no = in(reg) no,
                        options(pure, nomem, nostack),
                    );
                }
                result
            }
            #[cfg(not(dsp_extension))]
            {
                let mask = $plain(a, b);
                yes & mask | no & !mask
            }
        }
    };
}

selection! {
    /// Takes the byte of `yes` where the byte of `a` is at least that of `b`, elsewhere the byte of
    /// `no`.
    select_ge_u8x4, "usub8", lanes::at_least::<BYTES>
}
selection! {
    /// Takes the halfword of `yes` where the halfword of `a` is at least that of `b`, elsewhere the
    /// halfword of `no`.
    select_ge_u16x2, "usub16", lanes::at_least::<HALFWORDS>
}
selection! {
    /// Takes the halfword of `yes` where the signed halfword of `a` is at least that of `b`,
    /// elsewhere the halfword of `no`.
    select_ge_i16x2, "ssub16",
    |a, b| lanes::at_least::<HALFWORDS>(a ^ TOPS_I16, b ^ TOPS_I16)
}

/// 1 in each byte in which `a` is at least `b`, elsewhere 0.
#[inline(always)]
#[must_use]
pub(super) fn is_ge_u8x4(a: u32, b: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        select_ge_u8x4(a, b, splat_u8(1), 0)
    }
    #[cfg(not(dsp_extension))]
    {
        lanes::tops_at_least::<BYTES>(a, b) >> (BYTES - 1)
    }
}

/// Subtracts signed halfwords and clamps the differences to 0 to 255; the results are bytes 0 and 2.
#[inline(always)]
#[must_use]
pub(super) fn sub_to_u8x2(a: u32, b: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        saturate_to_u8x2(sub_saturating_i16x2(a, b))
    }
    #[cfg(not(dsp_extension))]
    {
        let difference = |a: u32, b: u32| i32::from(a as i16) - i32::from(b as i16);
        let [low, high] = [difference(a, b), difference(a >> 16, b >> 16)];
        let clamped = |difference: i32| difference.clamp(0, 255).cast_unsigned();
        clamped(low) | clamped(high) << 16
    }
}

/// Returns the word unchanged, but hides from the compiler how it was computed, so that
/// computations before and after it are not merged. Takes no instruction.
#[inline(always)]
#[must_use]
pub(super) fn opaque(word: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        let mut word = word;
        // SAFETY: there is no instruction.
        unsafe {
            core::arch::asm!("/* {} */", inout(reg) word,
                options(pure, nomem, nostack, preserves_flags));
        }
        word
    }
    #[cfg(not(dsp_extension))]
    {
        word
    }
}

/// Returns the word unchanged, and keeps memory accesses that are before it in the code before
/// those that are after it. The compiler would otherwise load early, and spill registers for it.
/// Takes no instruction.
#[inline(always)]
#[must_use]
pub(crate) fn in_order(word: u32) -> u32 {
    #[cfg(any(dsp_extension, target_arch = "riscv32"))]
    {
        let mut word = word;
        // SAFETY: there is no instruction. Not pure, and so not moved past memory accesses.
        unsafe {
            core::arch::asm!("/* {} */", inout(reg) word,
                options(nomem, nostack, preserves_flags));
        }
        word
    }
    #[cfg(not(any(dsp_extension, target_arch = "riscv32")))]
    {
        word
    }
}

/// Returns the reference unchanged, but makes the compiler load the value from memory again. It
/// would otherwise keep what it has loaded already, and spill registers for it. Takes no
/// instruction.
#[inline(always)]
#[must_use]
pub(super) fn afresh<T>(value: &T) -> &T {
    #[cfg(dsp_extension)]
    {
        let mut value: *const T = value;
        // SAFETY: there is no instruction, and the pointer is that of the reference. `readonly`
        // makes the compiler write the value to memory before.
        unsafe {
            core::arch::asm!("/* {} */", inout(reg) value,
                options(readonly, nostack, preserves_flags));
            &*value
        }
    }
    #[cfg(not(dsp_extension))]
    {
        value
    }
}

/// Loads six words by one instruction.
#[inline(always)]
#[must_use]
pub(super) fn load_six(words: &[u32; 6]) -> [u32; 6] {
    #[cfg(dsp_extension)]
    {
        let (a, b, c, d, e, f);
        // SAFETY: the instruction reads the words of the reference, which are aligned.
        unsafe {
            core::arch::asm!(
                "ldm {}, {{r0, r1, r2, r3, r4, r5}}",
                in(reg) words,
                lateout("r0") a, lateout("r1") b, lateout("r2") c,
                lateout("r3") d, lateout("r4") e, lateout("r5") f,
                options(pure, readonly, nostack, preserves_flags),
            );
        }
        [a, b, c, d, e, f]
    }
    #[cfg(not(dsp_extension))]
    {
        *words
    }
}

/// Loads four words by one instruction.
#[inline(always)]
#[must_use]
pub(super) fn load_four(words: &[u32; 4]) -> [u32; 4] {
    #[cfg(dsp_extension)]
    {
        let (a, b, c, d);
        // SAFETY: the instruction reads the words of the reference, which are aligned.
        unsafe {
            core::arch::asm!(
                "ldm {}, {{r0, r1, r2, r3}}",
                in(reg) words,
                lateout("r0") a, lateout("r1") b, lateout("r2") c, lateout("r3") d,
                options(pure, readonly, nostack, preserves_flags),
            );
        }
        [a, b, c, d]
    }
    #[cfg(not(dsp_extension))]
    {
        *words
    }
}

/// Meets all words, the first with the second, the outcome with the third and so on; all ones if there are
/// none. Six are loaded at a time.
#[inline(always)]
#[must_use]
pub(super) fn meet_all(words: &[u32], meet: impl Fn(u32, u32) -> u32) -> u32 {
    let (sixes, rest) = words.as_chunks();
    let mut met = None;
    let mut take = |word| met = Some(met.map_or(word, |met| meet(met, word)));
    for six in sixes {
        load_six(six).into_iter().for_each(&mut take);
    }
    rest.iter().for_each(|&word| take(word));
    met.unwrap_or(u32::MAX)
}

/// The smaller byte of each lane.
#[inline(always)]
#[must_use]
pub(super) fn min_u8x4(a: u32, b: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        // No byte borrows.
        a.wrapping_sub(sub_saturating_u8x4(a, b))
    }
    #[cfg(not(dsp_extension))]
    {
        lanes::min::<BYTES>(a, b)
    }
}

/// The larger byte of each lane.
#[inline(always)]
#[must_use]
pub(super) fn max_u8x4(a: u32, b: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        // No byte carries.
        b.wrapping_add(sub_saturating_u8x4(a, b))
    }
    #[cfg(not(dsp_extension))]
    {
        lanes::max::<BYTES>(a, b)
    }
}

/// Absolute differences of bytes.
#[inline(always)]
#[must_use]
pub(super) fn distance_u8x4(a: u32, b: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        // One of the two differences is 0.
        sub_saturating_u8x4(a, b) | sub_saturating_u8x4(b, a)
    }
    #[cfg(not(dsp_extension))]
    {
        lanes::distance::<BYTES>(a, b)
    }
}

/// The smaller halfword of each lane.
#[inline(always)]
#[must_use]
pub(super) fn min_u16x2(a: u32, b: u32) -> u32 {
    #[cfg(dsp_extension)]
    {
        // No halfword borrows.
        a.wrapping_sub(sub_saturating_u16x2(a, b))
    }
    #[cfg(not(dsp_extension))]
    {
        lanes::min::<HALFWORDS>(a, b)
    }
}

/// The smaller signed halfword of each lane.
#[inline(always)]
#[must_use]
pub(super) fn min_i16x2(a: u32, b: u32) -> u32 {
    #[cfg(xpulp)]
    {
        crate::xpulp::min_i16x2(a, b)
    }
    #[cfg(not(xpulp))]
    {
        select_ge_i16x2(a, b, b, a)
    }
}

/// The larger signed halfword of each lane.
#[inline(always)]
#[must_use]
pub(super) fn max_i16x2(a: u32, b: u32) -> u32 {
    #[cfg(xpulp)]
    {
        crate::xpulp::max_i16x2(a, b)
    }
    #[cfg(not(xpulp))]
    {
        select_ge_i16x2(a, b, a, b)
    }
}

/// The smaller signed halfword of each lane, and the larger one.
#[inline(always)]
#[must_use]
pub(super) fn order_i16x2(a: u32, b: u32) -> [u32; 2] {
    #[cfg(dsp_extension)]
    {
        let (smaller, larger);
        // SAFETY: the instructions work on registers and flags alone.
        unsafe {
            core::arch::asm!(
                "ssub16 {smaller}, {a}, {b}",
                "sel {smaller}, {b}, {a}",
                "sel {larger}, {a}, {b}",
                smaller = out(reg) smaller, larger = lateout(reg) larger,
                a = in(reg) a, b = in(reg) b,
                options(pure, nomem, nostack),
            );
        }
        [smaller, larger]
    }
    #[cfg(not(dsp_extension))]
    {
        [min_i16x2(a, b), max_i16x2(a, b)]
    }
}

/// Writes what `item` makes of the numbers below `count`, if anything, one after the other, and returns how many there
/// are. `None` if `list` is shorter than `count`: there is room for all, and no test for each.
#[inline(always)]
pub(super) fn list_some<T: Copy>(
    list: &mut [T],
    count: usize,
    mut item: impl FnMut(usize) -> Option<T>,
) -> Option<usize> {
    let first: *mut T = list.get_mut(..count)?.as_mut_ptr();
    let mut next = first;
    for index in 0..count {
        if let Some(item) = item(index) {
            // SAFETY: of `count` items there are no more than places from `first` on.
            unsafe {
                next.write(item);
                next = next.add(1);
            }
        }
    }
    Some((next.addr() - first.addr()) / size_of::<T>().max(1))
}

/// Widens bytes 0 and 2 to halfwords.
#[inline(always)]
#[must_use]
pub(crate) fn even_bytes(a: u32) -> u32 {
    a & 0x00ff_00ff
}

/// Widens bytes 1 and 3 to halfwords.
#[inline(always)]
#[must_use]
pub(crate) fn odd_bytes(a: u32) -> u32 {
    #[cfg(xpulp)]
    {
        crate::xpulp::odd_bytes(a)
    }
    #[cfg(not(xpulp))]
    {
        a >> 8 & 0x00ff_00ff
    }
}

/// The byte in all four lanes.
#[inline(always)]
#[must_use]
pub(crate) const fn splat_u8(byte: u8) -> u32 {
    // One multiplication at run time; folded if the byte is a constant.
    byte as u32 * 0x0101_0101
}

/// The halfword in both lanes.
#[inline(always)]
#[must_use]
pub(crate) const fn splat_u16(halfword: u16) -> u32 {
    (halfword as u32) << 16 | halfword as u32
}

/// Loads four bytes in the order of memory; they need no alignment.
#[inline(always)]
#[must_use]
pub(super) const fn load(bytes: &[u8; 4]) -> u32 {
    u32::from_le_bytes(*bytes)
}

/// Stores four bytes in the order of memory; they need no alignment.
#[inline(always)]
pub(super) const fn store(word: u32, bytes: &mut [u8; 4]) {
    *bytes = word.to_le_bytes();
}

/// Packs two signed halfwords into a word, the first in the low half.
#[inline(always)]
#[must_use]
pub(crate) const fn pair_of(&[low, high]: &[i16; 2]) -> u32 {
    (high.cast_unsigned() as u32) << 16 | low.cast_unsigned() as u32
}

#[cfg(not(dsp_extension))]
fn halfwords(a: u32, b: u32, each: impl Fn(u16, u16) -> u16) -> u32 {
    let low = each(a as u16, b as u16);
    let high = each((a >> 16) as u16, (b >> 16) as u16);
    u32::from(high) << 16 | u32::from(low)
}

#[cfg(not(dsp_extension))]
fn signed_halfwords(a: u32, b: u32, each: impl Fn(i16, i16) -> i16) -> u32 {
    halfwords(a, b, |a, b| {
        each(a.cast_signed(), b.cast_signed()).cast_unsigned()
    })
}

/// Replacements by instructions of Xpulp, on processors that have these.
#[cfg(xpulp)]
use crate::xpulp::lanes;

/// Number of bits per lane.
#[cfg(not(dsp_extension))]
const BYTES: u32 = 8;
#[cfg(not(dsp_extension))]
const HALFWORDS: u32 = 16;

/// Top bit of each halfword.
#[cfg(not(dsp_extension))]
const TOPS_I16: u32 = 0x8000_8000;

/// Replacements of the instructions by operations on whole registers: lanes of `BITS` bits, none of
/// which carries or borrows into the next. For processors without such instructions, such as
/// RISC-V.
#[cfg(not(any(dsp_extension, xpulp)))]
mod lanes {
    /// Top bit of each lane.
    #[inline(always)]
    pub(super) const fn tops(bits: u32) -> u32 {
        if bits == super::BYTES {
            0x8080_8080
        } else {
            0x8000_8000
        }
    }

    /// Differences modulo 2^`BITS`.
    #[inline(always)]
    pub(super) fn difference<const BITS: u32>(a: u32, b: u32) -> u32 {
        let tops = tops(BITS);
        ((a | tops) - (b & !tops)) ^ ((a ^ !b) & tops)
    }

    /// Top bit of each lane in which `a` is at least `b`.
    #[inline(always)]
    pub(super) fn tops_at_least<const BITS: u32>(a: u32, b: u32) -> u32 {
        let tops = tops(BITS);
        // Where the top bits are alike, the lower bits decide.
        let lower = (a | tops) - (b & !tops);
        (lower ^ ((lower ^ a) & (a ^ b))) & tops
    }

    /// All bits of the lanes whose top bit is set.
    #[inline(always)]
    fn spread<const BITS: u32>(tops: u32) -> u32 {
        (tops << 1).wrapping_sub(tops >> (BITS - 1))
    }

    /// All bits of the lanes in which `a` is at least `b`.
    #[inline(always)]
    pub(super) fn at_least<const BITS: u32>(a: u32, b: u32) -> u32 {
        spread::<BITS>(tops_at_least::<BITS>(a, b))
    }

    #[inline(always)]
    pub(super) fn add_saturating<const BITS: u32>(a: u32, b: u32) -> u32 {
        let tops = tops(BITS);
        let lower = (a & !tops) + (b & !tops);
        let carries = (a & b | (a ^ b) & lower) & tops;
        lower ^ (a ^ b) & tops | spread::<BITS>(carries)
    }

    #[inline(always)]
    pub(super) fn sub_saturating<const BITS: u32>(a: u32, b: u32) -> u32 {
        difference::<BITS>(a, b) & at_least::<BITS>(a, b)
    }

    #[inline(always)]
    pub(super) fn min<const BITS: u32>(a: u32, b: u32) -> u32 {
        a ^ (a ^ b) & at_least::<BITS>(a, b)
    }

    #[inline(always)]
    pub(super) fn max<const BITS: u32>(a: u32, b: u32) -> u32 {
        b ^ (a ^ b) & at_least::<BITS>(a, b)
    }

    #[inline(always)]
    pub(super) fn distance<const BITS: u32>(a: u32, b: u32) -> u32 {
        let below = tops_at_least::<BITS>(a, b) ^ tops(BITS);
        // Negative differences are not 0, so that no lane carries.
        (difference::<BITS>(a, b) ^ spread::<BITS>(below)) + (below >> (BITS - 1))
    }

    #[inline(always)]
    pub(super) fn halve_sum<const BITS: u32>(a: u32, b: u32) -> u32 {
        (a & b) + ((a ^ b) >> 1 & !tops(BITS))
    }

    #[inline(always)]
    pub(super) fn halve_difference<const BITS: u32>(a: u32, b: u32) -> u32 {
        difference::<BITS>((a ^ b) >> 1 & !tops(BITS), !a & b)
    }
}

#[cfg(all(test, not(dsp_extension)))]
mod tests {
    use super::*;

    fn bytes(a: u32, b: u32, each: impl Fn(u8, u8) -> u8) -> u32 {
        let (a, b) = (a.to_le_bytes(), b.to_le_bytes());
        u32::from_le_bytes(core::array::from_fn(|lane| each(a[lane], b[lane])))
    }

    /// Compared with the same operation lane by lane, on pairs of 16-bit patterns in which all
    /// bytes occur beside various others.
    #[test]
    fn lanes_do_not_touch_each_other() {
        for word in 0..=u32::from(u16::MAX) {
            let a = word * 0x1_0001;
            let b = word.wrapping_mul(0x9e37_79b9) ^ a.rotate_left(8);
            let ge = |yes: bool| if yes { u8::MAX } else { 0 };
            assert_eq!(add_saturating_u8x4(a, b), bytes(a, b, u8::saturating_add));
            assert_eq!(sub_saturating_u8x4(a, b), bytes(a, b, u8::saturating_sub));
            assert_eq!(sub_wrapping_u8x4(a, b), bytes(a, b, u8::wrapping_sub));
            assert_eq!(halve_sum_u8x4(a, b), bytes(a, b, u8::midpoint));
            let halved = |a: u8, b: u8| ((i16::from(a) - i16::from(b)) >> 1) as u8;
            assert_eq!(halve_difference_u8x4(a, b), bytes(a, b, halved));
            let found = select_ge_u8x4(a, b, u32::MAX, 0);
            assert_eq!(found, bytes(a, b, |a, b| ge(a >= b)));
            assert_eq!(is_ge_u8x4(a, b), bytes(a, b, |a, b| (a >= b).into()));
            assert_eq!(min_u8x4(a, b), bytes(a, b, u8::min));
            assert_eq!(max_u8x4(a, b), bytes(a, b, u8::max));
            assert_eq!(distance_u8x4(a, b), bytes(a, b, u8::abs_diff));
            assert_eq!(min_u16x2(a, b), halfwords(a, b, u16::min));
            let clamped = |a: i16, b: i16| a.saturating_sub(b).clamp(0, 255);
            assert_eq!(sub_to_u8x2(a, b), signed_halfwords(a, b, clamped));
            assert_eq!(
                sub_saturating_u16x2(a, b),
                halfwords(a, b, u16::saturating_sub)
            );
            assert_eq!(halve_sum_u16x2(a, b), halfwords(a, b, u16::midpoint));
            let ge = |yes: bool| if yes { u16::MAX } else { 0 };
            let found = select_ge_u16x2(a, b, u32::MAX, 0);
            assert_eq!(found, halfwords(a, b, |a, b| ge(a >= b)));
            let found = select_ge_i16x2(a, b, u32::MAX, 0);
            let signed = |a: u16, b: u16| ge(a.cast_signed() >= b.cast_signed());
            assert_eq!(found, halfwords(a, b, signed));
        }
    }
}
