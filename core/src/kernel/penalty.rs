//! P2, the penalty of a larger step of disparity, which is smaller at edges of the image.

/// How P2 follows from the difference of two levels.
#[derive(Debug, Clone, Copy)]
pub struct Penalty {
    /// P2 where the levels do not differ, and its largest value.
    pub most: u8,
    /// Smallest P2.
    pub floor: u8,
    /// Decrease of P2 per level of difference, 1/16.
    pub adaptation_q4: u8,
    /// Largest difference that does not lower P2, levels.
    pub step_min: u8,
}

/// Writes P2 between each level of `own` and that of `neighbours` at the same index: the largest
/// P2, reduced in proportion to the difference of the two levels beyond `step_min`, but at least the
/// floor. Of rows of different lengths, the common one is written.
#[inline(always)]
pub fn penalty_row(penalty: &Penalty, own: &[u8], neighbours: &[u8], p2: &mut [u8]) {
    let (most, floor) = (i16::from(penalty.most), i16::from(penalty.floor));
    let adaptation_q4 = u16::from(penalty.adaptation_q4);
    for ((p2, &own), &neighbour) in p2.iter_mut().zip(own).zip(neighbours) {
        // At most 255 * 255 / 16.
        let step = own.abs_diff(neighbour).saturating_sub(penalty.step_min);
        let fall = (adaptation_q4 * u16::from(step)) >> 4;
        *p2 = (most - fall as i16).max(floor) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn p2_falls_with_the_step_down_to_its_floor() {
        let penalty = |step_min| Penalty {
            most: 100,
            floor: 15,
            adaptation_q4: 24,
            step_min,
        };
        let mut p2 = [0; 4];
        let rows = [&[50, 50, 50, 50], &[50, 40, 57, 255]];
        penalty_row(&penalty(0), rows[0], rows[1], &mut p2);
        assert_eq!(p2, [100, 85, 90, 15]);
        penalty_row(&penalty(8), rows[0], rows[1], &mut p2);
        assert_eq!(p2, [100, 97, 100, 15]);
    }
}
