//! The instructions of Xpulp (CORE-V extensions, version 1.8) that kernels use, as CV32E40P has them, and the functions that
//! are one of these each. Elsewhere plain code stands in for them.
//!
//! Byte 0 is the lowest, which is the first in memory. This is the only module with `unsafe` code for them. Each use is an
//! instruction that reads and writes only registers. They are encoded here, as the compiler's own use of these extensions
//! was found to give wrong code.

#[cfg(any(test, xpulp))]
pub(crate) mod lanes;

/// Defines functions of two words that are one instruction each: parts of its code, and the plain code.
macro_rules! instructions {
    ($($(#[$doc:meta])* $name:ident = $opcode:literal, $funct3:literal, $funct7:literal, $plain:expr;)*) => {
        $(
            $(#[$doc])*
            #[inline(always)]
            #[must_use]
            pub(crate) fn $name(a: u32, b: u32) -> u32 {
                #[cfg(xpulp)]
                {
                    let result;
                    // SAFETY: the instruction works on registers alone.
                    unsafe {
                        core::arch::asm!(
                            concat!(".insn r ", $opcode, ", ", $funct3, ", ", $funct7, ", {}, {}, {}"),
                            lateout(reg) result, in(reg) a, in(reg) b,
                            options(pure, nomem, nostack, preserves_flags),
                        );
                    }
                    result
                }
                #[cfg(not(xpulp))]
                {
                    $plain(a, b)
                }
            }
        )*
    };
}

instructions! {
    /// `cv.sub.b`: subtracts bytes, modulo 256.
    sub_u8x4 = "0x7b", "1", "0x04", |a, b| bytes(a, b, u8::wrapping_sub);
    /// `cv.sub.h`: subtracts halfwords, modulo 65536.
    sub_u16x2 = "0x7b", "0", "0x04", |a, b| halfwords(a, b, u16::wrapping_sub);
    /// `cv.minu.b`: the lesser byte of each lane.
    min_u8x4 = "0x7b", "1", "0x14", |a, b| bytes(a, b, u8::min);
    /// `cv.minu.h`: the lesser halfword of each lane.
    min_u16x2 = "0x7b", "0", "0x14", |a, b| halfwords(a, b, u16::min);
    /// `cv.maxu.b`: the greater byte of each lane.
    max_u8x4 = "0x7b", "1", "0x1c", |a, b| bytes(a, b, u8::max);
    /// `cv.maxu.h`: the greater halfword of each lane.
    max_u16x2 = "0x7b", "0", "0x1c", |a, b| halfwords(a, b, u16::max);
    /// `cv.min.h`: the lesser signed halfword of each lane.
    min_i16x2 = "0x7b", "0", "0x10", |a, b| signed_halfwords(a, b, i16::min);
    /// `cv.max.h`: the greater signed halfword of each lane.
    max_i16x2 = "0x7b", "0", "0x18", |a, b| signed_halfwords(a, b, i16::max);
    /// `cv.cmpgeu.b`: all bits of the bytes in which `a` is at least `b`.
    at_least_u8x4 = "0x7b", "1", "0x1e", |a, b| bytes(a, b, |a, b| if a >= b { u8::MAX } else { 0 });
    /// `cv.cmpgeu.h`: all bits of the halfwords in which `a` is at least `b`.
    at_least_u16x2 = "0x7b", "0", "0x1e", |a, b| halfwords(a, b, |a, b| if a >= b { u16::MAX } else { 0 });
    /// `cv.cmpgtu.b`: all bits of the bytes in which `a` is greater than `b`.
    greater_u8x4 = "0x7b", "1", "0x1a", |a, b| bytes(a, b, |a, b| if a > b { u8::MAX } else { 0 });
    /// `cv.pack`: the low halfword of `b` below that of `a`.
    low_halves = "0x7b", "0", "0x78", |a: u32, b: u32| a << 16 | b & 0xffff;
    /// `cv.pack.h`: the high halfword of `b` below that of `a`.
    high_halves = "0x7b", "0", "0x79", |a: u32, b: u32| a & 0xffff_0000 | b >> 16;
}

/// Defines functions of one word that are one instruction each: parts of its code, the second register among them, which
/// stands for a constant, and the plain code.
macro_rules! constant_instructions {
    ($($(#[$doc:meta])* $name:ident = $opcode:literal, $funct3:literal, $funct7:literal, $constant:literal, $plain:expr;)*) => {
        $(
            $(#[$doc])*
            #[inline(always)]
            #[must_use]
            pub(crate) fn $name(a: u32) -> u32 {
                #[cfg(xpulp)]
                {
                    let result;
                    // SAFETY: the instruction works on registers alone.
                    unsafe {
                        core::arch::asm!(
                            concat!(".insn r ", $opcode, ", ", $funct3, ", ", $funct7, ", {}, {}, ", $constant),
                            lateout(reg) result, in(reg) a,
                            options(pure, nomem, nostack, preserves_flags),
                        );
                    }
                    result
                }
                #[cfg(not(xpulp))]
                {
                    $plain(a)
                }
            }
        )*
    };
}

constant_instructions! {
    /// `cv.cnt`: the number of ones.
    count_ones = "0x2b", "3", "0x24", "x0", u32::count_ones;
    /// `cv.srl.sci.b`: halves bytes, rounded down.
    halve_u8x4 = "0x7b", "7", "0x21", "x0", |a: u32| a >> 1 & 0x7f7f_7f7f;
    /// `cv.srl.sci.b`: divides bytes by 16, rounded down.
    sixteenth_u8x4 = "0x7b", "7", "0x20", "x2", |a: u32| a >> 4 & 0x0f0f_0f0f;
    /// `cv.srl.sci.h`: halves halfwords, rounded down.
    halve_u16x2 = "0x7b", "6", "0x21", "x0", |a: u32| a >> 1 & 0x7fff_7fff;
    /// `cv.srl.sci.h`: widens bytes 1 and 3 to halfwords.
    odd_bytes = "0x7b", "6", "0x20", "x4", |a: u32| a >> 8 & 0x00ff_00ff;
}

/// Defines functions that change a word by two others, and are one instruction each: parts of its code, and the plain code.
macro_rules! changing_instructions {
    ($($(#[$doc:meta])* $name:ident = $opcode:literal, $funct3:literal, $funct7:literal, $plain:expr;)*) => {
        $(
            $(#[$doc])*
            #[inline(always)]
            #[must_use]
            pub(crate) fn $name(word: u32, a: u32, b: u32) -> u32 {
                #[cfg(xpulp)]
                {
                    let mut word = word;
                    // SAFETY: the instruction works on registers alone.
                    unsafe {
                        core::arch::asm!(
                            concat!(".insn r ", $opcode, ", ", $funct3, ", ", $funct7, ", {}, {}, {}"),
                            inout(reg) word, in(reg) a, in(reg) b,
                            options(pure, nomem, nostack, preserves_flags),
                        );
                    }
                    word
                }
                #[cfg(not(xpulp))]
                {
                    $plain(word, a, b)
                }
            }
        )*
    };
}

changing_instructions! {
    /// `cv.packhi.b`: the word with byte 0 of `a` in byte 3 and that of `b` in byte 2.
    pack_high = "0x7b", "1", "0x7d", |word: u32, a: u32, b: u32| word & 0xffff | a << 24 | (b & 0xff) << 16;
    /// `cv.shuffle2.b`: each byte is that of the word, or of `a`, whose number is in that byte of `b`: 0 to 3 for those of the
    /// word, 4 to 7 for those of `a`.
    shuffle = "0x7b", "1", "0x70", |word: u32, a: u32, b: u32| {
        let both = u64::from(a) << 32 | u64::from(word);
        bytes(b, 0, |from, _| (both >> (8 * (from & 7))) as u8)
    };
}

/// Defines functions that put a byte of another word into a word, and are one instruction each: its constant, and the
/// number of the byte.
macro_rules! insertions {
    ($($name:ident = $constant:literal, $byte:literal;)*) => {
        $(
            /// `cv.insert.b`: the word with byte 0 of `a` in the byte that the name tells.
            #[inline(always)]
            #[must_use]
            pub(crate) fn $name(word: u32, a: u32) -> u32 {
                #[cfg(xpulp)]
                {
                    let mut word = word;
                    // SAFETY: the instruction works on registers alone.
                    unsafe {
                        core::arch::asm!(
                            concat!(".insn r 0x7b, 5, 0x5d, {}, {}, ", $constant),
                            inout(reg) word, in(reg) a,
                            options(pure, nomem, nostack, preserves_flags),
                        );
                    }
                    word
                }
                #[cfg(not(xpulp))]
                {
                    word & !(0xff << (8 * $byte)) | (a & 0xff) << (8 * $byte)
                }
            }
        )*
    };
}

insertions! {
    insert_1 = "x0", 1;
    insert_3 = "x1", 3;
}

/// Each byte of two words to that of the result.
#[cfg(any(test, not(xpulp)))]
fn bytes(a: u32, b: u32, each: impl Fn(u8, u8) -> u8) -> u32 {
    let (a, b) = (a.to_le_bytes(), b.to_le_bytes());
    u32::from_le_bytes(core::array::from_fn(|lane| each(a[lane], b[lane])))
}

/// Each halfword of two words to that of the result.
#[cfg(any(test, not(xpulp)))]
fn halfwords(a: u32, b: u32, each: impl Fn(u16, u16) -> u16) -> u32 {
    let low = each(a as u16, b as u16);
    let high = each((a >> 16) as u16, (b >> 16) as u16);
    u32::from(high) << 16 | u32::from(low)
}

#[cfg(any(test, not(xpulp)))]
fn signed_halfwords(a: u32, b: u32, each: impl Fn(i16, i16) -> i16) -> u32 {
    halfwords(a, b, |a, b| {
        each(a.cast_signed(), b.cast_signed()).cast_unsigned()
    })
}
