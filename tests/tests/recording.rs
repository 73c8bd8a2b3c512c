//! Recordings: cut and damaged at every byte, and long ones. What is read of them is what was recorded, or
//! is told to be missing.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::Path;

use tempfile::TempDir;
use vgstereo_link::board::{FrameBegun, Hello, View};
use vgstereo_link::{BoardMessage, Encoder, Line, PixelFormat, Region, Streams, Values};
use vgstereo_sim::link::attended::Attended;
use vgstereo_sim::link::board::Frame;
use vgstereo_sim::link::client::Memory;
use vgstereo_sim::link::recording::{Damage, Recorder};
use vgstereo_sim::link::source::Source;
use vgstereo_sim::link::tally::Tally;

const WIDTH: usize = 8;
const HEIGHT: u32 = 3;

/// The disparities of a line of a frame, 1/16 px: no two lines have the same.
fn disparities_q4(frame: u32, line: u32) -> [i16; WIDTH] {
    std::array::from_fn(|column| {
        let mixed = (frame * 31 + line * 7 + column as u32).wrapping_mul(2_654_435_761) >> 18;
        if mixed.is_multiple_of(11) {
            i16::MIN
        } else {
            mixed as i16 % 2_000
        }
    })
}

/// A board that sends packets.
struct Sender(Encoder<'static>);

impl Sender {
    fn new() -> Self {
        Self(Encoder::new(Vec::leak(vec![0; 1024])))
    }

    fn packet(&mut self, at_us: u64, message: &BoardMessage<'_>) -> Vec<u8> {
        self.0.encode(at_us, message).unwrap().to_vec()
    }

    fn hello(&mut self) -> Vec<u8> {
        let view = View {
            width_px: WIDTH as u16,
            height_lines: HEIGHT,
            format: PixelFormat::Grey8,
        };
        let hello = Hello {
            device: "sender",
            firmware: "1",
            raw: view,
            matched: view,
            preset: "lite",
            disparity_min_px: 0,
            disparity_count: 48,
            latency_lines: 2,
            streams: Streams::DISPARITIES,
            calibration_crc32: None,
            rectifies: false,
            piece_bytes_max: 0,
        };
        self.packet(0, &BoardMessage::Hello(hello))
    }

    /// The packets of a frame: its beginning, its lines, its end.
    fn frame(&mut self, frame: u32) -> Vec<Vec<u8>> {
        let at_us = 1_000 * u64::from(frame);
        let begun = FrameBegun {
            frame,
            timestamp_us: at_us,
            region: Region {
                x_px: 0,
                y_lines: 0,
                width_px: WIDTH as u16,
                height_lines: HEIGHT,
            },
        };
        let mut packets = vec![self.packet(at_us, &BoardMessage::FrameBegun(begun))];
        for line in 0..HEIGHT {
            let values = disparities_q4(frame, line);
            let line = Line {
                frame,
                line,
                column: 0,
                values: Values::Plain(&values),
            };
            packets.push(self.packet(at_us, &BoardMessage::Disparities(line)));
        }
        packets.push(self.packet(at_us, &BoardMessage::FrameDone { frame }));
        packets
    }
}

/// Reads a recording, and gives each frame to `take`.
fn read(path: &Path, mut take: impl FnMut(&Frame)) -> anyhow::Result<(Tally, Option<Damage>)> {
    let source = Source::File {
        path: path.to_owned(),
        is_fast: true,
    };
    let mut memory = Memory::default();
    let mut board = Attended::open(&source, &mut memory)?;
    while let Some(frame) = board.frame()? {
        take(&frame);
    }
    Ok((Tally::of(&board), board.client().damage().cloned()))
}

/// Asserts that each line of a frame that has come is the one that was sent.
fn is_as_sent(frame: &Frame) {
    let plane = frame.disparities.as_ref().unwrap();
    let missing = plane.missing();
    for (row, values) in plane.values.chunks_exact(WIDTH).enumerate() {
        let is_missing = |[first, count]: &[usize; 2]| (*first..first + count).contains(&row);
        let expected = if missing.iter().any(is_missing) {
            [i16::MIN; WIDTH]
        } else {
            disparities_q4(frame.begun.frame, row as u32)
        };
        assert_eq!(values, expected, "frame {} line {row}", frame.begun.frame);
    }
}

/// A recording of these frames, in pieces of which none ends with a packet but by chance.
fn small_recording(folder: &TempDir, frames: u32) -> Vec<u8> {
    let mut sender = Sender::new();
    let mut bytes = sender.hello();
    for frame in 0..frames {
        bytes.extend(sender.frame(frame).concat());
    }
    let path = folder.path().join("whole.mcap");
    let mut recorder = Recorder::create(&path).unwrap();
    for (at, piece) in bytes.chunks(37).enumerate() {
        recorder.push(1_000 * at as u64, piece).unwrap();
    }
    recorder.finish().unwrap();
    fs::read(path).unwrap()
}

#[test]
fn a_recording_that_is_cut_at_any_byte_has_the_frames_before_the_cut() {
    const FRAMES: u32 = 6;
    let folder = tempfile::tempdir().unwrap();
    let whole = small_recording(&folder, FRAMES);
    let path = folder.path().join("cut.mcap");
    let mut before = 0;
    for length in 0..=whole.len() {
        fs::write(&path, &whole[..length]).unwrap();
        let mut frames = 0;
        let (tally, damage) = read(&path, |frame| {
            assert_eq!(frame.begun.frame, frames);
            assert!(frame.is_whole());
            is_as_sent(frame);
            frames += 1;
        })
        .unwrap();
        assert!(frames >= before, "{length}");
        before = frames;
        assert_eq!(tally.frames.whole, u64::from(frames));
        assert_eq!((tally.packets.broken, tally.packets.lost), (0, 0));
        if let Some(damage) = damage {
            assert!(damage.bytes <= length as u64);
        } else {
            assert!(frames == FRAMES || length == 0, "{length}");
        }
    }
    assert_eq!(before, FRAMES);
}

#[test]
fn a_recording_with_any_byte_damaged_has_no_wrong_line_and_what_is_missing_is_told() {
    const FRAMES: u64 = 3;
    let folder = tempfile::tempdir().unwrap();
    let whole = small_recording(&folder, FRAMES as u32);
    let path = folder.path().join("damaged.mcap");
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 1 << (at % 8);
        fs::write(&path, damaged).unwrap();
        // Without its name or its channel, it is refused as something else.
        let Ok((tally, damage)) = read(&path, is_as_sent) else {
            continue;
        };
        let is_all = tally.frames.whole == FRAMES;
        let is_told = damage.is_some() || tally.packets.broken > 0 || tally.packets.lost > 0;
        // A file whose first bytes are damaged is taken for plain bytes of the link.
        assert!(is_all || is_told || at < 8, "{at}: {tally:?}");
    }
}

/// What a long recording had, the memory in bytes that writing and reading it took, and what of it was left
/// out or changed.
struct Long {
    tally: Tally,
    memory_bytes: [u64; 2],
    lost_packets: u64,
    damaged_frames: BTreeMap<u32, ()>,
}

fn long_recording(folder: &TempDir, frames: u32) -> Long {
    let path = folder.path().join(format!("{frames}.mcap"));
    let (mut lost_packets, mut damaged_frames) = (0, BTreeMap::new());
    let writing = allocation_counter::measure(|| {
        let mut recorder: Recorder<File> = Recorder::create(&path).unwrap();
        let mut sender = Sender::new();
        recorder.push(0, &sender.hello()).unwrap();
        for frame in 0..frames {
            let mut packets = sender.frame(frame);
            // A line of every 97th frame is left out, and a byte of one of every 101st is changed.
            if frame % 97 == 5 {
                packets.remove(2);
            } else if frame % 101 == 7 {
                packets[3][9] ^= 0x10;
            }
            if packets.len() < 5 || frame % 101 == 7 {
                lost_packets += 1;
                damaged_frames.insert(frame, ());
            }
            recorder
                .push(1_000 * u64::from(frame), &packets.concat())
                .unwrap();
        }
        recorder.finish().unwrap();
    });
    let mut tally = None;
    let reading = allocation_counter::measure(|| {
        let mut next = 0;
        let read = read(&path, |frame| {
            assert_eq!(frame.begun.frame, next);
            next += 1;
            assert_eq!(
                frame.is_whole(),
                !damaged_frames.contains_key(&frame.begun.frame)
            );
            is_as_sent(frame);
        });
        assert_eq!(next, frames);
        let (of_recording, damage) = read.unwrap();
        assert_eq!(damage, None);
        tally = Some(of_recording);
    });
    Long {
        tally: tally.unwrap(),
        memory_bytes: [writing.bytes_max, reading.bytes_max],
        lost_packets,
        damaged_frames,
    }
}

#[test]
fn ten_thousand_frames_take_the_memory_of_a_thousand_and_all_that_is_lost_is_counted() {
    const FRAMES: u32 = 10_000;
    let folder = tempfile::tempdir().unwrap();
    let [short, long] = [FRAMES / 10, FRAMES].map(|frames| long_recording(&folder, frames));
    let damaged = long.damaged_frames.len() as u64;
    assert!(damaged > 190, "{damaged}");
    let frames = &long.tally.frames;
    assert_eq!(frames.whole, u64::from(FRAMES) - damaged);
    assert_eq!((frames.with_gaps, frames.stray_lines), (damaged, 0));
    assert_eq!(u64::from(long.tally.packets.lost), long.lost_packets);
    assert!(!long.tally.is_amid_frame);
    println!(
        "bytes of memory to write and to read: {:?} for {}, {:?} for {FRAMES} frames",
        short.memory_bytes,
        FRAMES / 10,
        long.memory_bytes
    );
    for (short, long) in short.memory_bytes.into_iter().zip(long.memory_bytes) {
        // The list of damaged frames, which this test keeps, grows.
        assert!(long < short + 16_384, "{short} {long}");
    }
}
