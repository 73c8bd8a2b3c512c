//! The receiving end: the host's commands, one after the other.

use vgstereo_core::geometry::Rectification;
use vgstereo_link::board::Outcome;
use vgstereo_link::host::CalibrationPiece;
use vgstereo_link::{Decoder, HostMessage, Packet};

use super::port::LinkPort;
use super::store::{CalibrationStore, StoreError};
use crate::calibration::Fit;

/// Bytes that are taken from the port at once.
const CHUNK_BYTES: usize = 64;

/// Makes commands of the port's bytes.
#[derive(Debug)]
pub(super) struct Receiver<'m> {
    decoder: Decoder<'m>,
    chunk: [u8; CHUNK_BYTES],
    /// The bytes of the chunk that are not decoded yet.
    rest: core::ops::Range<usize>,
    /// Packets that the decoder had refused when it was last looked at.
    refused: u32,
}

impl<'m> Receiver<'m> {
    pub(super) fn new(memory: &'m mut [u8]) -> Self {
        Self {
            decoder: Decoder::new(memory),
            chunk: [0; CHUNK_BYTES],
            rest: 0..0,
            refused: 0,
        }
    }

    /// Takes bytes from the port if none of before are left; returns whether there are any.
    pub(super) fn fill(&mut self, port: &mut impl LinkPort) -> bool {
        if self.rest.is_empty() {
            self.rest = 0..port.receive(&mut self.chunk).min(CHUNK_BYTES);
        }
        !self.rest.is_empty()
    }

    /// The next command, if the bytes that are left complete one. They are taken as far as that, or
    /// all.
    pub(super) fn next(&mut self) -> Option<Packet<HostMessage<'_>>> {
        let mut input = self.chunk.get(self.rest.clone()).unwrap_or_default();
        let end = self.rest.end;
        let received = self.decoder.next(&mut input);
        self.rest.start = end - input.len();
        received?.ok()
    }

    /// Number of packets that were refused since this was last asked.
    pub(super) fn newly_refused(&mut self) -> u32 {
        let counters = self.decoder.counters();
        let refused = [
            counters.broken,
            counters.too_long,
            counters.unknown,
            counters.stale,
        ];
        let refused = refused.into_iter().fold(0, u32::saturating_add);
        refused - core::mem::replace(&mut self.refused, refused)
    }
}

/// Calibrations on their way from the host to a store.
#[derive(Debug)]
pub(super) struct Upload<T> {
    pub(super) store: T,
    /// What the board asks of a calibration.
    fit: Fit,
    /// What has come of one.
    under_way: UnderWay,
    /// Whether one was stored.
    pub(super) is_stored: bool,
}

/// A calibration of which pieces have come.
#[derive(Debug, Default)]
struct UnderWay {
    total_bytes: u32,
    crc32: u32,
    /// Place of the next piece.
    next_bytes: u32,
}

impl<T: CalibrationStore> Upload<T> {
    pub(super) fn new(store: T, fit: Fit) -> Self {
        Self {
            store,
            fit,
            under_way: UnderWay::default(),
            is_stored: false,
        }
    }

    pub(super) fn piece(&mut self, piece: &CalibrationPiece<'_>) -> Outcome {
        if self.store.capacity_bytes() == 0 {
            return Outcome::Unsupported;
        }
        if piece.offset_bytes == 0 {
            self.discard();
            if let Err(error) = self.store.begin(piece.total_bytes as usize) {
                return outcome(error);
            }
            self.under_way.total_bytes = piece.total_bytes;
            self.under_way.crc32 = piece.crc32;
        }
        let end = u32::try_from(piece.bytes.len())
            .ok()
            .and_then(|length| piece.offset_bytes.checked_add(length));
        let before = &mut self.under_way;
        let follows = (before.total_bytes, before.crc32, before.next_bytes)
            == (piece.total_bytes, piece.crc32, piece.offset_bytes);
        let Some(end) = end.filter(|&end| follows && end <= before.total_bytes) else {
            return Outcome::Calibration;
        };
        match self.store.write(piece.offset_bytes as usize, piece.bytes) {
            Ok(()) => {
                before.next_bytes = end;
                Outcome::Done
            }
            Err(error) => outcome(error),
        }
    }

    pub(super) fn commit(&mut self, total_bytes: u32, crc32: u32) -> Outcome {
        if self.store.capacity_bytes() == 0 {
            return Outcome::Unsupported;
        }
        let came = core::mem::take(&mut self.under_way);
        let staged = self.store.staged();
        let has_come = (total_bytes, crc32) == (came.total_bytes, came.crc32)
            && came.next_bytes == total_bytes
            && staged.len() as u64 == u64::from(total_bytes);
        let is_fit = Rectification::from_bytes(staged).is_ok_and(|rectification| {
            rectification.crc32() == crc32 && self.fit.check(&rectification).is_ok()
        });
        if !has_come || !is_fit {
            return Outcome::Calibration;
        }
        match self.store.commit() {
            Ok(()) => {
                self.is_stored = true;
                Outcome::Done
            }
            Err(error) => outcome(error),
        }
    }

    pub(super) fn discard(&mut self) {
        self.under_way = UnderWay::default();
    }
}

fn outcome(error: StoreError) -> Outcome {
    match error {
        StoreError::Unsupported => Outcome::Unsupported,
        StoreError::Size => Outcome::OutOfBounds,
        StoreError::Write => Outcome::Storage,
    }
}
