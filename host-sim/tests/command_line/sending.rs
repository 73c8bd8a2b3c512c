//! `vgstereo calibration --send`: a board gets the bytes of the file, and says what became of them.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use image::GrayImage;
use vgstereo_link::HostMessage;
use vgstereo_link::board::Outcome;
use vgstereo_sim::link::attended::Attended;
use vgstereo_sim::link::client::Memory;
use vgstereo_sim::link::demo;
use vgstereo_sim::link::source::Source;

use crate::calibrated::parallel;
use crate::fixture::{Fixture, HEIGHT, WIDTH};
use crate::scripted::Script;

/// A folder with a calibration and its rectification, which has more bytes than one piece.
fn fixture() -> (Fixture, Vec<u8>) {
    let fixture = Fixture::new();
    fs::write(fixture.path("cal.yml"), parallel()).unwrap();
    let size = format!("{WIDTH}x{HEIGHT}");
    let made = [
        "calibration",
        "cal.yml",
        "--size",
        &size,
        "--unit",
        "mm",
        "--out",
        "cal.vgr",
    ];
    let outcome = fixture.run(&made);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let bytes = fs::read(fixture.path("cal.vgr")).unwrap();
    assert!(bytes.len() > 32);
    (fixture, bytes)
}

/// What a board has taken.
#[derive(Debug, PartialEq, Eq)]
enum Got {
    Piece(u32, u32, u32, Vec<u8>),
    Commit(u32, u32),
}

/// A board with views of the fixture's size that takes pieces of so many bytes, and answers a command of a
/// calibration, given its number, as it is told.
fn board(
    piece_bytes_max: u16,
    mut answer: impl FnMut(usize) -> Option<Outcome> + Send + 'static,
) -> (String, Receiver<Got>) {
    let view = GrayImage::new(WIDTH, HEIGHT);
    let mut script = Script::of(vec![[view.clone(), view]]);
    script.piece_bytes_max = piece_bytes_max;
    let (sender, got) = channel();
    let mut commands = 0;
    script.answer = Box::new(move |message| {
        let taken = match message {
            HostMessage::CalibrationPiece(piece) => Got::Piece(
                piece.total_bytes,
                piece.crc32,
                piece.offset_bytes,
                piece.bytes.to_vec(),
            ),
            HostMessage::CalibrationCommit { total_bytes, crc32 } => {
                Got::Commit(*total_bytes, *crc32)
            }
            _ => return Some(Outcome::Done),
        };
        let _ = sender.send(taken);
        commands += 1;
        answer(commands)
    });
    (script.serve(), got)
}

#[test]
fn a_board_gets_the_bytes_of_the_file_in_pieces_and_then_the_commit() {
    let (fixture, bytes) = fixture();
    let total = u32::try_from(bytes.len()).unwrap();
    let (rest, checksum) = bytes.split_last_chunk().unwrap();
    let crc32 = u32::from_le_bytes(*checksum);
    // The checksum of zip files, by another implementation than that which made it.
    assert_eq!(crc32, crc32fast(rest));
    for (size, files) in [
        (32, ["cal.yml", "--unit", "mm"].as_slice()),
        (1000, &["cal.vgr"]),
    ] {
        let (address, got) = board(size, |_| Some(Outcome::Done));
        let views = format!("{WIDTH}x{HEIGHT}");
        let mut arguments = [&["calibration"], files, &["--send", &address]].concat();
        if files.len() > 1 {
            arguments.extend(["--size", &views]);
        }
        let outcome = fixture.run(&arguments);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let told = format!("{address} has stored the calibration, {total} bytes");
        assert!(outcome.stdout.contains(&told), "{}", outcome.stdout);
        // No piece is longer than the protocol has room for.
        let pieces = bytes.chunks(usize::from(size).min(256));
        let mut offset = 0;
        let mut expected: Vec<Got> = pieces
            .map(|piece| {
                let got = Got::Piece(total, crc32, offset, piece.to_vec());
                offset += u32::try_from(piece.len()).unwrap();
                got
            })
            .collect();
        expected.push(Got::Commit(total, crc32));
        assert_eq!(got.iter().collect::<Vec<_>>(), expected);
    }
}

/// CRC-32 bit by bit.
fn crc32fast(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

#[test]
fn what_a_board_refuses_is_one_error_that_says_why() {
    let (fixture, _) = fixture();
    let refuses = |address: &str, words: &[&str]| {
        let words = [&["--send", address], words].concat();
        fixture.refuses(&["calibration", "cal.vgr", "--send", address], &words);
    };
    let (address, _) = board(0, |_| Some(Outcome::Done));
    refuses(&address, &["stores no calibration"]);
    let (address, _) = board(32, |_| Some(Outcome::OutOfBounds));
    refuses(&address, &["a calibration of", "bytes", "out of bounds"]);
    let (address, got) = board(64, |command| {
        Some(if command == 2 {
            Outcome::Calibration
        } else {
            Outcome::Done
        })
    });
    refuses(&address, &["unfit"]);
    assert_eq!(got.iter().count(), 2, "nothing is sent after a refusal");
    let (address, got) = board(256, |_| Some(Outcome::Storage));
    refuses(&address, &["could not be stored"]);
    drop(got);
    // Cut in the middle.
    let (address, _) = board(32, |command| (command < 3).then_some(Outcome::Done));
    refuses(&address, &["closed"]);
    refuses("nowhere", &["nowhere", "no such file"]);
    refuses("left.png", &["left.png", "takes no calibration"]);
    fixture.refuses(&["calibration", "cal.vgr", "--baud", "9600"], &["--send"]);
    // Views of another size.
    let other = [
        "calibration",
        "cal.yml",
        "--size",
        "96x40",
        "--out",
        "wide.vgr",
    ];
    assert_eq!(fixture.run(&other).code, Some(0));
    let (address, _) = board(256, |_| Some(Outcome::Done));
    fixture.refuses(
        &["calibration", "wide.vgr", "--send", &address],
        &["96x40", "80x40"],
    );
}

/// A board of the firmware's own session: it begins anew with the calibration.
#[test]
fn the_board_of_the_demo_stores_it_and_rectifies() {
    let fixture = Fixture::new();
    fs::write(fixture.path("cal.yml"), parallel()).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let serving = thread::spawn(move || {
        let mut board = demo::start().unwrap();
        // The first host sends the calibration, the second looks at what has become of the board.
        for _ in 0..2 {
            let (mut host, _) = listener.accept().unwrap();
            host.set_read_timeout(Some(Duration::from_millis(2)))
                .unwrap();
            let mut bytes = [0; 4096];
            loop {
                match host.read(&mut bytes) {
                    Ok(0) => break,
                    Ok(count) => board.write_all(&bytes[..count]).unwrap(),
                    Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
                    Err(_) => break,
                }
                if let Ok(count) = board.read(&mut bytes)
                    && host.write_all(&bytes[..count]).is_err()
                {
                    break;
                }
            }
        }
    });
    let arguments = [
        "calibration",
        "cal.yml",
        "--size",
        "320x240",
        "--unit",
        "mm",
    ];
    let rest = ["--keep", "all", "--out", "cal.vgr", "--send", &address];
    let outcome = fixture.run(&[&arguments[..], &rest].concat());
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let bytes = fs::read(fixture.path("cal.vgr")).unwrap();
    let mut memory = Memory::default();
    let source = Source::parse(&address, 0, true).unwrap();
    let mut attended = Attended::open(&source, &mut memory).unwrap();
    // The first hello may be one that was on its way when the first host left.
    let hello = |attended: &Attended<'_>| attended.board.hello.as_ref().unwrap().fields.clone();
    let opened = Instant::now();
    while hello(&attended)["rectifies"] != true && opened.elapsed() < Duration::from_secs(20) {
        attended.poll().unwrap();
    }
    let fields = hello(&attended);
    let checksum = u32::from_le_bytes(*bytes.last_chunk().unwrap());
    assert_eq!(fields["rectifies"], true);
    assert_eq!(fields["calibration_crc32"], checksum);
    drop(attended);
    serving.join().unwrap();
}
