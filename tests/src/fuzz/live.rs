//! A live board: whatever a host sends, frames go on, and what is sent back can be read.

use std::cell::Cell;

use vgstereo_core::{Config, DisparityRange, Matcher, Portable, Preset};
use vgstereo_firmware::camera::{Geometry, PixelFormat, TestPattern};
use vgstereo_firmware::live::{self, LinkPort, Live, Next, RamStore, Setup};
use vgstereo_firmware::{Event, NoWatchdog, session};
use vgstereo_link::{BoardMessage, Decoder, Selection, Streams};

use super::link_decoder::framed;

const GEOMETRY: Geometry = Geometry {
    width: 24,
    height: 10,
    format: PixelFormat::Grey8,
};

/// Frames that are read, whatever the host says.
const FRAMES: u32 = 3;

thread_local! {
    static NOW_US: Cell<u64> = const { Cell::new(0) };
}

fn now_us() -> u64 {
    NOW_US.with(|now| {
        now.set(now.get() + 1000);
        now.get()
    })
}

/// A port that takes so many bytes at a time, and now and then none.
struct Port {
    at_a_time: usize,
    calls: usize,
    incoming: Vec<u8>,
    sent: Vec<u8>,
}

impl LinkPort for Port {
    fn send(&mut self, bytes: &[u8]) -> usize {
        self.calls += 1;
        if self.calls.is_multiple_of(3) {
            return 0;
        }
        let taken = bytes.len().min(self.at_a_time);
        self.sent.extend_from_slice(&bytes[..taken]);
        taken
    }

    fn receive(&mut self, bytes: &mut [u8]) -> usize {
        let count = bytes.len().min(self.incoming.len());
        for (place, byte) in bytes.iter_mut().zip(self.incoming.drain(..count)) {
            *place = byte;
        }
        count
    }
}

/// Runs a board whose camera is a test pattern. The first byte is the number of bytes that the port takes at a
/// time; if the second is odd, the others are the content of packets between `0xff`s, else a stream as it
/// is.
pub fn run(bytes: &[u8]) {
    let [at_a_time, kind, bytes @ ..] = bytes else {
        return;
    };
    let incoming = if kind % 2 == 1 {
        bytes.split(|byte| *byte == 0xff).flat_map(framed).collect()
    } else {
        bytes.to_vec()
    };
    let mut port = Port {
        at_a_time: usize::from(*at_a_time),
        calls: 0,
        incoming,
        sent: Vec::new(),
    };
    let config = Config::new(
        Preset::Lite.parameters(),
        GEOMETRY.width,
        DisparityRange::up_to(7),
    );
    let mut memory = vec![0; config.memory_words()];
    let mut lines = vec![0; session::memory_words(&GEOMETRY)];
    let mut link = vec![0; live::memory_words(&GEOMETRY, &config)];
    let mut store = vec![0; 300];
    let matcher = Matcher::new(&config, Portable, &mut memory);
    let setup = Setup {
        port: &mut port,
        device: "board",
        firmware: "0",
        preset: "lite",
        camera: None,
        selection: Selection::whole(Streams::DISPARITIES),
        is_started: true,
        clock: now_us,
        gap_us: 10_000,
        keeps_line_offsets: true,
        store: RamStore::new(&mut store, usize::MAX),
        memory: &mut link,
    };
    let matcher = matcher.expect("the configuration is valid");
    let camera = TestPattern::new(GEOMETRY, now_us);
    let live = Live::new(camera, None, matcher, &mut lines, NoWatchdog, setup);
    let mut live = live.expect("camera and matcher suit each other");
    let (mut done, mut steps) = (0, 0);
    while done < FRAMES {
        match live.step() {
            Next::Event(Event::FrameDone { .. }) => done += 1,
            Next::Event(Event::Fault(fault)) => panic!("a command broke a frame: {fault}"),
            Next::Event(_) => {}
            Next::Calibrated => break,
        }
        steps += 1;
        assert!(steps <= (FRAMES + 1) * GEOMETRY.height, "frames do not end");
    }
    // Whole packets, in a row, but for one that is not sent to its end.
    let mut memory = vec![0; live::sent_bytes(&GEOMETRY, &config)];
    let mut decoder = Decoder::new(&mut memory);
    let mut rest = &port.sent[..];
    while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut rest) {
        assert!(received.is_ok(), "{received:?}");
    }
    assert_eq!(decoder.counters().lost, 0);
}
