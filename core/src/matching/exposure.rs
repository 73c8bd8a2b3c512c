//! Exposure: what the other camera's levels are in the reference camera's.
//!
//! Two cameras expose differently. The matches of the lines above tell by which gain and
//! offset, channel by channel, and how far matched levels still differ. Levels of the
//! next line of the other view are converted with them, and differ only outside a dead
//! zone of what is usual. Until that is known, no level differs.

use super::cost::MAX_CHANNELS;

/// Matches that must be known before anything is concluded from them.
const MATCHES_MIN: u32 = 64;
/// With every line 1/16 of the sums fades: the gain needs many levels.
const FADING_SHIFT: u32 = 4;
/// And 1/4 of those of recent lines: the offset needs but a mean, and makes up for a gain
/// that changes down the frame.
const RECENT_FADING_SHIFT: u32 = 2;
/// Gain of 1.
const GAIN_ONE: i32 = 1 << 12;

/// Sums over matches, those of older lines less and less.
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

/// Sums over the matches of one line: squares of 8 bits, at most 2^16 of them.
#[derive(Debug, Clone, Copy, Default)]
struct LineSums {
    reference: u32,
    other: u32,
    reference_squares: u32,
    other_squares: u32,
    residuals: u32,
}

/// The conversion of one channel's levels, and how far they may differ then.
#[derive(Debug, Clone, Copy)]
pub struct LevelConversion {
    /// Gain, 1/4096, at most 4.
    pub gain_q12: i32,
    /// Offset in levels, 1/4096, at most 2^21.
    pub offset_q12: i32,
    /// Difference that is usual.
    pub dead_zone: u8,
}

impl LevelConversion {
    const UNKNOWN: Self = Self {
        gain_q12: GAIN_ONE,
        offset_q12: 0,
        dead_zone: u8::MAX,
    };

    /// Whether levels may differ at all.
    pub(super) fn is_known(&self) -> bool {
        self.dead_zone < u8::MAX
    }

    /// The level in the reference camera's exposure.
    #[inline(always)]
    #[must_use]
    pub fn apply(&self, level: u8) -> u8 {
        let converted = (self.gain_q12 * i32::from(level) + self.offset_q12 + (1 << 11)) >> 12;
        converted.clamp(0, 255) as u8
    }
}

/// Converts levels of the other view: less and more the dead zone. Inlined so that a caller
/// may compile it for its own instruction set.
#[inline(always)]
pub fn convert_row(conversion: &LevelConversion, levels: &[u8], low: &mut [u8], high: &mut [u8]) {
    let zone = conversion.dead_zone;
    for ((&level, low), high) in levels.iter().zip(low).zip(high) {
        let converted = conversion.apply(level);
        // A level at the end of its range may have been beyond it. All ones or none, so that
        // the loop becomes vector code.
        let is_above = u8::from(level > 0).wrapping_neg();
        let is_highest = u8::from(level == u8::MAX).wrapping_neg();
        *low = converted.saturating_sub(zone) & is_above;
        *high = converted.saturating_add(zone) | is_highest;
    }
}

/// The running estimate.
#[derive(Debug)]
pub(super) struct Exposure {
    sums: [Sums; MAX_CHANNELS],
    matches: u32,
    recent_matches: u32,
    is_converting: bool,
    conversions: [LevelConversion; MAX_CHANNELS],
}

impl Exposure {
    pub(super) const fn new() -> Self {
        Self {
            sums: [Sums::NONE; MAX_CHANNELS],
            matches: 0,
            recent_matches: 0,
            is_converting: false,
            conversions: [LevelConversion::UNKNOWN; MAX_CHANNELS],
        }
    }

    /// What is known of a channel.
    pub(super) fn conversion(&self, channel: usize) -> LevelConversion {
        let known = self.conversions.get(channel);
        known.copied().unwrap_or(LevelConversion::UNKNOWN)
    }

    /// Learns from the matches of a line: positions in the reference view's and the other
    /// view's rows, which have `CHANNELS`. A match with a level at the end of the range
    /// tells nothing.
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

    /// Concludes from the sums: the first time the conversion alone, as residuals without
    /// one mean nothing. Divisions are per line.
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
        // 1.25 times the mean: about what separates the usual from the unusual.
        self.set_dead_zone(((mean_q4 * 20) >> 8).min(255) as u8);
    }

    fn set_dead_zone(&mut self, dead_zone: u8) {
        for conversion in &mut self.conversions {
            conversion.dead_zone = dead_zone;
        }
    }
}
