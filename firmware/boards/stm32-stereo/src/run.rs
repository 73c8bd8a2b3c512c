//! The loop of a board's session, with its log.

use embassy_stm32::usart::BufferedUart;
use vgstereo_core::geometry::Rectifier;
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::camera::LinePairSource;
use vgstereo_firmware::sink::serial::SerialSink;
use vgstereo_firmware::{Event, Session};

use crate::clock;
use crate::watchdog::Iwdg;

/// Matches what the camera sends, for ever, rectified first if there is a rectifier, and sends the
/// disparities over the serial port. Logs each frame with its time and all counters, and each fault.
/// `packet` holds a packet of a line and `lines` a line of each view.
///
/// # Panics
/// If camera, rectifier, matcher and lines do not suit each other.
pub fn run<C: LinePairSource, K: Kernels>(
    camera: C,
    rectifier: Option<&'static mut Rectifier<'static, 'static, K>>,
    matcher: Matcher<'static, K>,
    serial: BufferedUart<'static>,
    packet: &'static mut [u8],
    lines: &'static mut [u32],
    watchdog: Iwdg,
) -> ! {
    let sink = SerialSink::new(serial, packet);
    let session = Session::rectifying(camera, rectifier, matcher, sink, lines, watchdog);
    let mut session = defmt::unwrap!(session);
    let mut begun = clock::now();
    loop {
        match session.step() {
            Ok(Event::FrameDone { frame }) => {
                let took = clock::since(core::mem::replace(&mut begun, clock::now()));
                let statistics = session.statistics();
                defmt::info!("frame {} in {}: {}", frame, took, statistics);
            }
            Ok(Event::Fault(fault)) => defmt::warn!("{}", fault),
            Ok(_) => {}
            Err(error) => defmt::warn!("{}", error),
        }
    }
}
