//! Lines of integers in few bits: differences of neighbours, four at a time in as many bits as the
//! largest of them needs.
//!
//! Neighbours on one surface differ by little, and a step between surfaces makes one group of four
//! wide and no other. A group is a whole number of half bytes, so that packing takes a few shifts,
//! and its cost does not depend on the values. A line is decoded without any other.
//!
//! A packed line is a byte that says how, then bits, the lowest of a byte first:
//!
//! - [`PLAIN`]: the values themselves, little-endian.
//! - [`GROUPS`]: for each four values a code of 4 bits. Codes 0 to 12 are the number of bits of each
//!   of the four differences that follow, the first in the lowest bits; 13 stands for 16 bits; 14
//!   says that there are gaps: a mask of 4 bits follows, with a bit for each value that is there, the
//!   first in the lowest bit, then a code of 0 to 13 with its differences, in which those of gaps have
//!   no meaning; 15 says that none of the four values is there.
//!
//! A difference `d`, modulo 2^16, is that to the last value that was there, at first to 0. It is
//! stored as `2 d`, or as `-2 d - 1` if it is negative. The last group is filled up, and so is the
//! last byte, with zeros.

use core::fmt;
use core::marker::PhantomData;
use core::mem;

/// First byte of a line that is stored as it is.
pub const PLAIN: u8 = 0;
/// First byte of a line of groups.
pub const GROUPS: u8 = 1;

/// Values in a group.
const GROUP: usize = 4;
/// Largest code that is the number of bits.
const NARROW_MAX: u32 = 12;
/// Differences have 16 bits.
const WIDE: u32 = 13;
/// A mask of the values that are there follows.
const GAPS: u32 = 14;
/// No value is there.
const NONE: u32 = 15;
/// All values of a group are there.
const WHOLE: u32 = (1 << GROUP) - 1;

/// A packed line is not as the format says, or of another length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Malformed;

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the packed values are not of the stated number or format")
    }
}

impl core::error::Error for Malformed {}

mod sealed {
    pub trait Sealed {}
    impl Sealed for i16 {}
    impl Sealed for u16 {}
    impl Sealed for u8 {}
}

/// A value of a line: `i16`, disparities in 1/16 px; `u16`, depths or ranges in mm; `u8`,
/// confidences.
pub trait Sample: Copy + Default + PartialEq + fmt::Debug + sealed::Sealed {
    /// The value that means none: `i16::MIN` of disparities, 0 of all others.
    const NONE: Self;
    /// Bytes of a value that is stored as it is.
    const BYTES: usize;

    /// The value in 16 bits.
    #[must_use]
    fn to_bits(self) -> u16;

    /// The value of these bits; `None` if there is no such value.
    #[must_use]
    fn from_bits(bits: u16) -> Option<Self>;
}

impl Sample for i16 {
    const NONE: Self = Self::MIN;
    const BYTES: usize = 2;

    #[inline]
    fn to_bits(self) -> u16 {
        self.cast_unsigned()
    }

    #[inline]
    fn from_bits(bits: u16) -> Option<Self> {
        Some(bits.cast_signed())
    }
}

impl Sample for u16 {
    const NONE: Self = 0;
    const BYTES: usize = 2;

    #[inline]
    fn to_bits(self) -> u16 {
        self
    }

    #[inline]
    fn from_bits(bits: u16) -> Option<Self> {
        Some(bits)
    }
}

impl Sample for u8 {
    const NONE: Self = 0;
    const BYTES: usize = 1;

    #[inline]
    fn to_bits(self) -> u16 {
        self.into()
    }

    #[inline]
    fn from_bits(bits: u16) -> Option<Self> {
        bits.try_into().ok()
    }
}

/// Largest number of bytes that `count` values of `value_bytes` ([`Sample::BYTES`]) take packed: one
/// more than they take as they are.
#[must_use]
pub const fn packed_bytes_max(count: usize, value_bytes: usize) -> usize {
    1 + count * value_bytes
}

/// Packs `values` to the start of `bytes` and returns how many bytes they take, at most
/// [`packed_bytes_max`]; `None` if there are fewer bytes than that many. Those behind may be written to.
#[must_use]
pub fn pack<T: Sample>(values: &[T], bytes: &mut [u8]) -> Option<usize> {
    let bytes = bytes.get_mut(..packed_bytes_max(values.len(), T::BYTES))?;
    let (mode, bytes) = bytes.split_first_mut()?;
    *mode = GROUPS;
    if let Some(taken) = pack_groups(values, bytes) {
        return Some(1 + taken);
    }
    *mode = PLAIN;
    for (bytes, value) in bytes.chunks_exact_mut(T::BYTES).zip(values) {
        for (byte, bits) in bytes.iter_mut().zip(value.to_bits().to_le_bytes()) {
            *byte = bits;
        }
    }
    Some(1 + bytes.len())
}

/// Packs values in groups; `None` if they take more than `bytes`.
fn pack_groups<T: Sample>(values: &[T], bytes: &mut [u8]) -> Option<usize> {
    let room = bytes.len();
    let mut writer = Writer {
        bytes,
        pending: 0,
        pending_bits: 0,
    };
    let mut previous = 0;
    let (groups, rest) = values.as_chunks::<GROUP>();
    for group in groups {
        previous = writer.put_group(group, previous)?;
    }
    if !rest.is_empty() {
        // Filled up with what takes no bits.
        let mut filling = T::NONE;
        let mut group = [T::NONE; GROUP];
        for (place, value) in group.iter_mut().zip(rest) {
            *place = *value;
            if *value != T::NONE {
                filling = *value;
            }
        }
        for place in group.iter_mut().skip(rest.len()) {
            *place = filling;
        }
        writer.put_gaps(&group, previous)?;
    }
    Some(room - writer.finish()?)
}

/// A difference as it is stored.
#[inline]
fn stored(value: u16, previous: u16) -> u32 {
    let step = i32::from(value.wrapping_sub(previous).cast_signed());
    ((step << 1) ^ (step >> 31)).cast_unsigned()
}

/// Writes bits to bytes.
struct Writer<'b> {
    /// The bytes that are left.
    bytes: &'b mut [u8],
    /// Bits that do not fill four bytes yet.
    pending: u32,
    pending_bits: u32,
}

impl Writer<'_> {
    /// Appends up to 31 bits.
    #[inline(always)]
    fn put(&mut self, value: u32, bits: u32) -> Option<()> {
        self.pending |= value << self.pending_bits;
        let end = self.pending_bits + bits;
        if end < u32::BITS {
            self.pending_bits = end;
            return Some(());
        }
        let (place, rest) = mem::take(&mut self.bytes).split_first_chunk_mut()?;
        *place = self.pending.to_le_bytes();
        self.bytes = rest;
        // Some bits were pending, as 31 alone do not fill a word.
        self.pending = value >> (u32::BITS - self.pending_bits);
        self.pending_bits = end - u32::BITS;
        Some(())
    }

    /// Appends a group after the value `previous`, and returns the last value of it.
    // Inlined, as all of a writer is, so that its state stays in registers.
    #[inline(always)]
    fn put_group<T: Sample>(&mut self, group: &[T; GROUP], previous: u16) -> Option<u16> {
        let bits @ [a, b, c, d] = group.map(T::to_bits);
        if bits.contains(&T::NONE.to_bits()) {
            return self.put_gaps(group, previous);
        }
        self.put_differences([
            stored(a, previous),
            stored(b, a),
            stored(c, b),
            stored(d, c),
        ])?;
        Some(d)
    }

    /// Appends a group with values that are not there.
    #[inline(always)]
    fn put_gaps<T: Sample>(&mut self, group: &[T; GROUP], mut previous: u16) -> Option<u16> {
        let mut differences = [0; GROUP];
        let mut mask = 0;
        for (at, (difference, value)) in differences.iter_mut().zip(group).enumerate() {
            if *value != T::NONE {
                *difference = stored(value.to_bits(), previous);
                previous = value.to_bits();
                mask |= 1 << at;
            }
        }
        if mask == 0 {
            self.put(NONE, 4)?;
            return Some(previous);
        }
        if mask != WHOLE {
            self.put(GAPS | mask << 4, 8)?;
        }
        self.put_differences(differences)?;
        Some(previous)
    }

    #[inline(always)]
    fn put_differences(&mut self, [a, b, c, d]: [u32; GROUP]) -> Option<()> {
        let width = u32::BITS - (a | b | c | d).leading_zeros();
        if width > NARROW_MAX {
            return self.put_wide([a, b, c, d]);
        }
        if width > 6 {
            self.put((b << width | a) << 4 | width, 4 + 2 * width)?;
            return self.put(d << width | c, 2 * width);
        }
        let packed = ((d << width | c) << width | b) << width | a;
        self.put(packed << 4 | width, 4 + 4 * width)
    }

    /// Appends differences of up to 16 bits.
    fn put_wide(&mut self, differences: [u32; GROUP]) -> Option<()> {
        self.put(WIDE, 4)?;
        for difference in differences {
            self.put(difference, 16)?;
        }
        Some(())
    }

    /// Writes what is pending and returns the number of bytes that are left.
    fn finish(self) -> Option<usize> {
        let whole = self.pending_bits.div_ceil(8) as usize;
        let (places, rest) = self.bytes.split_at_mut_checked(whole)?;
        for (place, byte) in places.iter_mut().zip(self.pending.to_le_bytes()) {
            *place = byte;
        }
        Some(rest.len())
    }
}

/// Unpacks `values.len()` values.
///
/// # Errors
/// [`Malformed`] if the bytes are not those of so many values; some may have been written.
pub fn unpack<T: Sample>(bytes: &[u8], values: &mut [T]) -> Result<(), Malformed> {
    match bytes.split_first() {
        Some((&GROUPS, bytes)) => unpack_groups(bytes, values).ok_or(Malformed),
        Some((&PLAIN, bytes)) if bytes.len() == values.len() * T::BYTES => {
            for (value, bytes) in values.iter_mut().zip(bytes.chunks_exact(T::BYTES)) {
                let mut bits = [0; 2];
                for (bits, byte) in bits.iter_mut().zip(bytes) {
                    *bits = *byte;
                }
                *value = T::from_bits(u16::from_le_bytes(bits)).ok_or(Malformed)?;
            }
            Ok(())
        }
        _ => Err(Malformed),
    }
}

fn unpack_groups<T: Sample>(bytes: &[u8], values: &mut [T]) -> Option<()> {
    let mut reader = Reader {
        bytes: bytes.iter(),
        pending: 0,
        pending_bits: 0,
    };
    let mut previous = 0_u16;
    for group in values.chunks_mut(GROUP) {
        let mut code = reader.take(4)?;
        if code == NONE {
            group.fill(T::NONE);
            continue;
        }
        let mut mask = WHOLE;
        if code == GAPS {
            mask = reader.take(4)?;
            code = reader.take(4)?;
        }
        let width = match code {
            0..=NARROW_MAX => code,
            WIDE => 16,
            _ => return None,
        };
        for at in 0..GROUP {
            let stored = reader.take(width)? as u16;
            let mut value = T::NONE;
            if mask >> at & 1 != 0 {
                let step = (stored >> 1) ^ (stored & 1).wrapping_neg();
                previous = previous.wrapping_add(step);
                value = T::from_bits(previous)?;
            }
            if let Some(place) = group.get_mut(at) {
                *place = value;
            }
        }
    }
    reader.is_at_end().then_some(())
}

/// Reads bits from bytes.
struct Reader<'b> {
    bytes: core::slice::Iter<'b, u8>,
    pending: u32,
    pending_bits: u32,
}

impl Reader<'_> {
    /// Takes up to 16 bits; `None` where the bytes end.
    #[inline]
    fn take(&mut self, bits: u32) -> Option<u32> {
        while self.pending_bits < bits {
            self.pending |= u32::from(*self.bytes.next()?) << self.pending_bits;
            self.pending_bits += 8;
        }
        let taken = self.pending & ((1 << bits) - 1);
        self.pending >>= bits;
        self.pending_bits -= bits;
        Some(taken)
    }

    /// Whether no byte is left, and of the last one only zeros.
    fn is_at_end(&self) -> bool {
        self.bytes.len() == 0 && self.pending_bits < 8 && self.pending == 0
    }
}

/// A line of values as it was received: packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Packed<'a, T> {
    count: u16,
    bytes: &'a [u8],
    sample: PhantomData<T>,
}

impl<'a, T: Sample> Packed<'a, T> {
    /// `count` values in these bytes.
    #[must_use]
    pub const fn new(count: u16, bytes: &'a [u8]) -> Self {
        Self {
            count,
            bytes,
            sample: PhantomData,
        }
    }

    /// The packed bytes.
    #[must_use]
    pub const fn bytes(&self) -> &'a [u8] {
        self.bytes
    }
}

/// The values of a line: as they are, to be sent, or packed, as they were received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Values<'a, T> {
    /// Values as they are.
    Plain(&'a [T]),
    /// Packed values.
    Packed(Packed<'a, T>),
}

impl<T: Sample> Values<'_, T> {
    /// Number of values. A sender has at most 65535.
    #[must_use]
    pub const fn count(&self) -> usize {
        match self {
            Self::Plain(values) => values.len(),
            Self::Packed(packed) => packed.count as usize,
        }
    }

    /// Writes the values to `values`, which has as many places.
    ///
    /// # Errors
    /// [`Malformed`] if it has more or fewer, or if the packed bytes are not as the format says. Some
    /// values may have been written then.
    pub fn unpack(&self, values: &mut [T]) -> Result<(), Malformed> {
        if values.len() != self.count() {
            return Err(Malformed);
        }
        match self {
            Self::Plain(plain) => {
                for (value, plain) in values.iter_mut().zip(*plain) {
                    *value = *plain;
                }
                Ok(())
            }
            Self::Packed(packed) => unpack(packed.bytes, values),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    fn packed<T: Sample>(values: &[T]) -> Vec<u8> {
        let mut bytes = vec![0xaa; packed_bytes_max(values.len(), T::BYTES)];
        let taken = pack(values, &mut bytes).unwrap();
        bytes.truncate(taken);
        bytes
    }

    /// The bits of a line of groups, the lowest of a byte first, from numbers and their widths.
    fn bits(numbers: &[(u64, u32)]) -> Vec<u8> {
        let mut all = Vec::new();
        for (number, width) in numbers {
            all.extend((0..*width).map(|bit| number >> bit & 1 != 0));
        }
        let bytes = all.chunks(8);
        let bytes = bytes.map(|byte| (0..).zip(byte).map(|(at, bit)| u8::from(*bit) << at).sum());
        [vec![GROUPS], bytes.collect()].concat()
    }

    #[test]
    fn groups_are_as_the_format_says() {
        assert_eq!(packed::<i16>(&[]), [GROUPS]);
        // Differences 3, -1, 0, 2 are stored as 6, 1, 0, 4.
        let line = [3_i16, 2, 2, 4];
        assert_eq!(
            packed(&line),
            bits(&[(3, 4), (6, 3), (1, 3), (0, 3), (4, 3)])
        );
        // A line of nothing, and the last group filled up.
        assert_eq!(packed(&[i16::MIN; 7]), bits(&[(15, 4), (15, 4)]));
        // The second value is missing; the third differs from the first.
        let line = [5_i16, i16::MIN, 4, 4, 4];
        let gaps = [
            (14, 4),
            (0b1101, 4),
            (4, 4),
            (10, 4),
            (0, 4),
            (1, 4),
            (0, 4),
        ];
        assert_eq!(packed(&line), bits(&[&gaps[..], &[(0, 4)]].concat()));
        // The differences of 13 bits and more have 16; the first one is -20000.
        let line = [
            -20000_i16, -20000, -20000, -20000, -20000, -20000, -20000, -20000,
        ];
        let wide = [(13, 4), (39999, 16), (0, 16), (0, 16), (0, 16), (0, 4)];
        assert_eq!(packed(&line), bits(&wide));
    }

    #[test]
    fn what_cannot_be_packed_takes_one_byte_more() {
        let line = [1_u16, 60000, 2, 50000, 9, 40000, 8, 30000];
        let plain: Vec<u8> = line.iter().flat_map(|value| value.to_le_bytes()).collect();
        assert_eq!(packed(&line), [vec![PLAIN], plain].concat());
        let line = [1_u8, 255, 2, 254];
        assert_eq!(packed(&line), [PLAIN, 1, 255, 2, 254]);
        assert_eq!(pack(&line, &mut [0; 4]), None);
        assert_eq!(pack::<u8>(&[], &mut []), None);
    }

    #[test]
    fn other_lengths_and_codes_are_malformed() {
        let line = [3_i16, 2, 2, 4, 9];
        let bytes = packed(&line);
        let mut values = [0; 5];
        assert_eq!(unpack(&bytes, &mut values), Ok(()));
        assert_eq!(values, line);
        for cut in 0..bytes.len() {
            assert_eq!(unpack(&bytes[..cut], &mut values), Err(Malformed), "{cut}");
        }
        assert_eq!(unpack(&bytes, &mut [0_i16; 4]), Err(Malformed));
        assert_eq!(unpack(&bytes, &mut [0_i16; 13]), Err(Malformed));
        let longer = [&bytes[..], &[0]].concat();
        assert_eq!(unpack(&longer, &mut values), Err(Malformed));
        assert_eq!(unpack(&[2, 0], &mut [0_u8]), Err(Malformed));
        for gaps in [(14, 4), (15, 4)] {
            let bytes = bits(&[(14, 4), (15, 4), gaps]);
            assert_eq!(unpack(&bytes, &mut [0_u8; 4]), Err(Malformed));
        }
        // 300 is no confidence.
        let bytes = packed(&[300_u16, 300, 300, 300]);
        assert_eq!(unpack(&bytes, &mut [0_u8; 4]), Err(Malformed));
        // Padding is zero.
        let bytes = [GROUPS, 0xf0];
        assert_eq!(unpack(&bytes, &mut [0_u8; 4]), Err(Malformed));
    }

    /// Lines of small steps with gaps and ends of the range among them, or of anything.
    fn lines() -> impl Strategy<Value = Vec<i16>> {
        let value = prop_oneof![
            4 => 300_i16..320,
            1 => Just(i16::MIN),
            1 => Just(i16::MAX),
            1 => any::<i16>(),
        ];
        prop_oneof![
            prop::collection::vec(value, 0..200),
            prop::collection::vec(300_i16..320, 0..200),
            prop::collection::vec(any::<i16>(), 0..200),
        ]
    }

    fn survives<T: Sample>(line: &[T]) {
        let bytes = packed(line);
        let mut values = vec![T::default(); line.len()];
        assert_eq!(unpack(&bytes, &mut values), Ok(()));
        assert_eq!(values, line);
    }

    proptest! {
        #[test]
        fn any_line_survives(line in lines()) {
            survives(&line);
            survives(&line.iter().map(|value| value.cast_unsigned()).collect::<Vec<_>>());
            survives(&line.iter().map(|value| *value as u8).collect::<Vec<_>>());
        }
    }
}
