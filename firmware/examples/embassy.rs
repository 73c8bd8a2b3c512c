//! Embassy: a camera that delivers lines from an interrupt, and a task that matches them.
//!
//!     cargo run -p vgstereo-firmware --features link --example embassy
//!
//! Three tasks run on one executor, here on a PC; on a chip they are the same, with another executor.
//! `camera` stands for the interrupt of a camera port: it fills the next free pair of line buffers and
//! never waits. A pair for which none is free is lost, as an overrun. `stereo` is woken by each pair and
//! pushes it into the session, which drops a frame that is not whole and goes on with the next. `host`
//! prints what comes over the link, and ends the program after three frames.

use embassy_executor::{Executor, Spawner};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::zerocopy_channel::{Channel, Receiver, Sender};
use embassy_time::{Instant, Timer};
use static_cell::{ConstStaticCell, StaticCell};
use vgstereo_core::{Config, DisparityRange, Matcher, Portable, Preset};
use vgstereo_firmware::camera::{
    ErrorKind, Geometry, LinePair, LinePairSource, PixelFormat, TestPattern,
};
use vgstereo_firmware::live::{self, LinkPort, Live, NoStore, Setup};
use vgstereo_firmware::{Event, NoWatchdog};
use vgstereo_link::{BoardMessage, Decoder, Selection, Streams};

const GEOMETRY: Geometry = Geometry {
    width: 64,
    height: 32,
    format: PixelFormat::Grey8,
};
const CONFIG: Config = Config::new(
    Preset::Lite.parameters(),
    GEOMETRY.width,
    DisparityRange::up_to(31),
);
const _: () = assert!(CONFIG.validate().is_ok());

/// What the interrupt hands over: a pair of lines, or what went wrong.
struct Delivery {
    pair: Result<LinePair, ErrorKind>,
    left: [u8; GEOMETRY.line_bytes()],
    right: [u8; GEOMETRY.line_bytes()],
}

const EMPTY: Delivery = Delivery {
    pair: Err(ErrorKind::Other),
    left: [0; GEOMETRY.line_bytes()],
    right: [0; GEOMETRY.line_bytes()],
};

/// Pairs of lines that may wait: this is all that is kept of a frame before it is matched.
const WAITING_PAIRS: usize = 4;

type Mutex = CriticalSectionRawMutex;
type Lines = Channel<'static, Mutex, Delivery>;

static LINES: StaticCell<Lines> = StaticCell::new();
static LINE_BUFFERS: ConstStaticCell<[Delivery; WAITING_PAIRS]> =
    ConstStaticCell::new([EMPTY; WAITING_PAIRS]);
static MATCHER: ConstStaticCell<[u32; CONFIG.memory_words()]> =
    ConstStaticCell::new([0; CONFIG.memory_words()]);
static LINK: ConstStaticCell<[u32; live::memory_words(&GEOMETRY, &CONFIG)]> =
    ConstStaticCell::new([0; live::memory_words(&GEOMETRY, &CONFIG)]);
/// In place of a serial port's buffers.
static TO_HOST: Pipe<Mutex, 1024> = Pipe::new();
static FROM_HOST: Pipe<Mutex, 256> = Pipe::new();

/// The board's end of the serial port.
struct Serial;

impl LinkPort for Serial {
    fn send(&mut self, bytes: &[u8]) -> usize {
        TO_HOST.try_write(bytes).unwrap_or(0)
    }

    fn receive(&mut self, bytes: &mut [u8]) -> usize {
        FROM_HOST.try_read(bytes).unwrap_or(0)
    }
}

fn now_us() -> u64 {
    Instant::now().as_micros()
}

/// The camera port: a pair each 200 µs, and a line that is lost in frame 1.
#[embassy_executor::task]
async fn camera(mut lines: Sender<'static, Mutex, Delivery>) {
    let mut pattern = TestPattern::new(GEOMETRY, now_us);
    let mut lost = EMPTY;
    loop {
        Timer::after_micros(200).await;
        let free = lines.try_send();
        let is_overrun = free.is_none();
        let place = free.unwrap_or(&mut lost);
        place.pair = pattern.read_pair(&mut place.left, &mut place.right);
        if is_overrun {
            continue;
        }
        if let Ok(LinePair {
            frame: 1, line: 10, ..
        }) = place.pair
        {
            place.pair = Err(ErrorKind::SyncLost);
        }
        lines.send_done();
    }
}

/// The session: woken by each pair.
#[embassy_executor::task]
async fn stereo(mut lines: Receiver<'static, Mutex, Delivery>) {
    let matcher =
        Matcher::new(&CONFIG, Portable, MATCHER.take()).expect("the configuration is valid");
    let setup = Setup {
        port: Serial,
        device: "embassy example",
        firmware: env!("CARGO_PKG_VERSION"),
        preset: Preset::Lite.name(),
        camera: None,
        selection: Selection::whole(Streams::DISPARITIES),
        is_started: true,
        clock: now_us,
        // The camera does not wait: what the port has no room for is left out.
        gap_us: 0,
        keeps_line_offsets: false,
        store: NoStore,
        memory: LINK.take(),
    };
    let live = Live::pushed(GEOMETRY, None, matcher, NoWatchdog, setup);
    let mut live = live.expect("the pattern's lines suit the matcher");
    loop {
        let delivery = lines.receive().await;
        let next = match &delivery.pair {
            Ok(pair) => live.take_pair(pair, &delivery.left, &delivery.right),
            Err(error) => live.take_error(*error),
        };
        lines.receive_done();
        if let live::Next::Event(Event::Fault(fault)) = next {
            println!("fault: {fault}");
        }
    }
}

/// The other end of the serial port.
#[embassy_executor::task]
async fn host() {
    let mut memory = [0; live::sent_bytes(&GEOMETRY, &CONFIG)];
    let mut decoder = Decoder::new(&mut memory);
    let (mut frames, mut lines) = (0, 0);
    loop {
        let mut bytes = [0; 64];
        let count = TO_HOST.read(&mut bytes).await;
        let mut rest = &bytes[..count];
        while let Some(received) = decoder.next::<BoardMessage<'_>>(&mut rest) {
            match received.map(|packet| packet.message) {
                Ok(BoardMessage::Hello(hello)) => println!("hello from {}", hello.device),
                Ok(BoardMessage::FrameBegun(_)) => lines = 0,
                Ok(BoardMessage::Disparities(_)) => lines += 1,
                Ok(BoardMessage::FrameAborted { frame, reason }) => {
                    println!("frame {frame} aborted after {lines} lines: {reason:?}");
                }
                Ok(BoardMessage::FrameDone { frame }) => {
                    println!("frame {frame}: {lines} of {} lines", GEOMETRY.height);
                    frames += 1;
                }
                Ok(_) => {}
                Err(refusal) => println!("{refusal}"),
            }
        }
        if frames == 3 {
            std::process::exit(0);
        }
    }
}

fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    let lines = LINES.init(Channel::new(LINE_BUFFERS.take()));
    let (sender, receiver) = lines.split();
    EXECUTOR.init(Executor::new()).run(|spawner: Spawner| {
        spawner.spawn(camera(sender).expect("each task is spawned once"));
        spawner.spawn(stereo(receiver).expect("each task is spawned once"));
        spawner.spawn(host().expect("each task is spawned once"));
    })
}
