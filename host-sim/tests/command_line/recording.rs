//! `vgstereo record` and `vgstereo replay`: what came is what is kept, and what is kept is what is played.

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::channel;
use std::thread;
use std::time::{Duration, Instant};

use assert_cmd::cargo::CommandCargoExt;
use image::GrayImage;
use vgstereo_link::board::Outcome;
use vgstereo_link::{
    BoardMessage, Decoder, Encoder, HostMessage, Line, Selection, Source, State, Streams, Values,
};

use crate::fixture::Fixture;
use crate::link::Board;
use crate::scripted::Script;

const WIDTH: u16 = 40;
const HEIGHT: u32 = 20;
const BOARD: Board = Board {
    size: (WIDTH, HEIGHT),
    rectifies: false,
    camera: None,
};

/// A board at a TCP port for one host: it answers every command, sends frames once it was started, with a
/// byte changed and a packet left out in some, in pieces of no regular size, and returns all it has sent.
fn board(listener: &TcpListener) -> Vec<u8> {
    let (mut host, _) = listener.accept().unwrap();
    host.set_read_timeout(Some(Duration::from_millis(1)))
        .unwrap();
    let (mut memory, mut encoded) = ([0; 4096], [0; 4096]);
    let mut decoder = Decoder::new(&mut memory);
    let mut encoder = Encoder::new(&mut encoded);
    let (mut sent, mut frame, mut is_started) = (Vec::new(), 0, false);
    let mut waiting = vec![0x37, 0x05];
    loop {
        let mut bytes = [0; 256];
        match host.read(&mut bytes) {
            Ok(0) => return sent,
            Ok(count) => {
                let mut rest = &bytes[..count];
                while let Some(received) = decoder.next::<HostMessage<'_>>(&mut rest) {
                    let Ok(packet) = received else { continue };
                    is_started |= packet.message == HostMessage::Start;
                    let mut send = |message| {
                        waiting.extend_from_slice(encoder.encode(0, &message).unwrap());
                    };
                    if packet.message == HostMessage::SendHello {
                        send(BOARD.hello());
                    }
                    send(BoardMessage::Answer {
                        sequence: packet.sequence,
                        outcome: Outcome::Done,
                    });
                    send(state(is_started));
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return sent,
        }
        if is_started {
            waiting.extend(self::frame(&mut encoder, frame));
            frame += 1;
        }
        for piece in waiting.chunks(173) {
            if host.write_all(piece).is_err() {
                return sent;
            }
            sent.extend_from_slice(piece);
        }
        waiting.clear();
    }
}

fn state(is_started: bool) -> BoardMessage<'static> {
    BoardMessage::State(State {
        is_started,
        selection: Selection::whole(Streams::DISPARITIES),
        source: Source::Camera,
        parameters: Default::default(),
    })
}

/// The packets of a frame, of which every third is damaged.
fn frame(encoder: &mut Encoder<'_>, frame: u32) -> Vec<u8> {
    let begun = BOARD.begun(frame);
    let mut bytes = encoder.encode(0, &begun).unwrap().to_vec();
    for line in 0..HEIGHT {
        let values = [(frame + line) as i16; WIDTH as usize];
        let values = Values::Plain(&values);
        let line = Line {
            frame,
            line,
            column: 0,
            values,
        };
        let packet = encoder.encode(0, &BoardMessage::Disparities(line)).unwrap();
        let mut packet = packet.to_vec();
        if frame % 3 == 1 && line.line == 4 {
            packet[6] ^= 1;
        }
        if frame % 3 != 2 || line.line != 9 {
            bytes.extend(packet);
        }
    }
    bytes.extend_from_slice(
        encoder
            .encode(0, &BoardMessage::FrameDone { frame })
            .unwrap(),
    );
    bytes
}

/// Starts `vgstereo` in the folder.
fn start(fixture: &Fixture, arguments: &[&str]) -> Child {
    let mut command = Command::cargo_bin("vgstereo").unwrap();
    command.current_dir(fixture.folder.path()).args(arguments);
    command.stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

/// The first line of what a command prints.
fn first_line(child: &mut Child) -> String {
    let output = child.stdout.as_mut().unwrap();
    let mut line = Vec::new();
    let mut byte = [0];
    while output.read(&mut byte).unwrap() == 1 && byte[0] != b'\n' {
        line.push(byte[0]);
    }
    String::from_utf8(line).unwrap()
}

#[test]
fn a_recording_has_the_bytes_that_were_sent_and_gives_them_back() {
    let fixture = Fixture::new();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let sender = thread::spawn(move || board(&listener));
    let outcome = fixture.run(&["record", &address, "a.mcap", "--frames", "30"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let sent = sender.join().unwrap();

    let told = fixture.run(&["replay", "a.mcap", "--out", "a.bin"]).stdout;
    let bytes = fs::read(fixture.path("a.bin")).unwrap();
    // The last reads of the sender's bytes may not have taken place.
    assert_eq!(sent[..bytes.len()], bytes);
    assert!(bytes.len() > 10_000);
    // What was said when it was recorded is said when it is replayed.
    let summary = |text: &str| -> Vec<String> {
        let lines = text.lines();
        let lines = lines.filter(|line| line.starts_with("frames") || line.starts_with("packets"));
        lines.map(str::to_owned).collect()
    };
    assert_eq!(summary(&outcome.stdout), summary(&told));
    assert_eq!(summary(&told).len(), 2, "{told}");
    let numbers: Vec<u64> = told
        .lines()
        .find(|line| line.starts_with("frames"))
        .unwrap()
        .split(|c: char| !c.is_ascii_digit())
        .filter_map(|number| number.parse().ok())
        .collect();
    let [whole, with_gaps, aborted] = numbers[..3] else {
        panic!("{told}")
    };
    assert!(whole + with_gaps >= 30 && aborted == 0, "{told}");
    assert!(with_gaps.abs_diff(2 * whole) <= 2, "{told}");

    // Over TCP the same bytes come, and to standard output.
    for source in ["a.mcap", "a.bin"] {
        let arguments = ["replay", source, "--fast", "--listen", "127.0.0.1:0"];
        let mut player = start(&fixture, &arguments);
        let line = first_line(&mut player);
        let mut host = TcpStream::connect(line.strip_prefix("link ").unwrap()).unwrap();
        // Commands are not answered, and are no reason to end.
        host.write_all(&[0; 3000]).unwrap();
        let mut played = Vec::new();
        host.read_to_end(&mut played).unwrap();
        drop(host);
        assert!(played == bytes, "{source}");
        assert!(player.wait().unwrap().success());
    }
    let output = start(&fixture, &["replay", "a.mcap", "--out", "-"]);
    let output = output.wait_with_output().unwrap();
    assert!(output.stdout == bytes);
    assert!(
        String::from_utf8(output.stderr)
            .unwrap()
            .contains("frames: ")
    );
}

#[test]
fn frames_from_before_the_board_knew_what_to_send_do_not_count() {
    let fixture = Fixture::new();
    let (heard, commands) = channel();
    let picture = GrayImage::new(32, 20);
    let script = Script {
        frames_before: 4,
        answer: Box::new(move |command| {
            heard
                .send(matches!(command, HostMessage::Select(_)))
                .unwrap();
            Some(Outcome::Done)
        }),
        ..Script::of(vec![[picture.clone(), picture]])
    };
    let address = script.serve();
    for arguments in [
        &[
            "record",
            &address,
            "a.mcap",
            "--streams",
            "raw",
            "--frames",
            "2",
        ][..],
        &["replay", "a.mcap", "--out", "a.bin"],
    ] {
        let outcome = fixture.run(arguments);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    }
    let bytes = fs::read(fixture.path("a.bin")).unwrap();
    let (mut rest, mut memory) = (&bytes[..], [0; 4096]);
    let mut decoder = Decoder::new(&mut memory);
    let (mut before, mut after, mut is_selected) = (0, 0, false);
    while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut rest) {
        match received.unwrap().message {
            BoardMessage::Answer { .. } => is_selected |= commands.recv().unwrap(),
            BoardMessage::FrameDone { .. } if is_selected => after += 1,
            BoardMessage::FrameDone { .. } => before += 1,
            _ => {}
        }
    }
    assert!(before == 4 && after >= 2, "{before} frames, then {after}");
}

#[test]
fn a_recording_is_played_at_the_pace_at_which_it_came() {
    let fixture = Fixture::new();
    let outcome = fixture.run(&["record", "--demo", "a.mcap", "--seconds", "1.5"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    fixture.run(&["replay", "a.mcap", "--out", "a.bin"]);
    for source in ["a.mcap", "a.bin"] {
        let mut player = start(&fixture, &["replay", source, "--listen", "127.0.0.1:0"]);
        let line = first_line(&mut player);
        let begun = Instant::now();
        let mut host = TcpStream::connect(line.strip_prefix("link ").unwrap()).unwrap();
        host.read_to_end(&mut Vec::new()).unwrap();
        let seconds = begun.elapsed().as_secs_f64();
        drop(host);
        assert!(player.wait().unwrap().success());
        assert!(seconds > 1.2, "{source}: {seconds} s");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_a_recording_well_and_a_kill_leaves_what_has_come() {
    let fixture = Fixture::new();
    for (signal, name) in [("INT", "a.mcap"), ("TERM", "b.mcap"), ("KILL", "c.mcap")] {
        let recorder = start(&fixture, &["record", "--demo", name]);
        let file = fixture.path(name);
        let begun = Instant::now();
        while !fs::metadata(&file).is_ok_and(|data| data.len() > 50_000) {
            assert!(
                begun.elapsed() < Duration::from_secs(120),
                "nothing is recorded"
            );
            thread::sleep(Duration::from_millis(20));
        }
        let id = recorder.id().to_string();
        let kill = Command::new("kill").args(["-s", signal, &id]).status();
        assert!(kill.unwrap().success());
        let outcome = recorder.wait_with_output().unwrap();
        let is_well = signal != "KILL";
        assert_eq!(outcome.status.success(), is_well, "{signal}");
        let told = fixture.run(&["replay", name, "--out", "plain.bin"]).stdout;
        assert_eq!(told.contains("is damaged"), !is_well, "{told}");
        assert!(told.contains(" 0 broken"), "{told}");
        assert!(fs::metadata(fixture.path("plain.bin")).unwrap().len() > 10_000);
    }
}

#[test]
fn a_damaged_recording_is_read_as_far_as_it_is_whole() {
    let fixture = Fixture::new();
    fixture.run(&["record", "--demo", "a.mcap", "--frames", "3"]);
    fixture.run(&["replay", "a.mcap", "--out", "a.bin"]);
    let (whole, plain) = (
        fs::read(fixture.path("a.mcap")).unwrap(),
        fs::read(fixture.path("a.bin")).unwrap(),
    );
    for length in [20, whole.len() / 2, whole.len() - 1000] {
        fs::write(fixture.path("cut.mcap"), &whole[..length]).unwrap();
        let told = fixture.run(&["replay", "cut.mcap", "--out", "cut.bin"]);
        assert_eq!(told.code, Some(0), "{}", told.stderr);
        let cut = fs::read(fixture.path("cut.bin")).unwrap();
        assert_eq!(cut, plain[..cut.len()]);
        assert!(
            told.stdout
                .contains("cut.mcap is damaged: read up to byte "),
            "{}",
            told.stdout
        );
    }
}

#[test]
fn what_cannot_be_recorded_or_replayed_is_refused() {
    let fixture = Fixture::new();
    fs::write(fixture.path("a.mcap"), b"\x89MCAP0\r\n").unwrap();
    fs::write(fixture.path("other.mcap"), other_mcap()).unwrap();
    let refuses = |arguments: &[&str], words: &[&str]| fixture.refuses(arguments, words);
    refuses(
        &["record", "--demo", "a.mcap"],
        &["a.mcap", "there already"],
    );
    refuses(&["record", "a.mcap", "b.mcap"], &["a.mcap", "no board"]);
    refuses(&["record", "b.mcap"], &["serial port"]);
    refuses(&["record", "--demo"], &["RECORDING"]);
    refuses(&["record", "--demo", "none/b.mcap"], &["none/b.mcap"]);
    let demo = |more: &[&str], words: &[&str]| {
        refuses(&[&["record", "--demo", "b.mcap"], more].concat(), words);
    };
    demo(&["--streams", "colour"], &["--streams", "disparities"]);
    demo(&["--streams", "raw,scans"], &["--streams", "scans"]);
    demo(&["--seconds", "-1"], &["--seconds"]);
    demo(&["--frames", "0"], &["--frames"]);
    refuses(&["replay", "none.mcap"], &["none.mcap", "no such file"]);
    refuses(&["replay", "other.mcap"], &["other.mcap", "no recording"]);
    refuses(
        &["replay", "other.mcap", "--out", "x.bin"],
        &["other.mcap", "no recording"],
    );
    refuses(&["view", "other.mcap"], &["other.mcap", "no recording"]);
    refuses(
        &["replay", "a.mcap", "--out", "a.mcap"],
        &["--out", "a.mcap"],
    );
    refuses(
        &["replay", "a.mcap", "--listen", "0.0.0.0:0"],
        &["--listen", "127.0.0.1"],
    );
}

/// An MCAP file of another program.
fn other_mcap() -> Vec<u8> {
    let mut writer = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}
