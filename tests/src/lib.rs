//! What the tests share: random pairs, and the slow, evident versions of every stage.

pub mod oracle;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::config::Config;
use vgstereo_core::kernel::Kernels;
use vgstereo_core::matcher::Matcher;
use vgstereo_core::view::View;

/// A pair of grey views.
#[derive(Debug, Clone)]
pub struct Pair {
    /// Columns, px.
    pub width: usize,
    /// Lines.
    pub height: usize,
    /// Left view, row-major.
    pub left: Vec<u8>,
    /// Right view, row-major.
    pub right: Vec<u8>,
}

impl Pair {
    /// A pair of unrelated pixels with `levels` grey levels: few levels make many ties.
    #[must_use]
    pub fn random(width: usize, height: usize, levels: u32, seed: u64) -> Self {
        let mut random = Pcg32::seed_from_u64(seed);
        let mut view = || -> Vec<u8> {
            let pixels = 0..width * height;
            pixels.map(|_| (random.next_u32() % levels) as u8).collect()
        };
        Self {
            width,
            height,
            left: view(),
            right: view(),
        }
    }

    /// The left view, for the literal network.
    #[must_use]
    pub fn left_view(&self) -> View<'_> {
        View::new(&self.left, self.width, self.height).unwrap()
    }

    /// The right view.
    #[must_use]
    pub fn right_view(&self) -> View<'_> {
        View::new(&self.right, self.width, self.height).unwrap()
    }

    /// Streams the pair through a matcher, in exactly the memory that it states; checks
    /// the numbers of the lines and the latency on the way. Gives 1/16 px of the region.
    #[must_use]
    pub fn stream(&self, config: &Config, kernels: impl Kernels) -> Vec<i16> {
        let mut memory = vec![u32::MAX; config.memory_words()];
        let mut matcher = Matcher::new(config, kernels, &mut memory).unwrap();
        let latency = config.parameters.latency_lines();
        let region = config.region;
        let mut next = region.y;
        let mut map = Vec::new();
        let lines = self
            .left
            .chunks_exact(self.width)
            .zip(self.right.chunks_exact(self.width));
        for (number, (left, right)) in (0..).zip(lines) {
            if let Some(line) = matcher.push(left, right).unwrap() {
                assert_eq!((line.line, line.column), (next, region.x));
                assert_eq!(line.disparities_q4.len(), usize::from(region.width));
                assert_eq!(line.line + latency, number, "latency");
                map.extend_from_slice(line.disparities_q4);
                next += 1;
            }
        }
        while let Some(line) = matcher.finish() {
            assert_eq!(line.line, next);
            map.extend_from_slice(line.disparities_q4);
            next += 1;
        }
        map
    }
}
