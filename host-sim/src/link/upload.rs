//! A calibration on its way to a board.

use anyhow::{Context, Result, ensure};
use vgstereo_core::geometry::Rectification;
use vgstereo_link::HostMessage;
use vgstereo_link::host::CalibrationPiece;

use super::attended::Attended;

/// The largest piece that is sent, bytes: an encoder has room for it.
const PIECE_BYTES_MAX: usize = 256;

/// Sends a rectification to a board, which checks and stores it. `progress` is told how many of its bytes
/// the board has taken.
///
/// # Errors
/// Fails with one line that names the board and the reason: it stores none, its camera gives lines of
/// another size, it refuses or cannot store it, or it is lost. It has the calibration that it had before then.
pub fn upload(
    board: &mut Attended<'_>,
    rectification: &Rectification<'_>,
    mut progress: impl FnMut(usize),
) -> Result<()> {
    let hello = board.board.hello.as_ref();
    let hello = hello.with_context(|| format!("{} takes no calibration", board.name()))?;
    let piece_bytes = usize::from(hello.piece_bytes_max).min(PIECE_BYTES_MAX);
    ensure!(
        piece_bytes > 0,
        "{}: the board stores no calibration",
        board.name()
    );
    let raw = hello.raw;
    let size = [
        u32::from(rectification.raw_width),
        rectification.raw_height.into(),
    ];
    ensure!(
        size == [raw.width_px.into(), raw.height_lines],
        "{}: the calibration is for views of {}x{} px, and the board's cameras give {}x{} px",
        board.name(),
        size[0],
        size[1],
        raw.width_px,
        raw.height_lines
    );
    let bytes = rectification.bytes();
    let what = format!("a calibration of {} bytes", bytes.len());
    let total_bytes = u32::try_from(bytes.len()).with_context(|| what.clone())?;
    let crc32 = rectification.crc32();
    let mut offset = 0;
    for piece in bytes.chunks(piece_bytes) {
        let piece = CalibrationPiece {
            total_bytes,
            crc32,
            offset_bytes: u32::try_from(offset)?,
            bytes: piece,
        };
        board.command(&what, &HostMessage::CalibrationPiece(piece))?;
        offset += piece.bytes.len();
        progress(offset);
    }
    board.command(
        &what,
        &HostMessage::CalibrationCommit { total_bytes, crc32 },
    )
}
