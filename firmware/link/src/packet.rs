//! What surrounds every message: version, kind, sequence number, time, checksum.

use crc::{CRC_32_ISO_HDLC, Crc};

/// Version of the protocol. A packet of another version is counted and left out.
pub const VERSION: u8 = 1;

/// The byte that ends a packet, and is nowhere in it.
pub const DELIMITER: u8 = 0;

/// CRC-32 as of zlib and Ethernet. One table of 1 KiB: a byte takes one look-up.
static CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Bytes of the checksum, which ends a packet before it is framed.
pub(crate) const CHECKSUM_BYTES: usize = 4;

/// Largest number of bytes of version, kind, sequence number and time.
pub(crate) const HEAD_BYTES_MAX: usize = 1 + 1 + 5 + 10;

/// The checksum of a packet.
pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    CHECKSUM.checksum(bytes)
}

/// How many of the memory's bytes framing may take: one code, one more for each 254 bytes, and the
/// delimiter.
pub(crate) const fn framing_bytes(memory_bytes: usize) -> usize {
    memory_bytes / 254 + 2
}

/// Memory that a packet takes whose message has a body of `body_bytes`.
#[must_use]
pub const fn packet_bytes(body_bytes: usize) -> usize {
    let plain = HEAD_BYTES_MAX + body_bytes + CHECKSUM_BYTES;
    plain + plain / 253 + 3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_a_packet_has_room_for_its_framing() {
        for body in 0..20_000 {
            let memory = packet_bytes(body);
            let plain = HEAD_BYTES_MAX + body + CHECKSUM_BYTES;
            assert!(memory - framing_bytes(memory) >= plain, "{body}");
            assert!(memory <= plain + plain / 100 + 4, "{body}");
        }
    }

    #[test]
    fn the_checksum_is_that_of_the_standard() {
        // The catalogue's check value.
        assert_eq!(checksum(b"123456789"), 0xcbf4_3926);
    }
}
