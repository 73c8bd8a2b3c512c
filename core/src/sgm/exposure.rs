//! Exposure: the gain and offset between the two cameras, learned from matches.
//!
//! Two cameras expose differently. From the matches of the lines above follow the gain and the
//! offset of each channel, and the difference that usually remains after conversion. The levels of
//! the next line of the other view are converted with gain and offset, and differences up to a
//! little more than the usual one count as none. Until the exposure is known, no level counts as
//! different.

use crate::kernel::{LevelConversion, MAX_CHANNELS};

/// Smallest number of matches from which an exposure is estimated.
const MATCHES_MIN: u32 = 64;
/// Fading of the sums: they lose 1/16 with every line, as the gain needs many levels.
const FADING_SHIFT: u32 = 4;
/// Fading of the sums over recent lines: they lose 1/4 with every line. The offset needs only a
/// mean, and corrects for a gain that changes down the frame.
const RECENT_FADING_SHIFT: u32 = 2;
/// Sums over the matches of one channel, in which older lines have less weight.
#[derive(Debug, Clone, Copy)]
struct Sums {
    reference: u32,
    other: u32,
    reference_squares: u64,
    other_squares: u64,
    residuals: u32,
    recent_reference: u32,
    recent_other: u32,
}

impl Sums {
    const NONE: Self = Self {
        reference: 0,
        other: 0,
        reference_squares: 0,
        other_squares: 0,
        residuals: 0,
        recent_reference: 0,
        recent_other: 0,
    };

    fn add(&mut self, line: &LineSums) {
        self.reference += line.reference;
        self.other += line.other;
        self.reference_squares += u64::from(line.reference_squares);
        self.other_squares += u64::from(line.other_squares);
        self.residuals += line.residuals;
        self.recent_reference += line.reference;
        self.recent_other += line.other;
    }
}

/// Sums over the matches of one line and channel. Squares of 8 bits, of which there are at most
/// 2^16, fit 32 bits.
#[derive(Debug, Clone, Copy, Default)]
struct LineSums {
    reference: u32,
    other: u32,
    reference_squares: u32,
    other_squares: u32,
    residuals: u32,
}

/// The running estimate of the exposure of the other camera relative to the reference camera.
#[derive(Debug)]
pub(super) struct Exposure {
    sums: [Sums; MAX_CHANNELS],
    matches: u32,
    recent_matches: u32,
    is_converting: bool,
    conversions: [LevelConversion; MAX_CHANNELS],
}

impl Exposure {
    /// An estimate before any match is known.
    pub(super) const fn new() -> Self {
        Self {
            sums: [Sums::NONE; MAX_CHANNELS],
            matches: 0,
            recent_matches: 0,
            is_converting: false,
            conversions: [LevelConversion::UNKNOWN; MAX_CHANNELS],
        }
    }

    /// The current conversion of a channel's levels.
    pub(super) fn conversion(&self, channel: usize) -> LevelConversion {
        let known = self.conversions.get(channel);
        known.copied().unwrap_or(LevelConversion::UNKNOWN)
    }

    /// The noise of the cameras, levels, 0 to 254: the largest usual difference between matched levels, less
    /// `usual_max`, at least 0. It is 0 while the exposure is not known.
    pub(super) fn noise(&self, usual_max: u8) -> u8 {
        let conversion = self.conversion(0);
        if conversion.is_known() {
            conversion.dead_zone.saturating_sub(usual_max)
        } else {
            0
        }
    }

    /// Learns from the matches of a line, each a position in the reference view's row and one in
    /// the other view's, in the stored order of each. `levels` and `others` are these rows, of
    /// `CHANNELS` channels. Matches with a level at either end of the range are not used.
    // Apart, so that all registers are its own.
    #[inline(never)]
    pub(super) fn learn<const CHANNELS: usize>(
        &mut self,
        matches: impl Iterator<Item = (usize, usize)>,
        levels: [&[u8]; MAX_CHANNELS],
        others: [&[u8]; MAX_CHANNELS],
    ) {
        let mut line = [LineSums::default(); CHANNELS];
        let mut count = 0;
        for (at, other_at) in matches {
            let mut pairs = [(0, 0); CHANNELS];
            let rows = levels.iter().zip(others);
            for ((own, other), (levels, others)) in pairs.iter_mut().zip(rows) {
                // 0, an end of the range, where there is no level.
                *own = levels.get(at).copied().unwrap_or(0);
                *other = others.get(other_at).copied().unwrap_or(0);
            }
            // One less, a level inside the range is at most 253.
            let is_end = |level: u8| level.wrapping_sub(1) > 253;
            if pairs.iter().any(|&(a, b)| is_end(a) | is_end(b)) {
                continue;
            }
            count += 1;
            for ((sums, conversion), &(own, other)) in
                line.iter_mut().zip(&self.conversions).zip(&pairs)
            {
                sums.residuals += u32::from(own.abs_diff(conversion.apply(other)));
                let (own, other) = (u32::from(own), u32::from(other));
                sums.reference += own;
                sums.other += other;
                sums.reference_squares += own * own;
                sums.other_squares += other * other;
            }
        }
        self.fade();
        self.matches += count;
        self.recent_matches += count;
        for (sums, line) in self.sums.iter_mut().zip(&line) {
            sums.add(line);
        }
        self.conclude(CHANNELS);
    }

    /// Lets the sums of the lines above fade.
    fn fade(&mut self) {
        for sums in &mut self.sums {
            sums.reference -= sums.reference >> FADING_SHIFT;
            sums.other -= sums.other >> FADING_SHIFT;
            sums.reference_squares -= sums.reference_squares >> FADING_SHIFT;
            sums.other_squares -= sums.other_squares >> FADING_SHIFT;
            sums.residuals -= sums.residuals >> FADING_SHIFT;
            sums.recent_reference -= sums.recent_reference >> RECENT_FADING_SHIFT;
            sums.recent_other -= sums.recent_other >> RECENT_FADING_SHIFT;
        }
        self.matches -= self.matches >> FADING_SHIFT;
        self.recent_matches -= self.recent_matches >> RECENT_FADING_SHIFT;
    }

    /// Updates the estimate from the sums. The first time, only gain and offset are set, because
    /// residuals of unconverted levels mean nothing. Divisions are per line.
    fn conclude(&mut self, channels: usize) {
        let count = self.matches;
        if self.recent_matches < MATCHES_MIN {
            self.set_dead_zone(u8::MAX);
            return;
        }
        let mut residuals = 0_u64;
        for (sums, conversion) in self.sums.iter().zip(&mut self.conversions).take(channels) {
            let n = u64::from(count);
            // n^2 times the deviation, a little more than 0 so that flat lines have gain 1.
            let deviation = |sum: u32, squares: u64| {
                let spread = (n * squares).saturating_sub(u64::from(sum) * u64::from(sum));
                (spread + 4 * n * n).isqrt()
            };
            let reference = deviation(sums.reference, sums.reference_squares);
            let other = deviation(sums.other, sums.other_squares);
            let gain = ((reference << 12) / other.max(1)).clamp(1 << 10, 1 << 14);
            // The gain is at most 4, levels 255: the offset is well within 32 bits.
            let offset = ((i64::from(sums.recent_reference) << 12)
                - gain as i64 * i64::from(sums.recent_other))
            .div_euclid(i64::from(self.recent_matches).max(1));
            conversion.gain_q12 = gain as i32;
            conversion.offset_q12 = offset as i32;
            residuals += u64::from(sums.residuals);
        }
        if !self.is_converting {
            self.is_converting = true;
            self.sums = [Sums::NONE; MAX_CHANNELS];
            self.matches = 0;
            self.recent_matches = 0;
            return;
        }
        let mean_q4 = residuals * 16 / (u64::from(count) * channels as u64).max(1);
        // 1.25 times the mean difference, which about separates usual differences from unusual
        // ones.
        self.set_dead_zone(((mean_q4 * 20) >> 8).min(255) as u8);
    }

    fn set_dead_zone(&mut self, dead_zone: u8) {
        for conversion in &mut self.conversions {
            conversion.dead_zone = dead_zone;
        }
    }
}
