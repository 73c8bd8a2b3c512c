//! The packing of lines: any values survive, and of any bytes come values or a refusal.

use vgstereo_link::Sample;
use vgstereo_link::pack::{pack, packed_bytes_max, unpack};

/// Runs both on the bytes, whose first is the number of values to unpack.
pub fn run(bytes: &[u8]) {
    let Some((count, bytes)) = bytes.split_first() else {
        return;
    };
    let words = bytes.as_chunks().0.iter().copied();
    let words: Vec<u16> = words.map(u16::from_le_bytes).collect();
    let signed: Vec<i16> = words.iter().map(|word| word.cast_signed()).collect();
    survives(&signed);
    survives(&words);
    survives(bytes);
    let count = usize::from(*count);
    takes_anything::<i16>(count, bytes);
    takes_anything::<u16>(count, bytes);
    takes_anything::<u8>(count, bytes);
}

/// Packs values into exactly as much memory as is asked for, and unpacks them.
fn survives<T: Sample>(values: &[T]) {
    let mut packed = vec![0xaa; packed_bytes_max(values.len(), T::BYTES)];
    let Some(taken) = pack(values, &mut packed) else {
        panic!("the memory is as large as is asked for");
    };
    let mut unpacked = vec![T::default(); values.len()];
    assert_eq!(unpack(&packed[..taken], &mut unpacked), Ok(()));
    assert_eq!(unpacked, values);
}

fn takes_anything<T: Sample>(count: usize, bytes: &[u8]) {
    let mut values = vec![T::default(); count];
    if unpack(bytes, &mut values).is_ok() {
        survives(&values);
    }
}
