//! A packet with COBS as it is serialised: postcard's own flavour can panic where memory ends.

use postcard::ser_flavors::Flavor;
use postcard::{Error, Result};

/// Bytes between two codes, at most; a code of one more says that no zero follows.
const LONGEST_RUN: usize = 254;

/// Serialised bytes, encoded: each run without zeros follows a code, its length and 1.
#[derive(Debug)]
pub(super) struct CobsPacket<'b> {
    bytes: &'b mut [u8],
    /// Place of the code of the run under way.
    code_at: usize,
    /// Length of that run.
    run: usize,
}

impl<'b> CobsPacket<'b> {
    /// Takes the memory for one packet.
    pub(super) fn new(bytes: &'b mut [u8]) -> Self {
        Self {
            bytes,
            code_at: 0,
            run: 0,
        }
    }

    /// Returns the place after the run.
    fn end(&self) -> usize {
        self.code_at + 1 + self.run
    }

    fn set(&mut self, at: usize, byte: u8) -> Result<()> {
        let place = self.bytes.get_mut(at).ok_or(Error::SerializeBufferFull)?;
        *place = byte;
        Ok(())
    }

    fn end_run(&mut self) -> Result<()> {
        self.set(self.code_at, (self.run + 1) as u8)?;
        self.code_at = self.end();
        self.run = 0;
        Ok(())
    }
}

impl<'b> Flavor for CobsPacket<'b> {
    type Output = &'b [u8];

    fn try_push(&mut self, byte: u8) -> Result<()> {
        if byte == 0 {
            return self.end_run();
        }
        self.set(self.end(), byte)?;
        self.run += 1;
        if self.run == LONGEST_RUN {
            return self.end_run();
        }
        Ok(())
    }

    fn finalize(mut self) -> Result<Self::Output> {
        self.end_run()?;
        self.set(self.code_at, 0)?;
        let bytes: &'b [u8] = self.bytes;
        bytes.get(..=self.code_at).ok_or(Error::SerializeBufferFull)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec;
    use std::vec::Vec;

    fn encoded<'b>(bytes: &[u8], memory: &'b mut [u8]) -> Result<&'b [u8]> {
        let mut packet = CobsPacket::new(memory);
        packet.try_extend(bytes)?;
        packet.finalize()
    }

    #[test]
    fn packets_are_those_of_postcard_and_short_memory_is_refused() {
        let mut generator = Pcg32::seed_from_u64(7);
        for length in (0..1100).chain([5000]) {
            for rarity in [1, 2, 100, u32::MAX] {
                let mut byte = || match generator.next_u32() {
                    zero if zero % rarity == 0 => 0,
                    random => (random >> 8) as u8 | 1,
                };
                let bytes: Vec<u8> = (0..length).map(|_| byte()).collect();
                let mut memory = vec![0; length + length / 200 + 10];
                let expected = {
                    let flavour = postcard::ser_flavors::Slice::new(&mut memory);
                    let mut cobs = postcard::ser_flavors::Cobs::try_new(flavour).unwrap();
                    cobs.try_extend(&bytes).unwrap();
                    cobs.finalize().unwrap().to_vec()
                };
                let mut memory = vec![0xff; expected.len()];
                assert_eq!(encoded(&bytes, &mut memory), Ok(&*expected));
                let short = expected.len() - 1;
                assert!(encoded(&bytes, &mut memory[..short]).is_err());
            }
        }
        assert!(encoded(&[], &mut []).is_err());
    }
}
