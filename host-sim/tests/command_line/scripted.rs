//! A board that is a script: it speaks the link over TCP, shows given pictures, and answers as it is told.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;
use std::time::Duration;

use image::GrayImage;
use vgstereo_link::board::{FrameBegun, Hello, LinePair, Outcome, View};
use vgstereo_link::{
    BoardMessage, Decoder, Encoder, HostMessage, Parameters, PixelFormat, Region, Selection,
    Source, State, Streams, memory_bytes,
};

/// Pause after each frame.
const PAUSE: Duration = Duration::from_millis(20);

/// Answers commands; `None` cuts the connection.
type Answer = Box<dyn FnMut(&HostMessage<'_>) -> Option<Outcome> + Send>;

/// What the board is.
pub(crate) struct Script {
    /// The streams that it says it has.
    pub streams: Streams,
    /// The largest piece of a calibration that it says it takes; 0 if none.
    pub piece_bytes_max: u16,
    /// The pairs that its camera sees, one after the other and again from the first, of one size.
    pub pairs: Vec<[GrayImage; 2]>,
    /// Frames that it sends before it answers what it is to send, as a board does that has more to do.
    pub frames_before: usize,
    /// The connection is cut after so many frames.
    pub frames_max: Option<usize>,
    /// What becomes of a command.
    pub answer: Answer,
}

impl Script {
    /// A board with raw views that carries out everything.
    pub(crate) fn of(pairs: Vec<[GrayImage; 2]>) -> Self {
        Self {
            streams: Streams::RAW,
            piece_bytes_max: 0,
            pairs,
            frames_before: 0,
            frames_max: None,
            answer: Box::new(|_| Some(Outcome::Done)),
        }
    }

    /// Serves one host in a thread that ends with it; returns the address.
    pub(crate) fn serve(self) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        thread::spawn(move || {
            let (stream, _) = listener.accept().unwrap();
            self.run(&stream);
        });
        address
    }

    /// Speaks with the host until it has gone or is cut.
    fn run(mut self, stream: &TcpStream) {
        stream.set_read_timeout(Some(PAUSE)).unwrap();
        let size = self
            .pairs
            .first()
            .map_or((16, 16), |[left, _]| left.dimensions());
        let view = View {
            width_px: size.0 as u16,
            height_lines: size.1,
            format: PixelFormat::Grey8,
        };
        let room = memory_bytes(view.width_px, view.format, Streams::RAW);
        let (mut sent, mut received) = (vec![0; room], vec![0; 4096]);
        let mut encoder = Encoder::new(&mut sent);
        let mut decoder = Decoder::new(&mut received);
        let mut is_started = false;
        let frames_max = self.frames_max.unwrap_or(usize::MAX);
        let mut pairs = self.pairs.iter().cycle().take(frames_max);
        let mut bytes = [0; 4096];
        let mut frame = 0;
        let (mut from_host, mut to_host) = (stream, stream);
        let mut send = |frame: u32, message: &BoardMessage<'_>| {
            let packet = encoder.encode(u64::from(frame) * 20_000, message).unwrap();
            to_host.write_all(packet).is_ok()
        };
        loop {
            let count = match from_host.read(&mut bytes) {
                Ok(0) => return,
                Ok(count) => count,
                Err(error)
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) =>
                {
                    0
                }
                Err(_) => return,
            };
            let mut rest = &bytes[..count];
            while let Some(got) = decoder.next::<HostMessage<'_>>(&mut rest) {
                let Ok(packet) = got else { continue };
                let Some(outcome) = (self.answer)(&packet.message) else {
                    return;
                };
                match packet.message {
                    HostMessage::Start => is_started = true,
                    HostMessage::Stop => is_started = false,
                    HostMessage::SendHello => {
                        let hello = hello(view, self.streams, self.piece_bytes_max);
                        send(frame, &BoardMessage::Hello(hello));
                        // A slow line: it comes in a read of its own.
                        thread::sleep(PAUSE);
                        send(frame, &BoardMessage::State(state(is_started)));
                    }
                    HostMessage::Select(_) => {
                        for pair in pairs.by_ref().take(self.frames_before) {
                            send_frame(view, frame, pair, &mut send);
                            frame += 1;
                        }
                    }
                    _ => {}
                }
                let answer = BoardMessage::Answer {
                    sequence: packet.sequence,
                    outcome,
                };
                send(frame, &answer);
            }
            if is_started {
                let Some(pair) = pairs.next() else { return };
                if !send_frame(view, frame, pair, &mut send) {
                    return;
                }
                frame += 1;
            }
        }
    }
}

/// Sends a pair as a frame, and returns whether the host is still there.
fn send_frame(
    view: View,
    frame: u32,
    pair: &[GrayImage; 2],
    send: &mut dyn FnMut(u32, &BoardMessage<'_>) -> bool,
) -> bool {
    let begun = FrameBegun {
        frame,
        timestamp_us: u64::from(frame) * 20_000,
        region: Region {
            x_px: 0,
            y_lines: 0,
            width_px: view.width_px,
            height_lines: view.height_lines,
        },
    };
    send(frame, &BoardMessage::FrameBegun(begun));
    let width = usize::from(view.width_px);
    let [left, right] = pair
        .each_ref()
        .map(|picture| picture.as_raw().chunks(width));
    for (line, (left, right)) in (0..).zip(left.zip(right)) {
        let pair = LinePair {
            frame,
            line,
            format: view.format,
            left,
            right,
        };
        send(frame, &BoardMessage::RawPair(pair));
    }
    send(frame, &BoardMessage::FrameDone { frame })
}

fn hello(view: View, streams: Streams, piece_bytes_max: u16) -> Hello<'static> {
    Hello {
        device: "script",
        firmware: "1",
        raw: view,
        matched: view,
        preset: "lite",
        disparity_min_px: 0,
        disparity_count: 16,
        latency_lines: 7,
        streams,
        calibration_crc32: None,
        rectifies: false,
        piece_bytes_max,
    }
}

fn state(is_started: bool) -> State {
    State {
        is_started,
        selection: Selection::whole(Streams::DISPARITIES),
        source: Source::Camera,
        parameters: Parameters::default(),
    }
}
