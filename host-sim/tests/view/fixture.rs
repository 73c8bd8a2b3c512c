//! What the tests share: a served hub, clients, and packets of a board.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};
use vgstereo_link::board::{FrameBegun, Hello, View};
use vgstereo_link::{BoardMessage, Encoder, Line, PixelFormat, Region, Streams, Values};
use vgstereo_sim::view::hub::Hub;
use vgstereo_sim::view::request::Command;
use vgstereo_sim::view::server;

/// Longest time that a test waits for what must come.
pub(crate) const WAIT: Duration = Duration::from_secs(20);

/// A hub whose page is served.
pub(crate) struct Served {
    pub hub: Arc<Hub>,
    pub address: SocketAddr,
    pub commands: Option<Receiver<Command>>,
}

impl Served {
    pub(crate) fn new() -> Self {
        let listener = server::listen("127.0.0.1:0".parse().unwrap()).unwrap();
        let address = listener.local_addr().unwrap();
        let (hub, commands) = Hub::new();
        let hub = Arc::new(hub);
        let served = Arc::clone(&hub);
        thread::spawn(move || server::serve(listener, served));
        Self {
            hub,
            address,
            commands: Some(commands),
        }
    }

    /// The answer to a request for a path with these lines of the head.
    pub(crate) fn get(&self, path: &str, head: &[&str]) -> String {
        let mut stream = TcpStream::connect(self.address).unwrap();
        let lines = head.iter().map(|line| format!("{line}\r\n"));
        let head: String = lines.collect();
        write!(
            stream,
            "GET {path} HTTP/1.1\r\n{head}Connection: close\r\n\r\n"
        )
        .unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        String::from_utf8_lossy(&answer).into_owned()
    }

    /// The answer to a request of the page's own for a path.
    pub(crate) fn page(&self, path: &str) -> String {
        self.get(path, &[&format!("Host: {}", self.address)])
    }

    /// A client whose handshake states this origin, or the status that refuses it.
    pub(crate) fn client(&self, origin: Option<&str>) -> Result<Client, u16> {
        let mut request = format!("ws://{}/live", self.address)
            .into_client_request()
            .unwrap();
        if let Some(origin) = origin {
            let origin = HeaderValue::from_str(origin).unwrap();
            request.headers_mut().insert("Origin", origin);
        }
        let stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(WAIT)).unwrap();
        match tungstenite::client(request, stream) {
            Ok((socket, _)) => Ok(Client(socket)),
            Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(answer))) => {
                Err(answer.status().as_u16())
            }
            Err(error) => panic!("{error}"),
        }
    }
}

/// A client of the page's connection.
pub(crate) struct Client(pub WebSocket<TcpStream>);

impl Client {
    /// Sends a text.
    pub(crate) fn send(&mut self, text: &str) {
        self.0.send(Message::text(text)).unwrap();
    }

    /// The next frame; `None` when the server has closed the connection.
    pub(crate) fn frame(&mut self) -> Option<Vec<u8>> {
        loop {
            match self.0.read() {
                Ok(Message::Binary(bytes)) => return Some(bytes.to_vec()),
                Ok(Message::Close(_)) | Err(_) => return None,
                Ok(_) => {}
            }
        }
    }

    /// The next status for which this holds.
    #[track_caller]
    pub(crate) fn status(&mut self, holds: impl Fn(&Value) -> bool) -> Value {
        let started = Instant::now();
        let mut last = Value::Null;
        while started.elapsed() < WAIT {
            if let Message::Text(text) = self.0.read().unwrap() {
                last = serde_json::from_str(&text).unwrap();
                if holds(&last) {
                    return last;
                }
            }
        }
        panic!("{last:#}");
    }
}

/// The disparities of the frames below, 1/16 px.
pub(crate) const DISPARITIES: [i16; 6] = [160, 161, i16::MIN, -7, 0, 320];

/// The messages of a frame of two lines of three disparities.
pub(crate) fn frame_messages(number: u32) -> Vec<BoardMessage<'static>> {
    let region = Region {
        x_px: 0,
        y_lines: 0,
        width_px: 3,
        height_lines: 2,
    };
    let begun = BoardMessage::FrameBegun(FrameBegun {
        frame: number,
        timestamp_us: 0,
        region,
    });
    let lines = (0..).zip(DISPARITIES.chunks(3)).map(|(line, values)| {
        BoardMessage::Disparities(Line {
            frame: number,
            line,
            column: 0,
            values: Values::Plain(values),
        })
    });
    let done = BoardMessage::FrameDone { frame: number };
    [begun].into_iter().chain(lines).chain([done]).collect()
}

/// The introduction of a board that can send these streams.
pub(crate) fn hello(streams: Streams) -> BoardMessage<'static> {
    let view = View {
        width_px: 3,
        height_lines: 2,
        format: PixelFormat::Grey8,
    };
    BoardMessage::Hello(Hello {
        device: "feeder",
        firmware: "1",
        raw: view,
        matched: view,
        preset: "lite",
        disparity_min_px: 0,
        disparity_count: 48,
        latency_lines: 1,
        streams,
        calibration_crc32: None,
        rectifies: false,
        piece_bytes_max: 0,
    })
}

/// The bytes of these messages, sent at these times, µs.
pub(crate) fn encoded(messages: &[(u64, BoardMessage<'_>)]) -> Vec<u8> {
    let mut memory = vec![0; 4096];
    let mut encoder = Encoder::new(&mut memory);
    let packets = messages.iter();
    packets
        .flat_map(|(time_us, message)| encoder.encode(*time_us, message).unwrap().to_vec())
        .collect()
}
