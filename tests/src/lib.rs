//! What the tests share: random pairs, and the slow, evident versions of every stage.

pub mod oracle;
pub mod surface;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::camera::PixelFormat;
use vgstereo_core::config::{Config, Output, Parameters};
use vgstereo_core::kernel::Kernels;
use vgstereo_core::matcher::{DisparityLine, Matcher};
use vgstereo_core::view::View;
use vgstereo_sim::prepared::Prepared;
use vgstereo_sim::scene::Scene;
use vgstereo_sim::views::Views;

/// A pair of views, grey unless said otherwise.
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
        Self::random_in(PixelFormat::Grey8, width, height, levels, seed)
    }

    /// The same with pixels of another format, whose every byte has `levels` levels.
    #[must_use]
    pub fn random_in(
        format: PixelFormat,
        width: usize,
        height: usize,
        levels: u32,
        seed: u64,
    ) -> Self {
        let mut random = Pcg32::seed_from_u64(seed);
        let mut view = || -> Vec<u8> {
            let bytes = 0..width * height * format.bytes_per_pixel();
            bytes.map(|_| (random.next_u32() % levels) as u8).collect()
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
        self.stream_with_confidences(config, kernels).disparities_q4
    }

    /// The same with the confidences.
    #[must_use]
    pub fn stream_with_confidences(&self, config: &Config, kernels: impl Kernels) -> Map {
        let mut memory = vec![u32::MAX; config.memory_words()];
        let mut matcher = Matcher::new(config, kernels, &mut memory).unwrap();
        self.stream_through(&mut matcher)
    }

    /// The same through a matcher that is between two frames, and is so again after.
    #[must_use]
    pub fn stream_through<K: Kernels>(&self, matcher: &mut Matcher<'_, K>) -> Map {
        let config = *matcher.config();
        let latency = config.parameters.latency_lines();
        let region = config.region;
        let mut next = region.y;
        let mut map = Map::default();
        for (number, (left, right)) in (0..).zip(self.lines(config.format)) {
            if let Some(line) = matcher.push(left, right).unwrap() {
                assert_eq!((line.line, line.column), (next, region.x));
                assert_eq!(line.line + latency, number, "latency");
                map.extend(&line, region.width);
                next += 1;
            }
        }
        while let Some(line) = matcher.finish() {
            assert_eq!((line.line, line.column), (next, region.x));
            map.extend(&line, region.width);
            next += 1;
        }
        map
    }

    /// Returns the pair for the host simulator, as views in this format.
    ///
    /// # Panics
    /// Panics when the pair is wider than 65535 px.
    #[must_use]
    pub fn views(&self, format: PixelFormat) -> Views {
        Views {
            left: self.left.clone(),
            right: self.right.clone(),
            width: self.width.try_into().unwrap(),
            format,
        }
    }

    /// The pairs of lines from the top, of views in this format.
    pub fn lines(&self, format: PixelFormat) -> impl Iterator<Item = (&[u8], &[u8])> {
        let bytes = self.width * format.bytes_per_pixel();
        let left = self.left.chunks_exact(bytes);
        left.zip(self.right.chunks_exact(bytes))
    }
}

/// Bad pixels of a scene with its truth, percent, the average over its masks: further than
/// 1 px from it.
#[must_use]
pub fn bad_percent(parameters: Parameters, scene: &Scene) -> f64 {
    bad_percent_beyond(1.0, parameters, scene, false)
}

/// The same further than a threshold; in grey when asked for.
#[must_use]
pub fn bad_percent_beyond(
    threshold_px: f32,
    parameters: Parameters,
    scene: &Scene,
    grey: bool,
) -> f64 {
    let scene = Prepared::new(scene.clone(), grey).unwrap();
    let matched = scene.matched(parameters, Output::Dense, 1).unwrap();
    let bad = scene.measure(&matched, threshold_px, false).unwrap();
    bad.average().unwrap()
}

/// The mean of that over seeds 1 to 6: from which side a blank wall is filled hangs on the
/// synapses drawn.
#[must_use]
pub fn mean_bad_percent(parameters: Parameters, scene: &Scene) -> f64 {
    let bad = (1..=6).map(|seed| bad_percent(parameters.with_seed(seed), scene));
    bad.sum::<f64>() / 6.0
}

/// What a matcher gave of a frame, row-major.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Map {
    /// Disparities of the region, 1/16 px.
    pub disparities_q4: Vec<i16>,
    /// Their confidences.
    pub confidences: Vec<u8>,
}

impl Map {
    /// Appends a line of a region of `width` columns.
    pub fn extend(&mut self, line: &DisparityLine<'_>, width: u16) {
        assert_eq!(line.disparities_q4.len(), usize::from(width));
        assert_eq!(line.confidences.len(), usize::from(width));
        self.disparities_q4.extend_from_slice(line.disparities_q4);
        self.confidences.extend_from_slice(line.confidences);
    }
}
