//! The rectifier of a board's camera, from the bytes of a rectification.

use vgstereo_core::Kernels;
use vgstereo_core::geometry::{Rectification, Rectifier};
use vgstereo_core::rows::Arena;

use crate::request::{Refusal, Request};

/// Has the rectification read into `memory`, if the request has one, and builds the rectifier behind it. `read` gets as
/// many bytes as the rectification has. Not inlined, so that its stack is free again while frames are matched.
///
/// # Errors
/// Fails when it does not fit the memory, when `read` fails, and when what it has read is no rectification.
#[inline(never)]
pub fn rectifier<K: Kernels>(
    request: &Request,
    memory: &'static mut [u32],
    kernels: K,
    read: impl FnOnce(&mut [u8]) -> Result<(), Refusal>,
) -> Result<Option<Rectifier<'static, 'static, K>>, Refusal> {
    let Some(stated) = request.calibration else {
        return Ok(None);
    };
    let [words, _] = request.calibration_words();
    let (bytes, memory) = memory
        .split_at_mut_checked(words)
        .ok_or(Refusal("the rectification does not fit the lent memory"))?;
    let bytes: &'static mut [u8] = Arena::new(bytes)
        .take(stated.bytes as usize)
        .map_err(|_| Refusal("the rectification does not fit the lent memory"))?;
    read(bytes)?;
    rectifier_of(bytes, request.config().colour, memory, kernels).map(Some)
}

/// Builds the rectifier of these bytes. Not inlined, so that its stack is free again while frames are
/// matched.
///
/// # Errors
/// Fails when the bytes are no rectification, and when the rectifier does not fit the memory.
#[inline(never)]
pub fn rectifier_of<'m, K: Kernels>(
    bytes: &'m [u8],
    colour: bool,
    memory: &'m mut [u32],
    kernels: K,
) -> Result<Rectifier<'m, 'm, K>, Refusal> {
    let rectification =
        Rectification::from_bytes(bytes).map_err(|_| Refusal("the rectification is not valid"))?;
    let rectifier = Rectifier::new(rectification, colour, kernels, memory);
    rectifier.map_err(|_| Refusal("the rectifier does not fit the lent memory"))
}
