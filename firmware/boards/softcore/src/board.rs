//! The board: two camera ports, a matcher, and a host at the serial port.
//!
//! The host writes a [`Request`] into the image that the block RAM is loaded with ([`REQUEST`]), and the rectification of the
//! sensors' lines, if they are to be rectified ([`CALIBRATION`]). If the request is for the link, the board sends frames for ever
//! and takes commands, a calibration among them. Otherwise it sends some frames, and at their end the counters of the session
//! and the cycles of each stage.

use core::convert::Infallible;
use core::fmt::Write;

use vgstereo_core::{Config, Kernels, Matcher, Only, Preset, Scope, Scoped, presets};
use vgstereo_emulated::live::{self, Device};
use vgstereo_emulated::memories::Memories;
use vgstereo_emulated::meter::{Meter, Metered};
use vgstereo_emulated::request::Refusal;
use vgstereo_emulated::serial::SerialPort as LinkPort;
use vgstereo_emulated::stack::Stack;
use vgstereo_emulated::task::Task;
use vgstereo_emulated::{Report, Request, rectifier};
use vgstereo_firmware::{Session, Watchdog};

use crate::camera::Dvp;
use crate::clock::{Cycles, Timer, now_us};
use crate::news::{Log, News, Pending};
use crate::processor;
use crate::registers::LEDS;
use crate::sink::{PACKET_BYTES, Sender};
use crate::uart::SerialPort;

/// The preset that this firmware is for: there is no room for all of them.
const PRESET: Preset = if cfg!(feature = "micro") {
    Preset::Micro
} else {
    Preset::Lite
};

/// The scope of this firmware: matching with [`PRESET`], of lines of grey. Code that neither needs is not linked.
#[derive(Clone, Copy)]
struct Built;

impl Scoped for Built {
    const SCOPE: Scope = Scope {
        colour: false,
        ..match PRESET {
            Preset::Micro => presets::Micro::SCOPE,
            _ => presets::Lite::SCOPE,
        }
    };
}

/// Bytes of memory lent to session and matcher.
const LENT_BYTES: usize = 50 * 1024;

#[unsafe(export_name = "lent_memory")]
static mut MEMORY: [u32; LENT_BYTES / 4] = [0; LENT_BYTES / 4];

static mut PACKET: [u8; PACKET_BYTES] = [0; PACKET_BYTES];

/// The request, as text that ends with a zero. Whoever loads the image writes it here.
#[unsafe(export_name = "request")]
static REQUEST: [u8; 512] = [0; 512];

/// The bytes of the rectification of the sensors' lines, and then zeros; zeros alone if the request has none. Whoever loads
/// the image writes it here.
#[unsafe(export_name = "calibration")]
static CALIBRATION: [u8; 4096] = [0; 4096];

/// The LEDs that are lit while the board runs, a bit for each.
pub(crate) const LEDS_RUNNING: u32 = 0x01;
/// The number of the LED that is lit when the left sensor does not answer; that of the right sensor is the next one.
pub(crate) const LED_LEFT_SENSOR: u32 = 1;
/// The LEDs that are lit after the board has failed.
const LEDS_FAILED: u32 = 0xff;

/// Kernels of a program for this board.
pub(crate) trait BoardKernels: Kernels {
    /// Whether they have room for rows of so many pixels and disparities.
    fn fit(&self, width: usize, disparities: usize) -> bool;
}

/// Serves the request with these kernels: for ever, or for some frames, and then waits for ever.
pub(crate) fn run(kernels: impl BoardKernels) -> ! {
    // SAFETY: it runs on the main stack, there is no heap, and no interrupt is enabled.
    let stack = unsafe { Stack::paint_main() };
    LEDS.write(LEDS_RUNNING);
    processor::start();
    let (memory, packet) = (&raw mut MEMORY, &raw mut PACKET);
    // SAFETY: this is the only place that takes them, and it is reached once.
    let (memory, packet) = unsafe { (&mut *memory, &mut *packet) };
    let meter = Meter::new(Cycles);
    let sender = Sender::new(SerialPort::new(), packet, &meter);
    let mut watchdog = Timer::start();
    let written = match serve(kernels, &sender, &mut watchdog, &meter, memory) {
        Ok(report) => {
            let stack_bytes = stack.worst_bytes() as u32;
            let report = Report {
                stack_bytes,
                ..report
            };
            write!(sender.text(), "{report}")
        }
        Err(Refusal(reason)) => writeln!(sender.text(), "error {reason}"),
    };
    if written.is_err() {
        fail();
    }
    loop {
        watchdog.feed();
    }
}

/// Serves the request. Not inlined, so that what is only there before frames are matched does not take stack then.
#[inline(never)]
fn serve(
    kernels: impl BoardKernels,
    sender: &Sender<'_>,
    watchdog: &mut Timer,
    meter: &Meter<Cycles>,
    memory: &'static mut [u32],
) -> Result<Report, Refusal> {
    let request = read_request().ok_or(Refusal("the image has no request"))?;
    if request.scan.is_some() {
        return Err(Refusal("this board makes no scan"));
    }
    if request.preset != PRESET || request.hamming_alone {
        return Err(Refusal("this board is built for another preset"));
    }
    let disparities = request.disparities.count.into();
    if !kernels.fit(request.width().into(), disparities) {
        return Err(Refusal("the stereo unit has no room for such rows"));
    }
    let memories = Memories::new(&request, memory)?;
    let kernels = Metered::new(Only::<_, Built>::new(kernels), meter);
    if request.is_live {
        let live = with_link(&request, kernels, watchdog, memories);
        return live.map(|never| match never {});
    }
    some_frames(&request, kernels, sender, watchdog, meter, memories)
}

/// Serves the host, whose commands are carried out, for ever.
#[inline(never)]
fn with_link<K: Kernels>(
    request: &Request,
    kernels: K,
    watchdog: &mut Timer,
    memories: Memories,
) -> Result<Infallible, Refusal> {
    let pending = Pending::default();
    tell_restarts(&pending);
    let mut camera = camera(request, &pending)?;
    let device = Device {
        name: env!("CARGO_PKG_NAME"),
        kernels,
        matcher,
        read_calibration,
        port: LinkPort::new(SerialPort::new()),
        watchdog,
        clock: now_us,
    };
    live::serve(request, device, &mut camera, memories, || pending.take())
}

/// Matches the frames of the request.
#[inline(never)]
fn some_frames<K: Kernels>(
    request: &Request,
    kernels: K,
    sender: &Sender<'_>,
    watchdog: &mut Timer,
    meter: &Meter<Cycles>,
    memories: Memories,
) -> Result<Report, Refusal> {
    tell_restarts(sender);
    let camera = Metered::new(camera(request, sender)?, meter);
    let matcher = matcher(request, kernels, memories.matcher)?;
    let mut rectifier =
        rectifier::rectifier(request, memories.calibration, kernels, read_calibration)?;
    let rectifier = rectifier.as_mut();
    let session = Session::rectifying(camera, rectifier, matcher, sender, memories.lines, watchdog);
    let mut session = session.map_err(|_| Refusal("the session refuses the camera"))?;
    let task = Task {
        frames: request.frames,
        faults: 0,
        height: request.geometry.height,
    };
    let Ok(()) = task.run(&mut session, meter, |_, _| {});
    Ok(Report {
        statistics: session.statistics(),
        instructions: meter.instructions(),
        working_bytes: request.working_bytes() as u32,
        stack_bytes: 0,
    })
}

/// Tells that the watchdog has restarted the board, if it has.
fn tell_restarts(log: &dyn Log) {
    let restarts = Timer::restarts();
    if restarts > 0 {
        log.tell(News::Restarted(restarts));
    }
}

/// The sensors at the ports.
fn camera<'l>(request: &Request, log: &'l dyn Log) -> Result<Dvp<'l>, Refusal> {
    let camera = Dvp::start(request.geometry, log);
    camera.ok_or(Refusal(
        "the camera's lines are not of this format or length",
    ))
}

/// Builds the matcher. Not inlined, so that its stack is free again while frames are matched.
#[inline(never)]
fn matcher<'m, K: Kernels>(
    request: &Request,
    kernels: K,
    memory: &'m mut [u32],
) -> Result<Matcher<'m, K>, Refusal> {
    let config = Config {
        colour: false,
        ..Config::new(PRESET.parameters(), request.width(), request.disparities)
    };
    let matcher = Matcher::new(&config, kernels, memory);
    matcher.map_err(|_| Refusal("the matcher refuses the configuration"))
}

/// Reads the request. Not inlined, so that its stack is free again while frames are matched.
#[inline(never)]
fn read_request() -> Option<Request> {
    let mut bytes = [0; 512];
    copy_from_image(&mut bytes, &REQUEST);
    let text = core::ffi::CStr::from_bytes_until_nul(&bytes).ok()?;
    text.to_str().ok()?.parse().ok()
}

/// Reads the rectification, which has as many bytes.
fn read_calibration(bytes: &mut [u8]) -> Result<(), Refusal> {
    let stored = CALIBRATION.get(..bytes.len());
    let stored = stored.ok_or(Refusal("the image has no room for such a rectification"))?;
    copy_from_image(bytes, stored);
    Ok(())
}

/// Copies what was written into the image after the program was made.
fn copy_from_image(bytes: &mut [u8], stored: &'static [u8]) {
    for (byte, place) in bytes.iter_mut().zip(stored) {
        // SAFETY: it is a reference. The compiler must not take the bytes for those that it has seen.
        *byte = unsafe { core::ptr::from_ref(place).read_volatile() };
    }
}

/// Shows that the board has failed. The watchdog restarts it.
fn fail() -> ! {
    LEDS.write(LEDS_FAILED);
    loop {
        riscv::asm::nop();
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    fail()
}

/// The handler of exceptions of the processor, such as an instruction that there is not: the board has failed.
#[unsafe(no_mangle)]
extern "C" fn ExceptionHandler(_: &riscv_rt::TrapFrame) -> ! {
    fail()
}
