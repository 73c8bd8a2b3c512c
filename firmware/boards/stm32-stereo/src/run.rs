//! The loop of a board's live session, with its log.

use vgstereo_core::geometry::Rectifier;
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::Event;
use vgstereo_firmware::camera::LinePairSource;
use vgstereo_firmware::live::{Live, Next, NoStore, Setup};
use vgstereo_link::{Selection, Streams};

use crate::clock;
use crate::rig::Rig;
use crate::serial::SerialPort;
use crate::watchdog::Iwdg;

/// Streams that a board sends from its start, until the host selects others.
const SELECTION: Selection = Selection::whole(Streams::DISPARITIES);

/// A board's link to the host.
pub struct Link {
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
}

/// Matches what the camera sends, for ever, rectified first if there is a rectifier, and serves the
/// link. Logs each frame with its time and all counters, and each fault. `lines` holds a line of each
/// view.
///
/// # Panics
/// If camera, rectifier, matcher and memories do not suit each other.
pub fn run<C: LinePairSource, K: Kernels>(
    rig: &Rig,
    camera: C,
    rectifier: Option<&'static mut Rectifier<'static, 'static, K>>,
    matcher: Matcher<'static, K>,
    lines: &'static mut [u32],
    link: Link,
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
        store: NoStore,
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
            // No calibration can be stored from the host.
            Next::Event(_) | Next::Calibrated => {}
        }
    }
}

/// Time since start, µs.
fn now_us() -> u64 {
    clock::now().as_micros()
}
