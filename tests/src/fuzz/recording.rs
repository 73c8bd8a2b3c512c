//! Recordings: any bytes give records or the place where they are no longer whole, in bounded memory; and what
//! was recorded is read, up to a cut, as it was.

use std::io::Cursor;

use vgstereo_sim::link::recording::{Recorder, Recording};

use super::within_memory;

/// Memory for the largest record that is read, twice, and for what surrounds it.
const MEMORY_BYTES: u64 = 4 << 20;

/// Reads what follows the first two bytes as a recording, and then records it, in pieces of the length that the
/// first byte states, and cuts that where the second one says.
pub fn run(bytes: &[u8]) {
    let [piece, cut, file @ ..] = bytes else {
        return;
    };
    let read = within_memory(MEMORY_BYTES, || read(file));
    if let Some((_, bytes)) = read {
        assert!(bytes <= file.len() as u64, "{bytes} of {}", file.len());
    }
    let mut recorder = must(Recorder::new(Cursor::new(Vec::new())));
    let pieces: Vec<&[u8]> = file.chunks(usize::from(*piece).max(1)).collect();
    for (at, piece) in pieces.iter().enumerate() {
        must(recorder.push(at as u64, piece));
    }
    let whole = must(recorder.finish()).into_inner();
    let length = whole.len() - whole.len() * usize::from(*cut) / 256;
    let mut recording = must(Recording::new(&whole[..length]));
    let mut count = 0;
    while let Some((arrived_ns, bytes)) = recording.next_record() {
        assert_eq!(
            (arrived_ns, Some(&bytes)),
            (count as u64, pieces.get(count))
        );
        count += 1;
    }
    assert!(count == pieces.len() || recording.damage().is_some());
    assert!(*cut > 0 || (count == pieces.len() && recording.damage().is_none()));
}

/// The number of records of a file and of the bytes in them; `None` if it is no recording.
fn read(file: &[u8]) -> Option<(u64, u64)> {
    let mut recording = Recording::new(file).ok()?;
    let (mut count, mut total) = (0, 0);
    while let Some((_, bytes)) = recording.next_record() {
        count += 1;
        total += bytes.len() as u64;
    }
    assert_eq!(recording.records(), count);
    assert!(recording.next_record().is_none(), "what has ended goes on");
    if let Some(damage) = recording.damage() {
        assert!(damage.records == count && damage.bytes <= file.len() as u64);
    }
    Some((count, total))
}

/// What cannot fail in memory.
fn must<T>(result: anyhow::Result<T>) -> T {
    result.unwrap_or_else(|error| panic!("{error:#}"))
}
