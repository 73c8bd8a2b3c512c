//! What the board is told, and what becomes of sources that end or are lost.

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use vgstereo_link::board::Outcome;
use vgstereo_link::{BoardMessage, Decoder, Encoder, HostMessage, Parameters, Selection, Streams};
use vgstereo_sim::link::source::Source;
use vgstereo_sim::view::reader::Reader;

use crate::fixture::{Client, Served, WAIT, encoded, frame_messages, hello};

/// A page on this source, and a client of it.
fn watch(source: Source) -> (Served, Client) {
    let mut served = Served::new();
    let commands = served.commands.take().unwrap();
    let reader = Reader::new(&source, Arc::clone(&served.hub), commands, None);
    let port = source.open().unwrap();
    thread::spawn(move || reader.run(&source, port));
    let client = served.client(None).unwrap();
    (served, client)
}

/// The board's end of a connection.
struct Board {
    stream: TcpStream,
    encoder: Encoder<'static>,
    decoder: Decoder<'static>,
    /// Bytes that have come and were not looked at.
    rest: Vec<u8>,
}

/// A command, as far as the tests look at it.
#[derive(Debug, PartialEq, Eq)]
enum Got {
    Hello,
    Start,
    Stop,
    Select(Streams),
    Parameters(Parameters),
    Other,
}

impl Board {
    fn accept(listener: &TcpListener) -> Self {
        let (stream, _) = listener.accept().unwrap();
        stream.set_read_timeout(Some(WAIT)).unwrap();
        Self {
            stream,
            encoder: Encoder::new(vec![0; 1024].leak()),
            decoder: Decoder::new(vec![0; 1024].leak()),
            rest: vec![],
        }
    }

    fn send(&mut self, message: &BoardMessage<'_>) {
        let bytes = self.encoder.encode(0, message).unwrap();
        self.stream.write_all(bytes).unwrap();
    }

    /// The next command, and its sequence number.
    fn command(&mut self) -> (u32, Got) {
        loop {
            let mut rest = &self.rest[..];
            let received = self.decoder.next::<HostMessage<'_>>(&mut rest);
            let got = received.map(|packet| {
                let packet = packet.unwrap();
                let got = match packet.message {
                    HostMessage::SendHello => Got::Hello,
                    HostMessage::Start => Got::Start,
                    HostMessage::Stop => Got::Stop,
                    HostMessage::Select(Selection { streams, .. }) => Got::Select(streams),
                    HostMessage::Parameters(parameters) => Got::Parameters(parameters),
                    _ => Got::Other,
                };
                (packet.sequence, got)
            });
            self.rest = rest.to_vec();
            if let Some(got) = got {
                return got;
            }
            let mut bytes = [0; 512];
            let count = self.stream.read(&mut bytes).unwrap();
            assert!(count > 0, "the view has closed the connection");
            self.rest.extend(&bytes[..count]);
        }
    }

    fn expects(&mut self, expected: Got) -> u32 {
        let (sequence, got) = self.command();
        assert_eq!(got, expected);
        sequence
    }
}

#[test]
fn the_board_is_asked_for_what_is_shown_and_its_answers_are_told() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (served, mut client) = watch(Source::Tcp(address));
    let mut board = Board::accept(&listener);
    board.expects(Got::Hello);
    board.expects(Got::Select(Streams::NONE));
    board.expects(Got::Start);
    client.send(r#"{"show":["raw"]}"#);
    board.expects(Got::Select(Streams::RAW));
    let mut other = served.client(None).unwrap();
    other.send(r#"{"show":["disparity","scan"]}"#);
    board.expects(Got::Select(Streams::RAW.with(Streams::DISPARITIES)));
    // A packet later than its first, so that it is the answer to the question above.
    board.send(&BoardMessage::FrameDone { frame: 0 });
    let all = Streams::from_bits(0x7f);
    board.send(&hello(all));
    let scans = Streams::DISPARITIES.with(Streams::SCANS);
    board.expects(Got::Select(Streams::RAW.with(scans)));
    drop(client);
    board.expects(Got::Select(scans));

    other.send(r#"{"board":{"parameters":{"margin":30}}}"#);
    let sequence = board.expects(Got::Parameters(Parameters {
        margin: Some(30),
        ..Parameters::default()
    }));
    let outcome = Outcome::OutOfBounds;
    board.send(&BoardMessage::Answer { sequence, outcome });
    let told = |name: &'static str, outcome: &'static str| {
        move |status: &serde_json::Value| {
            let commands = status["commands"].as_array().unwrap();
            commands
                .iter()
                .any(|c| c["name"] == name && c["outcome"] == outcome)
        }
    };
    other.status(told("margin 30", "out of bounds"));
    other.send(r#"{"board":"stop"}"#);
    board.expects(Got::Stop);
    let asked = Instant::now();
    other.status(told("stop", "no answer"));
    assert!(
        asked.elapsed() > Duration::from_millis(1500),
        "{:?}",
        asked.elapsed()
    );

    for message in frame_messages(4) {
        board.send(&message);
    }
    assert!(other.frame().is_some());
}

#[test]
fn a_lost_board_is_told_and_set_up_again_when_it_is_back() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (_served, mut client) = watch(Source::Tcp(address));
    client.send(r#"{"show":["disparity"]}"#);
    let mut board = Board::accept(&listener);
    board.send(&hello(Streams::DISPARITIES));
    client.status(|status| status["board"]["device"] == "feeder");
    drop(board);
    client.status(|status| status["source"]["kind"] == "lost" && status["board"].is_null());
    let mut board = Board::accept(&listener);
    board.expects(Got::Hello);
    board.expects(Got::Select(Streams::DISPARITIES));
    board.expects(Got::Start);
    client.status(|status| status["source"]["kind"] == "connected");
    // A board that starts anew while the connection stays is set up anew as well.
    board.send(&hello(Streams::DISPARITIES));
    board.expects(Got::Select(Streams::DISPARITIES));
    board.expects(Got::Start);
}

#[test]
fn a_recording_is_played_at_its_pace_and_its_last_frame_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.bin");
    let second = frame_messages(2).into_iter().map(|m| (700_000, m));
    let messages = frame_messages(1).into_iter().map(|m| (0, m)).chain(second);
    let mut bytes = encoded(&messages.collect::<Vec<_>>());
    // What damage there is in a recording is told and harms nothing.
    bytes.extend(b"\x05dirt\0");
    fs::write(&path, &bytes).unwrap();
    for is_fast in [false, true] {
        let path = path.clone();
        let started = Instant::now();
        let (served, mut client) = watch(Source::File { path, is_fast });
        client.send(r#"{"show":["disparity"]}"#);
        client.status(|status| status["source"]["kind"] == "ended");
        let is_slow = started.elapsed() > Duration::from_millis(650);
        assert_eq!(is_slow, !is_fast, "{:?}", started.elapsed());
        // Who comes later sees it too.
        let mut late = served.client(None).unwrap();
        late.send(r#"{"show":["disparity"]}"#);
        let frame = String::from_utf8_lossy(&late.frame().unwrap()).into_owned();
        assert!(frame.contains(r#""frame":2,"#), "{frame}");
        late.send(r#"{"board":"stop"}"#);
        let status = late.status(|status| !status["commands"].as_array().unwrap().is_empty());
        assert_eq!(
            status["commands"][0]["outcome"],
            "a recording takes no commands"
        );
        assert_eq!(
            (&status["frames"]["whole"], &status["packets"]["broken"]),
            (&2.into(), &1.into())
        );
    }
}
