//! Plain Rust for each byte instruction. [`instructions`](super::instructions) calls it on processors that do not have
//! them, and a test compares the FPGA's logic with it.

/// Returns the 32-bit result of the instruction with these two parts of its code; 0 if there is no such instruction.
#[inline(always)]
#[must_use]
pub(super) fn result_of(funct7: u32, funct3: u32, a: u32, b: u32) -> u32 {
    let byte = |word: u32, index: u32| word >> (8 * index) & 0xff;
    let half = |word: u32, index: u32| word >> (16 * index) & 0xffff;
    let shift = |word: u32| 8 * (word >> 24 & 3);
    match (funct7, funct3) {
        (0, 0) => bytes(a, b, u8::saturating_add),
        (0, 1) => bytes(a, b, u8::saturating_sub),
        (0, 2) => bytes(a, b, u8::min),
        (0, 3) => bytes(b << 8 | a >> 24, b >> 8 | 0xff << 24, u8::min),
        (0, 4) => bytes(a, b << 24 | 0x00ff_ffff, u8::min),
        (0, 5) => {
            let [a, b] = [a, b].map(|word| word.to_le_bytes().into_iter().fold(u8::MAX, u8::min));
            u32::from_le_bytes([a.min(b); 4])
        }
        (0, 6) => bytes(a, b, u8::midpoint),
        (0, 7) => bytes(a, b, |a, _| ((u32::from(a) * byte(b, 0)) >> 4) as u8),
        (1, 0..=3) => (a ^ b).count_ones() << (8 * funct3),
        (2, 0) => halfwords(|at| half(a, at).min(half(b, at))),
        (2, 1) => halfwords(|at| byte(a, at) + byte(b, at)),
        (2, 2) => halfwords(|at| byte(a, at + 2) + byte(b, at + 2)),
        (3, 1..=3) => a >> (8 * funct3) | b << (32 - 8 * funct3),
        (4, 0..=7) => bytes(a, b, |a, b| u8::from(a > b) << funct3),
        (5, 0) => bytes(a, b, u8::abs_diff),
        (5, 1) => bytes(a, b, |a, b| if a >= b { u8::MAX } else { 0 }),
        (5, 2) => signed_halfwords(a, b, i16::min),
        (5, 3) => signed_halfwords(a, b, i16::max),
        (6, 0) => a & ((1 << shift(a)) - 1) | b << shift(a),
        (6, 1) => (u64::from(b) << shift(a) >> 32) as u32 | shift(a) << 21,
        (7, 0..=7) => halfwords(|at| {
            let sum = half(a, at) + byte(b, at + 2 * (funct3 % 2));
            (sum << 6) + 2 * funct3 + at
        }),
        _ => 0,
    }
}

/// Each byte of two words to that of the result.
fn bytes(a: u32, b: u32, each: impl Fn(u8, u8) -> u8) -> u32 {
    let (a, b) = (a.to_le_bytes(), b.to_le_bytes());
    u32::from_le_bytes(core::array::from_fn(|lane| each(a[lane], b[lane])))
}

/// The low halves of what each halfword is.
fn halfwords(each: impl Fn(u32) -> u32) -> u32 {
    each(0) & 0xffff | each(1) << 16
}

fn signed_halfwords(a: u32, b: u32, each: impl Fn(i16, i16) -> i16) -> u32 {
    halfwords(|at| {
        let [a, b] = [a, b].map(|word| (word >> (16 * at)) as i16);
        u32::from(each(a, b).cast_unsigned())
    })
}
