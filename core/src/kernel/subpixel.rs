//! The sub-pixel step: where between disparities the least sum of path costs lies.
//!
//! The sums of the best disparity's neighbours rise above the least sum. A parabola through the
//! three is drawn to whole pixels, because each path adds P1 to both neighbours wherever it does
//! not change its disparity: both rise by a part that tells nothing of where the minimum lies.
//! [`SubpixelStep::relief`] takes up to that part off again. What is left of steep rises is better
//! followed by two lines of one slope than by a parabola, as matching costs grow in proportion to the
//! offset (Shimizu and Okutomi 2001); for the small rises of weak minima, such as those beside edges,
//! the parabola errs less: [`SubpixelStep::lines_min`].

/// How the sub-pixel step follows from the rises of the best disparity's two neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct SubpixelStep {
    /// Part of both rises that does not count, a sum of path costs; but no more than 5/16 of the
    /// larger rise. 0 takes the rises as they are.
    pub relief: u8,
    /// Smallest of the larger rises, as it is, from which the minimum is that of two lines of one
    /// slope rather than of a parabola. Rises are at most 765: with more, it is always that of a
    /// parabola.
    pub lines_min: u16,
}

impl SubpixelStep {
    /// The minimum of the parabola through the three sums.
    pub const PARABOLA: Self = Self {
        relief: 0,
        lines_min: u16::MAX,
    };

    /// The larger and the smaller rise without the part that does not count. The smaller is at
    /// least 0, and the larger is 0 only where both rises are.
    #[inline(always)]
    fn relieved(&self, before: i16, after: i16) -> (i16, i16) {
        let (larger, smaller) = (before.max(after), before.min(after));
        // At most 5 * 765.
        let relief = i16::from(self.relief).min((5 * larger) >> 4);
        (larger - relief, (smaller - relief).max(0))
    }

    /// The divisor of the step, a sum of path costs: the step is 1/2 px times the difference of the two
    /// relieved rises, divided by it. It is their sum for a parabola, the larger one for two lines.
    #[inline(always)]
    fn divisor(&self, before: i16, after: i16, (larger, smaller): (i16, i16)) -> i16 {
        // All ones for a parabola. Rises are not negative.
        let is_weak = -i16::from((before.max(after).cast_unsigned()) < self.lines_min);
        larger + (smaller & is_weak)
    }
}

/// The step from the best disparity to the minimum, 1/16 px, positive towards higher disparities:
/// `8 (l - s) / (l + s)` for a parabola, `8 (l - s) / l` for two lines, where `l` and `s` are the
/// larger and the smaller of the relieved rises; rounded to nearest, halves outwards, and away from
/// the larger rise. `before` and `after` are the rises of the lower and the higher neighbour, from 0
/// to 765.
#[inline(always)]
#[must_use]
pub fn subpixel_step_q4(step: &SubpixelStep, before: i16, after: i16) -> i16 {
    let [step_q4] = subpixel_steps_q4(step, &[before], &[after]);
    step_q4
}

/// [`subpixel_step_q4`] of `N` triples side by side, in loops that become vector code.
#[inline(always)]
#[must_use]
pub fn subpixel_steps_q4<const N: usize>(
    step: &SubpixelStep,
    before: &[i16; N],
    after: &[i16; N],
) -> [i16; N] {
    let mut steps = [0; N];
    let (mut divisors, mut differences) = ([0; N], [0; N]);
    for lane in 0..N {
        let relieved = step.relieved(before[lane], after[lane]);
        divisors[lane] = step.divisor(before[lane], after[lane], relieved);
        differences[lane] = relieved.0 - relieved.1;
    }
    // The quotient is at most 8: counting the half steps below it needs no division.
    for half in [1, 3, 5, 7, 9, 11, 13, 15] {
        for lane in 0..N {
            let (divisor, difference) = (divisors[lane], differences[lane]);
            // 8 * 2 * difference / divisor >= half; at most 15 times twice 765, three 8-bit paths.
            steps[lane] += i16::from((difference * 16 >= half * divisor) & (divisor > 0));
        }
    }
    for lane in 0..N {
        // All ones if the step is negative; a branch would often be mispredicted.
        let sign = -i16::from(before[lane] < after[lane]);
        steps[lane] = (steps[lane] ^ sign) - sign;
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pair of rises up to 200 and some beyond, in floating point.
    #[test]
    fn steps_are_the_rounded_quotients() {
        let step = |relief, lines_min| SubpixelStep { relief, lines_min };
        let rises = || (0..200_i16).chain([254, 255, 256, 510, 764, 765]);
        for step in [
            SubpixelStep::PARABOLA,
            step(50, 100),
            step(255, 0),
            step(1, 766),
            step(0, 1),
        ] {
            for (before, after) in
                rises().flat_map(|before| rises().map(move |after| (before, after)))
            {
                let (larger, smaller) =
                    (f64::from(before.max(after)), f64::from(before.min(after)));
                let relief = f64::from(step.relief).min((larger * 5.0 / 16.0).floor());
                let (l, s) = (larger - relief, (smaller - relief).max(0.0));
                let divisor = if larger < f64::from(step.lines_min) {
                    l + s
                } else {
                    l
                };
                let exact = if divisor > 0.0 {
                    // `f64::round` takes halves outwards.
                    (8.0 * (l - s) / divisor)
                        .round()
                        .copysign(f64::from(before - after))
                } else {
                    0.0
                };
                let found = subpixel_step_q4(&step, before, after);
                assert_eq!(f64::from(found), exact, "{step:?} {before} {after}");
            }
        }
    }

    /// Whatever the parameters, the step is that of the mirrored rises with the other sign, at most
    /// half a pixel, and 0 for equal rises.
    #[test]
    fn steps_are_symmetric_and_at_most_half_a_pixel() {
        for relief in [0, 7, 50, 255] {
            for lines_min in [0, 90, u16::MAX] {
                let step = SubpixelStep { relief, lines_min };
                for before in (0..=765).step_by(5) {
                    for after in (0..=765).step_by(3) {
                        let found = subpixel_step_q4(&step, before, after);
                        assert_eq!(found, -subpixel_step_q4(&step, after, before));
                        assert!(found.abs() <= 8 && (before != after || found == 0));
                    }
                }
            }
        }
    }
}
