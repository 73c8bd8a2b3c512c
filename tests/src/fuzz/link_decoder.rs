//! The decoder of the link: any bytes in any pieces give messages or refusals, which its counters tell,
//! and a line that was received can be sent on.

use vgstereo_link::pack::{pack, packed_bytes_max};
use vgstereo_link::{
    BoardMessage, Counters, Decoder, Encoder, HostMessage, Line, Message, Packed, Packet, Refusal,
    Sample, Values,
};

/// Memory of the decoder: some packets are too long for it.
const MEMORY_BYTES: usize = 300;

/// Runs the decoders of both directions. The first byte is the length of the pieces. The others are a
/// stream as it is and, because no checksum comes by chance, the content of packets between `0xff`s.
pub fn run(bytes: &[u8]) {
    let Some((piece, bytes)) = bytes.split_first() else {
        return;
    };
    let piece = usize::from(*piece).max(1);
    let packets = bytes.split(|byte| *byte == 0xff);
    let framed: Vec<u8> = packets.flat_map(framed).collect();
    for stream in [bytes, &framed] {
        let mut decoder = [0; MEMORY_BYTES];
        let mut decoder = Decoder::new(&mut decoder);
        let mut seen = Counters::default();
        for mut rest in stream.chunks(piece) {
            while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut rest) {
                count(&mut seen, &received);
                if let Ok(packet) = received {
                    check(&packet.message);
                }
            }
            assert!(rest.is_empty());
        }
        is_counted(&seen, &decoder.counters());
        let mut decoder = [0; MEMORY_BYTES];
        let mut decoder = Decoder::new(&mut decoder);
        let mut seen = Counters::default();
        for mut rest in stream.chunks(piece) {
            while let Some(received) = decoder.next::<HostMessage<'_>>(&mut rest) {
                count(&mut seen, &received);
                if let Ok(packet) = received {
                    is_sent_on(&packet.message);
                }
            }
        }
        is_counted(&seen, &decoder.counters());
    }
}

/// A packet of this content, with its checksum and its framing.
pub(super) fn framed(content: &[u8]) -> Vec<u8> {
    let mut packet = content.to_vec();
    packet.extend(crc32fast::hash(content).to_le_bytes());
    let mut framed = Vec::new();
    for run in packet.split(|byte| *byte == 0) {
        let mut run = run;
        while let Some((long, rest)) = run.split_at_checked(254) {
            framed.push(255);
            framed.extend_from_slice(long);
            run = rest;
        }
        framed.push(run.len() as u8 + 1);
        framed.extend_from_slice(run);
    }
    framed.push(0);
    framed
}

fn count<M>(seen: &mut Counters, received: &Result<Packet<M>, Refusal>) {
    *match received {
        Ok(_) => &mut seen.messages,
        Err(Refusal::Broken) => &mut seen.broken,
        Err(Refusal::TooLong) => &mut seen.too_long,
        Err(Refusal::Unknown) => &mut seen.unknown,
        Err(Refusal::Stale) => &mut seen.stale,
    } += 1;
}

fn is_counted(seen: &Counters, counted: &Counters) {
    let expected = Counters {
        lost: counted.lost,
        restarts: counted.restarts,
        ..*seen
    };
    assert_eq!(*counted, expected);
}

/// A message that was received can be sent on, and its line unpacked and packed again.
fn check(message: &BoardMessage<'_>) {
    is_sent_on(message);
    match message {
        BoardMessage::Disparities(line) => is_packed_again(line),
        BoardMessage::Confidences(line) => is_packed_again(line),
        BoardMessage::Depths(line) => is_packed_again(line),
        _ => {}
    }
}

fn is_sent_on<'a, M: Message<'a>>(message: &M) {
    // A text or a number that was sent with more bytes than it needs becomes shorter, none longer.
    let mut memory = [0; 2 * MEMORY_BYTES];
    let sent = Encoder::new(&mut memory).encode(0, message).map(|_| ());
    assert_eq!(sent, Ok(()));
}

fn is_packed_again<T: Sample>(line: &Line<'_, T>) {
    let count = line.values.count();
    let mut values = vec![T::default(); count];
    if line.values.unpack(&mut values).is_ok() {
        let mut packed = vec![0; packed_bytes_max(count, T::BYTES)];
        let Some(taken) = pack(&values, &mut packed) else {
            panic!("the memory is as large as is asked for");
        };
        let packed = Packed::new(count as u16, &packed[..taken]);
        let mut again = vec![T::default(); count];
        assert_eq!(Values::Packed(packed).unpack(&mut again), Ok(()));
        assert_eq!(again, values);
    }
}
