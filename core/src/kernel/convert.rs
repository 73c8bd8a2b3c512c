//! Conversion of a row of levels to the other camera's exposure.

/// The conversion of one channel of the other view to the reference camera's exposure, and the
/// difference that matched levels usually have afterwards.
#[derive(Debug, Clone, Copy)]
pub struct LevelConversion {
    /// Gain, 1/4096: 1/4 to 4.
    pub gain_q12: i32,
    /// Offset, 1/4096 level, at most 2^21 in magnitude.
    pub offset_q12: i32,
    /// Largest difference that counts as none, levels; 255 if the exposure is not known.
    pub dead_zone: u8,
}

impl LevelConversion {
    /// The conversion before the exposure is known: no level counts as different.
    pub(crate) const UNKNOWN: Self = Self {
        gain_q12: 1 << 12,
        offset_q12: 0,
        dead_zone: u8::MAX,
    };

    /// Whether the exposure is known, so that levels can count as different.
    pub(crate) fn is_known(&self) -> bool {
        self.dead_zone < u8::MAX
    }

    /// Converts a level to the reference camera's exposure, rounded to nearest and clamped.
    #[inline(always)]
    #[must_use]
    pub fn apply(&self, level: u8) -> u8 {
        let converted = (self.gain_q12 * i32::from(level) + self.offset_q12 + (1 << 11)) >> 12;
        converted.clamp(0, 255) as u8
    }

    /// Converts a level, but for 0 and 255, which may have been clipped and stay.
    #[inline(always)]
    #[must_use]
    pub(crate) fn apply_inside(&self, level: u8) -> u8 {
        let (is_above, is_highest) = ends(level);
        self.apply(level) & is_above | is_highest
    }
}

/// Whether a level is above 0, and whether it is 255; all ones if so, else 0, so that loops over levels are
/// vectorised. A level at either end of the range may have been clipped.
#[inline(always)]
fn ends(level: u8) -> (u8, u8) {
    (
        u8::from(level > 0).wrapping_neg(),
        u8::from(level == u8::MAX).wrapping_neg(),
    )
}

/// Converts levels of the other view: writes the lowest and the highest level of the reference
/// view that count as equal, in `low` and `high`. The rows have one element per pixel; of
/// different lengths, the common one is written.
#[inline(always)]
pub fn convert_row(conversion: &LevelConversion, levels: &[u8], low: &mut [u8], high: &mut [u8]) {
    let zone = conversion.dead_zone;
    for ((&level, low), high) in levels.iter().zip(low).zip(high) {
        let converted = conversion.apply(level);
        let (is_above, is_highest) = ends(level);
        *low = converted.saturating_sub(zone) & is_above;
        *high = converted.saturating_add(zone) | is_highest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_converted_with_a_dead_zone_around_them() {
        let conversion = LevelConversion {
            gain_q12: 2 << 12,
            offset_q12: -(10 << 12),
            dead_zone: 3,
        };
        let (mut low, mut high) = ([1; 5], [1; 5]);
        convert_row(&conversion, &[0, 10, 100, 200, 255], &mut low, &mut high);
        // A level at either end of the range may have been clipped, so its interval is open there.
        assert_eq!(low, [0, 7, 187, 252, 252]);
        assert_eq!(high, [3, 13, 193, 255, 255]);
        // Half a level is rounded up.
        let half = LevelConversion {
            gain_q12: 1 << 11,
            offset_q12: 0,
            dead_zone: 0,
        };
        assert_eq!((half.apply(7), half.apply(8)), (4, 4));
        assert!(half.is_known() && !LevelConversion::UNKNOWN.is_known());
    }
}
