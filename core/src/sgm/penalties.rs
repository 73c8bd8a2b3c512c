//! P2, the penalty of a larger step of disparity, which is smaller at edges of the image.

use crate::config::SgmParameters;

/// Writes P2 between each level of `own` and that of `neighbours` at the same index: the largest
/// P2, reduced in proportion to the difference of the two levels beyond `step_min`, but at least the
/// floor.
pub(super) fn write_penalties(
    parameters: &SgmParameters,
    step_min: u8,
    own: &[u8],
    neighbours: &[u8],
    p2: &mut [u8],
) {
    let (most, floor) = (i16::from(parameters.p2), i16::from(parameters.p2_floor));
    let adaptation_q4 = u16::from(parameters.p2_adaptation_q4);
    for ((p2, &own), &neighbour) in p2.iter_mut().zip(own).zip(neighbours) {
        // At most 255 * 255 / 16.
        let step = own.abs_diff(neighbour).saturating_sub(step_min);
        let fall = (adaptation_q4 * u16::from(step)) >> 4;
        *p2 = (most - fall as i16).max(floor) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Method, Preset};

    #[test]
    fn p2_falls_with_the_step_down_to_its_floor() {
        let Method::Sgm(sgm) = Preset::Balanced.parameters().method else {
            panic!("not SGM");
        };
        let parameters = SgmParameters {
            p2: 100,
            p2_floor: 15,
            p2_adaptation_q4: 24,
            ..sgm
        };
        let mut p2 = [0; 4];
        let rows = [&[50, 50, 50, 50], &[50, 40, 57, 255]];
        write_penalties(&parameters, 0, rows[0], rows[1], &mut p2);
        assert_eq!(p2, [100, 85, 90, 15]);
        write_penalties(&parameters, 8, rows[0], rows[1], &mut p2);
        assert_eq!(p2, [100, 97, 100, 15]);
    }
}
