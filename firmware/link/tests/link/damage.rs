//! Streams that lose, gain and change bytes, and packets that come late, twice or not at all.

use std::env;

use vgstereo_link::{
    BoardMessage, Counters, Decoder, Encoder, HostMessage, Line, Message, Reason, Refusal, Values,
};

/// A generator of random numbers, SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }
}

/// The line with this number: what comes must be it, to the last value.
fn disparities_q4(number: u32) -> Vec<i16> {
    let mut random = Random(number.into());
    let mut disparity = 300;
    let width = 100 + random.below(60);
    let next = (0..width).map(|_| match random.below(20) {
        0 => i16::MIN,
        1 => {
            disparity = random.below(700) as i16;
            disparity
        }
        step => {
            disparity += step as i16 % 5 - 2;
            disparity
        }
    });
    next.collect()
}

fn line(number: u32, values: &[i16]) -> BoardMessage<'_> {
    BoardMessage::Disparities(Line {
        frame: number / 100,
        line: number % 100,
        column: 0,
        values: Values::Plain(values),
    })
}

/// Takes bytes and returns the numbers of the lines that have come; panics if one is not as it was
/// sent.
fn take(decoder: &mut Decoder<'_>, mut bytes: &[u8]) -> Vec<u32> {
    let mut lines = Vec::new();
    while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut bytes) {
        let Ok(packet) = received else { continue };
        let BoardMessage::Disparities(line) = packet.message else {
            panic!("a message that was not sent: {:?}", packet.message);
        };
        let number = line.frame * 100 + line.line;
        let mut values = vec![0; line.values.count()];
        line.values.unpack(&mut values).unwrap();
        assert_eq!(values, disparities_q4(number));
        assert_eq!(packet.sequence, number);
        lines.push(number);
    }
    lines
}

/// Each byte is lost, doubled or changed with a chance of 1e-4. How many bytes are sent is 4 MB, or
/// `LINK_SOAK_MEGABYTES`.
#[test]
fn a_noisy_line_delivers_whole_lines_and_counts_the_others() {
    let megabytes = env::var("LINK_SOAK_MEGABYTES").map_or(4, |text| text.parse().unwrap());
    let mut random = Random(1);
    let (mut sent_memory, mut received_memory) = ([0; 700], [0; 700]);
    let mut encoder = Encoder::new(&mut sent_memory);
    let mut decoder = Decoder::new(&mut received_memory);
    let (mut sent_bytes, mut number, mut delivered, mut untouched) = (0_u64, 0, 0, 0);
    let mut last_delivered = None;
    // The delimiter before the first packet.
    let mut whole_before = true;
    while sent_bytes < megabytes * 1_000_000 {
        let values = disparities_q4(number);
        let bytes = encoder.encode(u64::from(number) * 400, &line(number, &values));
        let bytes = bytes.unwrap();
        sent_bytes += bytes.len() as u64;
        let mut noisy = Vec::with_capacity(bytes.len() + 4);
        for byte in bytes {
            match random.below(40_000) {
                0 => {}
                1 => noisy.extend([*byte, random.next() as u8]),
                2 | 3 => noisy.push(byte ^ (1 << random.below(8))),
                _ => noisy.push(*byte),
            }
        }
        let is_whole = noisy == bytes;
        let lines = take(&mut decoder, &noisy);
        // What was not touched comes, unless the delimiter before it was lost; nothing comes twice.
        if is_whole && whole_before {
            assert_eq!(lines, [number]);
            untouched += 1;
        }
        whole_before = is_whole;
        delivered += lines.len() as u32;
        last_delivered = lines.last().copied().or(last_delivered);
        number += 1;
    }
    let counters = decoder.counters();
    assert_eq!(counters.messages, delivered);
    assert!(untouched <= delivered && delivered < number);
    assert!(counters.broken > 0);
    assert_eq!(
        (counters.stale, counters.unknown, counters.restarts),
        (0, 0, 0)
    );
    // Every line up to the last that came was delivered or counts as lost, but those before the first.
    let expected = last_delivered.unwrap() + 1;
    assert_eq!(counters.messages + counters.lost, expected);
    println!(
        "{sent_bytes} bytes, {number} lines: {delivered} delivered, {} lost, {} packets refused",
        counters.lost, counters.broken
    );
}

#[test]
fn lost_repeated_and_late_packets_are_counted() {
    let mut memory = [0; 700];
    let mut encoder = Encoder::new(&mut memory);
    let packets: Vec<Vec<u8>> = (0..200)
        .map(|number| {
            let values = disparities_q4(number);
            encoder.encode(0, &line(number, &values)).unwrap().to_vec()
        })
        .collect();
    for (order, delivered, counters) in [
        (&[0, 1, 2][..], &[0, 1, 2][..], (0, 0, 0)),
        // The first packet sets the numbers.
        (&[5, 6], &[5, 6], (0, 0, 0)),
        (&[0, 3, 4], &[0, 3, 4], (2, 0, 0)),
        (&[0, 0, 1, 1, 1, 2], &[0, 1, 2], (0, 3, 0)),
        (&[0, 2, 1, 3], &[0, 2, 3], (1, 1, 0)),
        (&[100, 37, 101], &[100, 101], (0, 1, 0)),
        // So far behind, the sender has started again.
        (&[100, 36, 37], &[100, 36, 37], (0, 0, 1)),
    ] {
        let mut memory = [0; 700];
        let mut decoder = Decoder::new(&mut memory);
        let mut lines = Vec::new();
        for number in order {
            lines.extend(take(&mut decoder, &packets[*number]));
        }
        assert_eq!(lines, delivered, "{order:?}");
        let (lost, stale, restarts) = counters;
        let expected = Counters {
            messages: delivered.len() as u32,
            lost,
            stale,
            restarts,
            ..Counters::default()
        };
        assert_eq!(decoder.counters(), expected, "{order:?}");
        decoder.reset_counters();
        assert_eq!(decoder.counters(), Counters::default());
    }
}

#[test]
fn a_hello_with_the_number_0_begins_the_numbers_anew() {
    let hello = super::golden::hello();
    let done = BoardMessage::FrameDone { frame: 1 };
    let mut memory = [0; 700];
    let mut decoder = Decoder::new(&mut memory);
    for _ in 0..2 {
        let mut memory = [0; 700];
        let mut encoder = Encoder::new(&mut memory);
        for message in [&hello, &done, &done] {
            let mut bytes = encoder.encode(0, message).unwrap();
            let received = decoder.next::<BoardMessage<'_>>(&mut bytes);
            assert!(matches!(received, Some(Ok(_))));
        }
    }
    let counters = decoder.counters();
    assert_eq!((counters.messages, counters.restarts), (6, 1));
    assert_eq!((counters.lost, counters.stale), (0, 0));
}

/// A board may hear one host after another, each of which counts from 0.
#[test]
fn a_request_for_a_hello_with_the_number_0_begins_the_numbers_of_a_host_anew() {
    let mut memory = [0; 700];
    let mut decoder = Decoder::new(&mut memory);
    let mut take = |encoder: &mut Encoder<'_>, message: &HostMessage<'_>| {
        let mut bytes = encoder.encode(0, message).unwrap();
        let received = decoder.next::<HostMessage<'_>>(&mut bytes);
        let outcome = received.unwrap().map(|packet| packet.sequence);
        (outcome, decoder.counters().restarts)
    };
    for host in 0..2 {
        let mut memory = [0; 700];
        let mut encoder = Encoder::new(&mut memory);
        let first = take(&mut encoder, &HostMessage::SendHello);
        assert_eq!(first, (Ok(0), host));
        // A later one of the same host does not.
        for number in 1..4 {
            let next = take(&mut encoder, &HostMessage::SendHello);
            assert_eq!(next, (Ok(number), host));
        }
    }
    // One that begins with something else is taken for a host that repeats itself.
    let mut memory = [0; 700];
    let mut encoder = Encoder::new(&mut memory);
    let stop = take(&mut encoder, &HostMessage::Stop);
    assert_eq!(stop, (Err(Refusal::Stale), 1));
}

/// All that a decoder makes of these bytes, after which a whole packet must come through.
fn outcomes(bytes: &[u8]) -> Vec<Result<Vec<u8>, Refusal>> {
    let mut memory = [0; 200];
    let mut decoder = Decoder::new(&mut memory);
    let mut outcomes = Vec::new();
    let mut rest = bytes;
    while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut rest) {
        outcomes.push(received.map(|packet| super::messages::encoded(&packet.message)));
    }
    let mut memory = [0; 100];
    let last = BoardMessage::FrameAborted {
        frame: 77,
        reason: Reason::Sequence,
    };
    let mut encoder = Encoder::new(&mut memory);
    encoder.encode(0, &last).unwrap();
    let packet = encoder.encode(0, &last).unwrap();
    let mut rest = &[&[0], packet].concat()[..];
    let mut messages = Vec::new();
    while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut rest) {
        messages.push(received.map(|packet| super::messages::encoded(&packet.message)));
    }
    let expected = Ok(super::messages::encoded(&last));
    assert_eq!(messages.pop(), Some(expected), "the next packet");
    outcomes.extend(messages);
    outcomes
}

/// Small packets of several kinds.
fn small_packets() -> Vec<Vec<u8>> {
    let values = disparities_q4(3);
    let messages = [
        super::golden::hello(),
        BoardMessage::FrameDone { frame: 300 },
        line(3, &values),
        line(3, &values[..16]),
        line(0, &[0; 8]),
        BoardMessage::Confidences(Line {
            frame: 0,
            line: 0,
            column: 0,
            values: Values::Plain(&[0; 40]),
        }),
    ];
    messages.iter().map(super::messages::encoded).collect()
}

#[test]
fn every_changed_bit_and_every_cut_is_refused() {
    for packet in small_packets() {
        assert_eq!(outcomes(&packet), [Ok(packet.clone())]);
        for bit in 0..8 * packet.len() {
            let mut changed = packet.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            // A delimiter that has become another byte ends with the next one.
            let outcomes = outcomes(&changed);
            assert!(!outcomes.is_empty(), "bit {bit} of {packet:02x?}");
            for outcome in outcomes {
                assert_eq!(outcome, Err(Refusal::Broken), "bit {bit} of {packet:02x?}");
            }
        }
        for (start, end) in (0..packet.len()).flat_map(|cut| [(cut, packet.len()), (0, cut)]) {
            let outcomes = outcomes(&packet[start..end]);
            if start == 0 && end + 1 >= packet.len() {
                // Whole, or without its delimiter, in whose stead the next one ends it.
                assert_eq!(outcomes, [Ok(packet.clone())]);
                continue;
            }
            for outcome in outcomes {
                assert_eq!(outcome, Err(Refusal::Broken), "{start}..{end}");
            }
        }
    }
}

#[test]
fn what_is_longer_than_the_memory_is_counted_and_skipped() {
    let packet = &small_packets()[2];
    let mut memory = [0; 30];
    let mut decoder = Decoder::new(&mut memory);
    let mut rest = &packet[..];
    let refused = decoder.next::<BoardMessage<'_>>(&mut rest);
    assert_eq!(refused, Some(Err(Refusal::TooLong)));
    assert_eq!(decoder.next::<BoardMessage<'_>>(&mut rest), None);
    let mut memory = [0; 100];
    let mut encoder = Encoder::new(&mut memory);
    let mut rest = encoder.encode(0, &HostMessage::Start).unwrap();
    let received = decoder.next::<HostMessage<'_>>(&mut rest);
    assert!(matches!(received, Some(Ok(packet)) if packet.message == HostMessage::Start));
    assert_eq!(decoder.counters().too_long, 1);
}

/// A packet as the version `version` might send it.
fn packet_of_version(version: u8, kind: u8, sequence: u8, body: &[u8]) -> Vec<u8> {
    let mut plain = [&[version, kind, sequence, 0], body].concat();
    let crc32 = super::messages::slow_crc32(&plain);
    plain.extend(crc32.to_le_bytes());
    let runs = plain.split(|byte| *byte == 0);
    let framed = runs.flat_map(|run| [&[run.len() as u8 + 1], run].concat());
    framed.chain([0]).collect()
}

#[test]
fn newer_versions_and_kinds_are_skipped_and_bad_bodies_refused() {
    let mut memory = [0; 200];
    let mut decoder = Decoder::new(&mut memory);
    let done = BoardMessage::FrameDone { frame: 5 }.kind();
    let mut next = |packet: Vec<u8>| {
        let mut rest = &packet[..];
        let received = decoder.next::<BoardMessage<'_>>(&mut rest).unwrap();
        received.map(|packet| packet.sequence)
    };
    assert_eq!(next(packet_of_version(1, done, 0, &[5])), Ok(0));
    assert_eq!(
        next(packet_of_version(2, done, 1, &[5])),
        Err(Refusal::Unknown)
    );
    assert_eq!(
        next(packet_of_version(1, 64, 2, &[5, 6])),
        Err(Refusal::Unknown)
    );
    // A field too many, one too few, a number that does not end.
    assert_eq!(
        next(packet_of_version(1, done, 3, &[5, 6])),
        Err(Refusal::Broken)
    );
    assert_eq!(
        next(packet_of_version(1, done, 4, &[])),
        Err(Refusal::Broken)
    );
    assert_eq!(
        next(packet_of_version(1, done, 5, &[0x80; 9])),
        Err(Refusal::Broken)
    );
    assert_eq!(next(packet_of_version(1, done, 6, &[7])), Ok(6));
    let expected = Counters {
        messages: 2,
        unknown: 2,
        broken: 3,
        ..Counters::default()
    };
    assert_eq!(decoder.counters(), expected);
}

#[test]
fn reasons_that_are_not_known_yet_are_other() {
    for byte in 0..=255 {
        let reason = Reason::from(byte);
        if reason == Reason::Other {
            assert!(byte == 0 || byte > 12);
        } else {
            assert_eq!(u8::from(reason), byte);
        }
    }
    assert_eq!(Reason::ALL.len(), 13);
}

#[test]
fn who_joins_amid_a_packet_counts_no_damage() {
    let mut memory = [0; 700];
    let mut encoder = Encoder::new(&mut memory);
    let mut sent = Vec::new();
    let mut ends = vec![];
    for number in 0..4 {
        let values = disparities_q4(number);
        sent.extend_from_slice(encoder.encode(0, &line(number, &values)).unwrap());
        ends.push(sent.len());
    }
    for begin in 0..ends[1] {
        let mut memory = [0; 700];
        let mut decoder = Decoder::joining(&mut memory);
        let whole: Vec<u32> = match begin {
            0 => (0..4).collect(),
            _ if begin <= ends[0] => (1..4).collect(),
            _ => (2..4).collect(),
        };
        assert_eq!(take(&mut decoder, &sent[begin..]), whole, "from {begin}");
        let expected = Counters {
            messages: whole.len() as u32,
            ..Counters::default()
        };
        assert_eq!(decoder.counters(), expected, "from {begin}");
        // What is damaged later counts.
        let mut damaged = sent[ends[2]..].to_vec();
        damaged[5] ^= 0x80;
        take(&mut decoder, &damaged);
        assert_eq!(decoder.counters().broken, 1, "from {begin}");
    }
}
