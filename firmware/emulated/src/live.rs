//! A live board: it matches what its camera sends for ever, and serves the link over its port.

use core::convert::Infallible;
use core::fmt::{self, Display};

use vgstereo_core::geometry::Rectifier;
use vgstereo_core::rows::Arena;
use vgstereo_core::{Kernels, Matcher};
use vgstereo_firmware::Watchdog;
use vgstereo_firmware::camera::{LinePairSource, OrTestPattern};
use vgstereo_firmware::live::{LinkPort, Live, Next, RamStore, Setup};
use vgstereo_link::{Selection, Streams};

use crate::memories::Memories;
use crate::rectifier::rectifier_of;
use crate::request::{CameraRequest, Refusal, Request};

/// Streams that a board sends from its start, until the host selects others.
const SELECTION: Selection = Selection::whole(Streams::DISPARITIES.with(Streams::CONFIDENCES));

/// A live board without its camera and its memory: its kernels, its port to the host, its watchdog, and its clock.
pub struct Device<K, P, W> {
    /// The name that the host is told.
    pub name: &'static str,
    /// The kernels of the processor.
    pub kernels: K,
    /// Builds the matcher of a request in lent memory.
    pub matcher: BuildMatcher<K>,
    /// Reads the rectification of the request, which has as many bytes.
    pub read_calibration: fn(&mut [u8]) -> Result<(), Refusal>,
    /// The port to the host.
    pub port: P,
    /// The watchdog, which runs.
    pub watchdog: W,
    /// The time, µs, from any origin.
    pub clock: fn() -> u64,
}

/// A function that builds the matcher of a request in lent memory.
pub type BuildMatcher<K> =
    for<'m> fn(&Request, K, &'m mut [u32]) -> Result<Matcher<'m, K>, Refusal>;

impl<K, P, W> fmt::Debug for Device<K, P, W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Device")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

/// A board's live session.
type BoardSession<'m, 's, C, K, P, W> =
    Live<'m, OrTestPattern<&'m mut C>, K, &'m mut P, &'m mut W, &'m mut RamStore<'s>>;

/// Serves the request for ever: it returns only a reason not to. With a calibration from the host, the session begins
/// anew. `news` is asked after each pair of lines for what the host's log is to have. Not inlined: neither this nor the
/// run of other requests takes the other's stack.
///
/// # Errors
/// Fails when memory, camera, matcher and calibration do not suit each other.
#[inline(never)]
pub fn serve<C, K, P, W, N>(
    request: &Request,
    mut device: Device<K, P, W>,
    camera: &mut C,
    memories: Memories,
    mut news: impl FnMut() -> Option<N>,
) -> Result<Infallible, Refusal>
where
    C: LinePairSource,
    K: Kernels,
    P: LinkPort,
    W: Watchdog,
    N: Display,
{
    let Memories {
        lines,
        link,
        matcher,
        calibration,
        ..
    } = memories;
    let mut calibration = Calibration::new(request, calibration, device.read_calibration)?;
    loop {
        let parts = Parts {
            camera: &mut *camera,
            matcher: (device.matcher)(request, device.kernels, matcher)?,
            lines: &mut *lines,
            memory: &mut *link,
        };
        serve_calibrated(request, &mut device, parts, &mut calibration, &mut news)?;
    }
}

/// Camera, matcher and memories, of which a session is built.
struct Parts<'m, C, K> {
    camera: &'m mut C,
    matcher: Matcher<'m, K>,
    lines: &'m mut [u32],
    memory: &'m mut [u32],
}

/// Serves until the host has stored a calibration.
fn serve_calibrated<C, K, P, W, N>(
    request: &Request,
    device: &mut Device<K, P, W>,
    parts: Parts<'_, C, K>,
    calibration: &mut Calibration,
    news: &mut impl FnMut() -> Option<N>,
) -> Result<(), Refusal>
where
    C: LinePairSource,
    K: Kernels,
    P: LinkPort,
    W: Watchdog,
    N: Display,
{
    let Calibration {
        bytes,
        length,
        staging,
        rectifier,
    } = calibration;
    let mut store = RamStore::new(staging, rectifier.len());
    let mut rectifier = match bytes.get(..*length) {
        Some(bytes @ [_, ..]) => Some(rectifier_of(
            bytes,
            parts.matcher.config().colour,
            rectifier,
            device.kernels,
        )?),
        _ => None,
    };
    let mut built = session(request, device, parts, rectifier.as_mut(), &mut store);
    // By reference: a session is large, and each place that it is moved to takes stack.
    let live = match &mut built {
        Ok(live) => live,
        Err(refusal) => return Err(*refusal),
    };
    // What becomes of each pair is told over the link.
    while live.step() != Next::Calibrated {
        if let Some(text) = news() {
            live.tell(&text);
        }
    }
    drop(built);
    let stored = store.take().map(<[u8]>::len);
    if let Some(stored) = stored {
        *length = stored;
        core::mem::swap(bytes, staging);
    }
    Ok(())
}

/// Memory of the calibration in use, of one on its way from the host, and of the rectifier.
struct Calibration {
    bytes: &'static mut [u8],
    /// Bytes of the calibration in use; 0 without one.
    length: usize,
    staging: &'static mut [u8],
    rectifier: &'static mut [u32],
}

impl Calibration {
    /// Shares the memory out, a third each if nothing else is asked for, and reads the calibration of the
    /// request, if it has one.
    fn new(
        request: &Request,
        memory: &'static mut [u32],
        read: fn(&mut [u8]) -> Result<(), Refusal>,
    ) -> Result<Self, Refusal> {
        let [_, rectifier_words] = request.calibration_words();
        let words = memory.len();
        let rectifier_words = rectifier_words.max(words / 3);
        let refusal = Refusal("the calibration does not fit the lent memory");
        let (rectifier, rest) = memory
            .split_at_mut_checked(rectifier_words)
            .ok_or(refusal)?;
        let mut arena = Arena::new(rest);
        let bytes_each = (words - rectifier_words) / 2 * size_of::<u32>();
        let mut take = || arena.take(bytes_each).map_err(|_| refusal);
        let (bytes, staging): (&mut [u8], _) = (take()?, take()?);
        let length = request
            .calibration
            .map_or(0, |stated| stated.bytes as usize);
        if length > 0 {
            read(bytes.get_mut(..length).ok_or(refusal)?)?;
        }
        Ok(Self {
            bytes,
            length,
            staging,
            rectifier,
        })
    }
}

/// Builds the session. Not inlined, so that its stack is free again while frames are matched.
#[inline(never)]
fn session<'m, 's, C: LinePairSource, K: Kernels, P: LinkPort, W: Watchdog>(
    request: &Request,
    device: &'m mut Device<K, P, W>,
    parts: Parts<'m, C, K>,
    rectifier: Option<&'m mut Rectifier<'m, 'm, K>>,
    store: &'m mut RamStore<'s>,
) -> Result<BoardSession<'m, 's, C, K, P, W>, Refusal> {
    let setup = Setup {
        port: &mut device.port,
        device: device.name,
        firmware: env!("CARGO_PKG_VERSION"),
        preset: request.preset.name(),
        camera: request.camera.as_ref().and_then(CameraRequest::camera),
        selection: SELECTION,
        is_started: true,
        clock: device.clock,
        // The port has its own patience.
        gap_us: 0,
        keeps_line_offsets: false,
        store,
        memory: parts.memory,
    };
    let Parts {
        camera,
        matcher,
        lines,
        ..
    } = parts;
    let watchdog = &mut device.watchdog;
    let live = Live::new(camera, rectifier, matcher, lines, watchdog, setup);
    live.map_err(|_| Refusal("the session refuses the camera"))
}
