//! The instructions of the soft core on the four bytes or two halfwords of a register, as
//! `firmware/boards/softcore/rtl/byte_instructions.sv` has them, and the functions that are one of these each.
//!
//! Byte 0 is the lowest, which is the first in memory. Of this set, this is the only module with `unsafe` code. Each
//! use is an instruction that reads and writes only registers.
//!
//! A result can be used two instructions later without a wait. One of these instructions waits until loads, stores and
//! branches before it are done, which takes two cycles. So loops load all that they take, compute, and store.

/// Executes the instruction with these two parts of its code.
#[inline(always)]
#[must_use]
fn execute<const FUNCT7: u32, const FUNCT3: u32>(a: u32, b: u32) -> u32 {
    #[cfg(all(target_arch = "riscv32", feature = "byte-instructions"))]
    {
        let result;
        // SAFETY: the instruction works on registers alone.
        unsafe {
            core::arch::asm!(
                ".insn r 0x0b, {funct3}, {funct7}, {result}, {a}, {b}",
                funct3 = const FUNCT3, funct7 = const FUNCT7,
                result = lateout(reg) result, a = in(reg) a, b = in(reg) b,
                options(pure, nomem, nostack, preserves_flags),
            );
        }
        result
    }
    #[cfg(not(all(target_arch = "riscv32", feature = "byte-instructions")))]
    {
        super::plain::result_of(FUNCT7, FUNCT3, a, b)
    }
}

/// Defines functions that are one instruction each.
macro_rules! instructions {
    ($($(#[$doc:meta])* $name:ident = $funct7:literal, $funct3:literal;)*) => {
        $(
            $(#[$doc])*
            #[inline(always)]
            #[must_use]
            pub(super) fn $name(a: u32, b: u32) -> u32 {
                execute::<$funct7, $funct3>(a, b)
            }
        )*
    };
}

instructions! {
    /// Adds bytes; sums above 255 become 255.
    add_saturating_u8x4 = 0, 0;
    /// Subtracts bytes; differences below 0 become 0.
    sub_saturating_u8x4 = 0, 1;
    /// The lesser byte of each lane.
    min_u8x4 = 0, 2;
    /// The lesser of the bytes of `b` on both sides of each. On the lower side of the lowest is the highest of `a`; on
    /// the upper side of the highest is none.
    least_beside = 0, 3;
    /// `a`, with the lesser of its highest byte and the lowest of `b` for its highest byte.
    meet_next = 0, 4;
    /// The least byte of both words, in all lanes.
    least_of = 0, 5;
    /// Halves the sums of bytes, rounded down.
    halve_sum_u8x4 = 0, 6;
    /// The products of each byte of `a` with the lowest of `b`, divided by 16, modulo 256.
    products_q4 = 0, 7;
    /// The lesser halfword of each lane.
    min_u16x2 = 2, 0;
    /// The sums of the two lowest bytes, as halfwords.
    sums_low = 2, 1;
    /// The sums of the two highest bytes, as halfwords.
    sums_high = 2, 2;
    /// Absolute differences of bytes.
    distance_u8x4 = 5, 0;
    /// All bits of the bytes in which `a` is at least `b`.
    at_least_u8x4 = 5, 1;
    /// The lesser signed halfword of each lane.
    min_i16x2 = 5, 2;
    /// The greater signed halfword of each lane.
    max_i16x2 = 5, 3;
    /// As many of the lowest bytes of `a` as its highest says, at most three, and then those of `b`.
    join = 6, 0;
    /// The bytes of `b` that [`join`] leaves out, and their number in the highest byte.
    left_of = 6, 1;
}

/// The number of bits in which two words differ, in this byte of a word of zeros.
#[inline(always)]
#[must_use]
pub(super) fn differing_bits<const BYTE: u32>(a: u32, b: u32) -> u32 {
    execute::<1, BYTE>(a, b)
}

/// The sums of the halfwords of `a` and the two lowest bytes of `b`, or the two highest for an odd place, each above six
/// bits with its index: twice the place, which is at most 7, and one more.
#[inline(always)]
#[must_use]
pub(super) fn indexed_sums<const PLACE: u32>(a: u32, b: u32) -> u32 {
    execute::<7, PLACE>(a, b)
}

/// The word that begins at this byte of `a`, 1 to 3, and goes on in `b`.
#[inline(always)]
#[must_use]
pub(super) fn align<const BYTE: u32>(a: u32, b: u32) -> u32 {
    execute::<3, BYTE>(a, b)
}

/// In each byte, this bit is set if that of `a` is greater than that of `b`.
#[inline(always)]
#[must_use]
pub(super) fn greater<const BIT: u32>(a: u32, b: u32) -> u32 {
    execute::<4, BIT>(a, b)
}
