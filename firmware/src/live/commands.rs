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

/// A calibration on its way from the host to a store.
#[derive(Debug, Default)]
pub(super) struct Upload {
    total_bytes: u32,
    crc32: u32,
    /// Place of the next piece.
    next_bytes: u32,
}

impl Upload {
    pub(super) fn piece(
        &mut self,
        piece: &CalibrationPiece<'_>,
        store: &mut impl CalibrationStore,
    ) -> Outcome {
        if store.capacity_bytes() == 0 {
            return Outcome::Unsupported;
        }
        if piece.offset_bytes == 0 {
            *self = Self::default();
            if let Err(error) = store.begin(piece.total_bytes as usize) {
                return outcome(error);
            }
            (self.total_bytes, self.crc32) = (piece.total_bytes, piece.crc32);
        }
        let end = u32::try_from(piece.bytes.len())
            .ok()
            .and_then(|length| piece.offset_bytes.checked_add(length));
        let follows = (self.total_bytes, self.crc32, self.next_bytes)
            == (piece.total_bytes, piece.crc32, piece.offset_bytes);
        let Some(end) = end.filter(|&end| follows && end <= self.total_bytes) else {
            return Outcome::Calibration;
        };
        match store.write(piece.offset_bytes as usize, piece.bytes) {
            Ok(()) => {
                self.next_bytes = end;
                Outcome::Done
            }
            Err(error) => outcome(error),
        }
    }

    pub(super) fn commit(
        &mut self,
        total_bytes: u32,
        crc32: u32,
        fit: &Fit,
        store: &mut impl CalibrationStore,
    ) -> Outcome {
        if store.capacity_bytes() == 0 {
            return Outcome::Unsupported;
        }
        let has_come = (total_bytes, crc32) == (self.total_bytes, self.crc32)
            && self.next_bytes == total_bytes
            && store.staged().len() as u64 == u64::from(total_bytes);
        *self = Self::default();
        let is_fit = Rectification::from_bytes(store.staged()).is_ok_and(|rectification| {
            rectification.crc32() == crc32 && fit.check(&rectification).is_ok()
        });
        if !has_come || !is_fit {
            return Outcome::Calibration;
        }
        match store.commit() {
            Ok(()) => Outcome::Done,
            Err(error) => outcome(error),
        }
    }

    pub(super) fn discard(&mut self) {
        *self = Self::default();
    }
}

fn outcome(error: StoreError) -> Outcome {
    match error {
        StoreError::Unsupported => Outcome::Unsupported,
        StoreError::Size => Outcome::OutOfBounds,
        StoreError::Write => Outcome::Storage,
    }
}
