//! Synapses: the offsets at which a neuron samples its view, drawn from a 2-D normal distribution.
//!
//! Paper, Section III: each neuron has |W| synapses whose offsets from the neuron's own pixel are
//! drawn once, independently in x and y, with standard deviation sigma, and rounded to pixels. Here
//! the reach is bounded too: an offset outside the [`Support`] is drawn again, so that a strip of
//! known height holds every sample. So may the distance between the two samples of a cell be.

use rand_core::Rng;

use crate::config::{MAX_SIGMA_PX, Parameters, Support, SynapseError};
use crate::rows::Offset;

/// An offset as it is stored: `[dx, dy]`, px, to the right and down.
pub type StoredOffset = [i8; 2];

/// The distribution of offsets: normal along and across the line, rounded to px, within a support and a
/// distance from each to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetLaw {
    /// Standard deviation along and across the line, px, above 0 and at most 10.
    pub sigma_px: f32,
    /// Reach of the offsets.
    pub support: Support,
    /// Largest distance of an offset from the one before it, px; 0 for any.
    pub cell_length_max_px: u8,
}

impl OffsetLaw {
    /// Normal offsets within a support, whatever their distances.
    #[must_use]
    pub const fn normal(sigma_px: f32, support: Support) -> Self {
        Self {
            sigma_px,
            support,
            cell_length_max_px: 0,
        }
    }

    /// The distributions of the first half of the synapses of `parameters` and of the second.
    #[must_use]
    pub fn halves(parameters: &Parameters) -> [Self; 2] {
        parameters.sigmas_px.map(|sigma_px| Self {
            sigma_px,
            support: parameters.support,
            cell_length_max_px: parameters.cell_length_max_px,
        })
    }

    /// Whether an offset may come after another.
    fn allows(&self, [x, y]: StoredOffset, before: Option<StoredOffset>) -> bool {
        let length = i32::from(self.cell_length_max_px);
        let Some([before_x, before_y]) = before.filter(|_| length != 0) else {
            return true;
        };
        let dx = i32::from(x) - i32::from(before_x);
        let dy = i32::from(y) - i32::from(before_y);
        dx * dx + dy * dy <= length * length
    }
}

/// Offsets in lent storage, in the order in which cells are formed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Synapses<'m> {
    offsets: &'m [StoredOffset],
}

impl<'m> Synapses<'m> {
    /// Draws one offset for each element of `storage`, with the Box-Muller transform.
    ///
    /// The offsets depend on the law and the generator's stream alone:
    /// `libm` computes the transform with the same bits on every platform.
    ///
    /// # Errors
    /// [`SynapseError`]; `storage` is then unchanged and the generator unused.
    pub fn draw(
        storage: &'m mut [StoredOffset],
        law: OffsetLaw,
        generator: &mut impl Rng,
    ) -> Result<Self, SynapseError> {
        let OffsetLaw {
            sigma_px, support, ..
        } = law;
        if !(sigma_px > 0.0 && sigma_px <= MAX_SIGMA_PX) {
            return Err(SynapseError::Sigma);
        }
        if !support.is_valid() {
            return Err(SynapseError::Support);
        }
        let mut before = None;
        for offset in storage.iter_mut() {
            *offset = loop {
                let (x, y) = normal_pair(generator);
                let dx = libm::round(x * f64::from(sigma_px));
                let dy = libm::round(y * f64::from(sigma_px));
                if libm::fabs(dx) <= f64::from(support.x_px)
                    && libm::fabs(dy) <= f64::from(support.y_px)
                {
                    // The support bounds both to the range of `i8`.
                    let drawn = [dx as i8, dy as i8];
                    if law.allows(drawn, before) {
                        break drawn;
                    }
                }
            };
            before = Some(*offset);
        }
        Ok(Self { offsets: storage })
    }

    /// Uses offsets that were chosen elsewhere.
    #[must_use]
    pub const fn from_stored(offsets: &'m [StoredOffset]) -> Self {
        Self { offsets }
    }

    /// |W|, the number of synapses.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.offsets.len()
    }

    /// Whether there is no synapse.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }

    /// The offsets in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Offset> + Clone + use<'m> {
        self.offsets.iter().map(|&[dx, dy]| Offset { dx, dy })
    }

    /// The group number `index` of `count` synapses; empty beyond the last whole group.
    #[must_use]
    pub fn group(&self, index: usize, count: usize) -> Synapses<'m> {
        let group = index
            .checked_mul(count)
            .and_then(|start| self.offsets.get(start..)?.get(..count));
        Self::from_stored(group.unwrap_or_default())
    }
}

/// Two independent standard Normal deviates (Box and Muller, 1958).
fn normal_pair(generator: &mut impl Rng) -> (f64, f64) {
    const TWO_PI: f64 = 2.0 * core::f64::consts::PI;
    const STEP: f64 = 1.0 / 4_294_967_296.0;
    // In (0, 1], where the logarithm is finite.
    let u = (f64::from(generator.next_u32()) + 1.0) * STEP;
    let v = f64::from(generator.next_u32()) * STEP;
    let radius = libm::sqrt(-2.0 * libm::log(u));
    let angle = TWO_PI * v;
    // Below two pi as it is; the compiler then leaves out what larger angles take.
    let angle = f64::from_bits(angle.to_bits().min(TWO_PI.to_bits()));
    let (sin, cos) = libm::sincos(angle);
    (radius * cos, radius * sin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::MAX_SYNAPSES;
    use rand_core::SeedableRng;
    use rand_pcg::Pcg32;

    #[test]
    fn three_sigma_rounds_up() {
        assert_eq!(Support::three_sigma(4.0), Support::square(12));
        assert_eq!(Support::three_sigma(1.5), Support::square(5));
        assert_eq!(Support::three_sigma(0.1), Support::square(1));
        assert_eq!(Support::three_sigma(10.0), Support::square(30));
    }

    #[test]
    fn sample_moments_are_those_of_the_distribution() {
        // 1024 draws: the standard error of the mean is sigma / 32 and of the
        // variance about sigma^2 / 22; truncation at 3 sigma takes 2.7 % of the variance.
        let mut storage = [[0; 2]; MAX_SYNAPSES];
        for seed in 0..8 {
            let mut generator = Pcg32::seed_from_u64(seed);
            let drawn = Synapses::draw(
                &mut storage,
                OffsetLaw::normal(4.0, Support::three_sigma(4.0)),
                &mut generator,
            )
            .unwrap();
            for pick in [|o: Offset| o.dx, |o: Offset| o.dy] {
                let n = drawn.len() as f64;
                let mean = drawn.iter().map(|o| f64::from(pick(o))).sum::<f64>() / n;
                let square = drawn
                    .iter()
                    .map(|o| f64::from(pick(o)) * f64::from(pick(o)))
                    .sum::<f64>()
                    / n;
                assert!(mean.abs() < 0.5, "seed {seed}: mean {mean}");
                assert!((square - 15.6).abs() < 2.9, "seed {seed}: {square}");
            }
        }
    }

    #[test]
    fn no_offset_leaves_the_support() {
        let mut storage = [[0; 2]; 256];
        let support = Support { x_px: 3, y_px: 1 };
        let mut generator = Pcg32::seed_from_u64(1);
        let drawn = Synapses::draw(
            &mut storage,
            OffsetLaw::normal(10.0, support),
            &mut generator,
        )
        .unwrap();
        assert!(drawn.iter().all(|o| o.dx.abs() <= 3 && o.dy.abs() <= 1));
        assert!(drawn.iter().any(|o| o.dx == -3) && drawn.iter().any(|o| o.dy == 1));
    }

    #[test]
    fn no_cell_is_longer_than_allowed() {
        let mut storage = [[0; 2]; 256];
        let free = OffsetLaw::normal(3.0, Support::square(9));
        for (seed, cell_length_max_px) in [(1, 1), (2, 4), (3, 13)] {
            let law = OffsetLaw {
                cell_length_max_px,
                ..free
            };
            let mut generator = Pcg32::seed_from_u64(seed);
            let drawn = Synapses::draw(&mut storage, law, &mut generator).unwrap();
            let lengths = drawn.iter().zip(drawn.iter().skip(1)).map(|(a, b)| {
                let (dx, dy) = (i32::from(a.dx - b.dx), i32::from(a.dy - b.dy));
                dx * dx + dy * dy
            });
            let longest = lengths.max().unwrap();
            let most = i32::from(cell_length_max_px).pow(2);
            assert!(longest <= most, "{cell_length_max_px}: {longest}");
            // Nearly as long as that, as nothing else holds them together.
            assert!(2 * longest > most, "{cell_length_max_px}: {longest}");
        }
    }

    #[test]
    fn bad_parameters_are_refused() {
        let mut storage = [[7; 2]; 16];
        let mut generator = Pcg32::seed_from_u64(1);
        for sigma in [0.0, -1.0, 10.5, f32::NAN] {
            let refused = Synapses::draw(
                &mut storage,
                OffsetLaw::normal(sigma, Support::square(5)),
                &mut generator,
            );
            assert_eq!(refused, Err(SynapseError::Sigma));
        }
        let refused = Synapses::draw(
            &mut storage,
            OffsetLaw::normal(4.0, Support::square(128)),
            &mut generator,
        );
        assert_eq!(refused, Err(SynapseError::Support));
        assert_eq!(storage, [[7; 2]; 16]);
        assert_eq!(generator, Pcg32::seed_from_u64(1));
    }
}
