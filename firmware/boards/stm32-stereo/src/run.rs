//! The loop of a board's live session, with its log.

use cortex_m::peripheral::SCB;
use embassy_time::Duration;
use vgstereo_core::geometry::Rectifier;
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::Event;
use vgstereo_firmware::camera::LinePairSource;
use vgstereo_firmware::live::{CalibrationStore, Live, Next, Setup};
use vgstereo_link::{Selection, Streams};

use crate::clock;
use crate::rig::Rig;
use crate::serial::SerialPort;
use crate::watchdog::Iwdg;

/// Streams that a board sends from its start, until the host selects others.
const SELECTION: Selection = Selection::whole(Streams::DISPARITIES);

/// The longest wait for the last bytes to leave before a restart: at 2 Mbaud the port's buffer takes some
/// 20 ms.
const DRAIN: Duration = Duration::from_millis(200);

/// A board's link to the host.
pub struct Link<T> {
    /// The port.
    pub port: SerialPort,
    /// The board's name.
    pub device: &'static str,
    /// Version of its firmware.
    pub firmware: &'static str,
    /// Name of its preset.
    pub preset: &'static str,
    /// Memory of [`live::memory_words`](vgstereo_firmware::live::memory_words).
    pub memory: &'static mut [u32],
    /// Where a calibration from the host is kept.
    pub store: T,
}

/// Matches what the camera sends, for ever, rectified first if there is a rectifier, and serves the
/// link. Logs each frame with its time and all counters, and each fault. `lines` holds a line of each
/// view. When the host has stored a calibration, the board restarts.
///
/// # Panics
/// If camera, rectifier, matcher and memories do not suit each other.
pub fn run<C: LinePairSource, K: Kernels, T: CalibrationStore>(
    rig: &Rig,
    camera: C,
    rectifier: Option<&'static mut Rectifier<'static, 'static, K>>,
    matcher: Matcher<'static, K>,
    lines: &'static mut [u32],
    link: Link<T>,
    watchdog: Iwdg,
) -> ! {
    let setup = Setup {
        port: link.port,
        device: link.device,
        firmware: link.firmware,
        preset: link.preset,
        camera: None,
        selection: SELECTION,
        is_started: true,
        clock: now_us,
        // A frame begins when it is asked for.
        gap_us: rig.frame_us().into(),
        keeps_line_offsets: true,
        store: link.store,
        memory: link.memory,
    };
    let live = Live::new(camera, rectifier, matcher, lines, watchdog, setup);
    let mut live = defmt::unwrap!(live);
    let mut begun = clock::now();
    loop {
        match live.step() {
            Next::Event(Event::FrameDone { frame }) => {
                let took = clock::since(core::mem::replace(&mut begun, clock::now()));
                let statistics = live.statistics();
                defmt::info!("frame {} in {}: {}", frame, took, statistics);
            }
            Next::Event(Event::Fault(fault)) => defmt::warn!("{}", fault),
            Next::Event(_) => {}
            Next::Calibrated => break,
        }
    }
    defmt::info!("another calibration: the board restarts");
    let (_, mut port, _) = live.into_parts();
    port.drain(DRAIN);
    SCB::sys_reset()
}

/// Time since start, µs.
fn now_us() -> u64 {
    clock::now().as_micros()
}
