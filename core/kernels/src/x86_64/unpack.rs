//! Channels of RGB lines in SSSE3: every third byte, 16 pixels at a time.

use core::arch::x86_64::*;

use vgstereo_core::kernel::{self, PixelFormat};

/// Number of pixels taken at a time, and of bytes per register.
const LANES: usize = 16;
const CHANNELS: usize = 3;

/// Extracts one channel of a line, as [`kernel::channel_row`] does. Calls it for other formats, and
/// for the last pixels if they do not fill a register.
#[target_feature(enable = "ssse3")]
pub(super) fn channel_row(format: PixelFormat, line: &[u8], channel: usize, row: &mut [u8]) {
    let (pixels, places) = match PICKS.get(channel) {
        Some(places) if format == PixelFormat::Rgb888 => {
            (line.as_chunks::<{ CHANNELS * LANES }>().0, places)
        }
        _ => (&[][..], &PICKS[0]),
    };
    let places = places.each_ref().map(|places| load(places));
    let mut count = 0;
    for (levels, pixels) in row.as_chunks_mut::<LANES>().0.iter_mut().zip(pixels) {
        let mut picked = _mm_setzero_si128();
        for (bytes, places) in pixels.as_chunks().0.iter().zip(places) {
            picked = _mm_or_si128(picked, _mm_shuffle_epi8(load(bytes), places));
        }
        // SAFETY: the array has the register's 16 bytes; the store needs no alignment.
        unsafe { _mm_storeu_si128(levels.as_mut_ptr().cast(), picked) };
        count += LANES;
    }
    let done = line.len().min(CHANNELS * count);
    kernel::channel_row(format, &line[done..], channel, &mut row[count..]);
}

/// Shuffle of each channel, for each of the three registers of 16 pixels: the byte that goes to
/// each level, or none if its top bit is set.
static PICKS: [[[u8; LANES]; CHANNELS]; CHANNELS] = {
    let mut picks = [[[0x80; LANES]; CHANNELS]; CHANNELS];
    let mut byte = 0;
    while byte < CHANNELS * LANES {
        picks[byte % CHANNELS][byte / LANES][byte / CHANNELS] = (byte % LANES) as u8;
        byte += 1;
    }
    picks
};

#[target_feature(enable = "ssse3")]
#[inline]
fn load(bytes: &[u8; LANES]) -> __m128i {
    // SAFETY: the array has the register's 16 bytes; the load needs no alignment.
    unsafe { _mm_loadu_si128(bytes.as_ptr().cast()) }
}
