//! Helpers of the tests: random pairs, measures of accuracy, faults, oracles for every stage, a driven
//! browser, and the bodies of the fuzz targets.

pub mod browser;
pub mod command;
pub mod faults;
pub mod fuzz;
pub mod oracle;
pub mod python;

use std::ops::Range;

use libtest_mimic::Failed;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::literal::GreyImage;
use vgstereo_core::{
    Config, DisparityLine, DisparityRange, Kernels, LineOffsets, Matcher, Method, Output,
    Parameters, Portable, Preset, SgmParameters,
};
use vgstereo_firmware::camera::{PixelFormat, RawLine};
use vgstereo_frame::{Matched, ViewLine, Views};
use vgstereo_sim::metrics::is_bad;
use vgstereo_sim::prepared::Prepared;
use vgstereo_sim::scene::Scene;

/// A pair of views of equal size.
#[derive(Debug, Clone)]
pub struct Pair {
    /// Number of columns, px.
    pub width: usize,
    /// Number of lines.
    pub height: usize,
    /// Pixel format of both views.
    pub format: PixelFormat,
    /// Left view, row by row.
    pub left: Vec<u8>,
    /// Right view, row by row.
    pub right: Vec<u8>,
    /// For each line of both views, the columns that the camera saw; no lines where it saw all.
    pub valid_columns: [Vec<Range<u16>>; 2],
}

impl Pair {
    /// Returns a grey pair of unrelated random pixels. With few `levels`, many distances tie.
    #[must_use]
    pub fn random(width: usize, height: usize, levels: u32, seed: u64) -> Self {
        Self::random_in(PixelFormat::Grey8, width, height, levels, seed)
    }

    /// Returns a pair of unrelated random pixels of any format; each byte is below `levels`.
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
            format,
            left: view(),
            right: view(),
            valid_columns: Default::default(),
        }
    }

    /// Gives each line of each view a gain of 1/2 to 3/2 or an offset of up to 40 levels, as mains light
    /// and noise of rows do; some levels are clipped.
    pub fn flicker(&mut self, seed: u64) {
        let mut random = Pcg32::seed_from_u64(seed);
        let row_bytes = self.width * self.format.bytes_per_pixel();
        let lines = self.left.chunks_exact_mut(row_bytes);
        for line in lines.chain(self.right.chunks_exact_mut(row_bytes)) {
            let (gain_q4, offset) = match random.next_u32() % 3 {
                0 => (16, (random.next_u32() % 81) as i32 - 40),
                _ => (8 + (random.next_u32() % 17) as i32, 0),
            };
            for level in line {
                *level = (i32::from(*level) * gain_q4 / 16 + offset).clamp(0, 255) as u8;
            }
        }
    }

    /// Lets each camera see a random run of columns of each line alone; of every eighth line, none.
    pub fn hide_columns(&mut self, seed: u64) {
        let mut random = Pcg32::seed_from_u64(seed);
        let width = self.width as u32;
        for view in &mut self.valid_columns {
            let lines = 0..self.height;
            *view = lines
                .map(|_| {
                    // Seldom more than half of the line is hidden.
                    let [start, end] = [0, 1].map(|_| random.next_u32() % (width / 4 + 2));
                    let end = width.saturating_sub(end).max(start.min(width));
                    if random.next_u32().is_multiple_of(8) {
                        0..0
                    } else {
                        start.min(width) as u16..end as u16
                    }
                })
                .collect();
        }
    }

    /// Whether the left (0) or the right camera (1) saw a pixel.
    #[must_use]
    pub fn sees(&self, view: usize, x: usize, y: usize) -> bool {
        let line = self.valid_columns[view].get(y);
        line.is_none_or(|columns| columns.contains(&(x as u16)))
    }

    /// Returns the left view, for the literal network.
    #[must_use]
    pub fn left_view(&self) -> GreyImage<'_> {
        GreyImage::new(&self.left, self.width, self.height).unwrap()
    }

    /// Returns the right view, for the literal network.
    #[must_use]
    pub fn right_view(&self) -> GreyImage<'_> {
        GreyImage::new(&self.right, self.width, self.height).unwrap()
    }

    /// Streams the pair through a matcher with exactly the memory that it states, and checks the
    /// line numbers and the latency. Returns the disparities of the region, 1/16 px.
    #[must_use]
    pub fn stream(&self, config: &Config, kernels: impl Kernels) -> Vec<i16> {
        self.stream_with_confidences(config, kernels).disparities_q4
    }

    /// Does what [`Pair::stream`] does, and also returns the confidences.
    #[must_use]
    pub fn stream_with_confidences(&self, config: &Config, kernels: impl Kernels) -> Map {
        let mut memory = vec![u32::MAX; config.memory_words()];
        let mut matcher = Matcher::new(config, kernels, &mut memory).unwrap();
        self.stream_through(&mut matcher)
    }

    /// Streams the pair through a matcher that is between two frames, and leaves it so. Checks the
    /// line numbers and the latency.
    #[must_use]
    pub fn stream_through<K: Kernels>(&self, matcher: &mut Matcher<'_, K>) -> Map {
        let config = *matcher.config();
        let latency = config.parameters.latency_lines();
        let region = config.region;
        let mut next = region.y;
        let mut map = Map::default();
        for (number, (left, right)) in (0..).zip(self.lines()) {
            if let Some(line) = matcher.push(&left, &right).unwrap() {
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

    /// Returns the pair as views, for the host simulator.
    ///
    /// # Panics
    /// If the pair is wider than 65535 px.
    #[must_use]
    pub fn views(&self) -> Views {
        Views {
            left: self.left.clone(),
            right: self.right.clone(),
            width: self.width.try_into().unwrap(),
            format: self.format,
            grey: None,
            valid_columns: self.valid_columns.clone(),
        }
    }

    /// Returns the pairs of lines from the top.
    pub fn lines(&self) -> impl Iterator<Item = (ViewLine<'_, Portable>, ViewLine<'_, Portable>)> {
        let bytes = self.width * self.format.bytes_per_pixel();
        let right = self.right.chunks_exact(bytes);
        let pairs = self.left.chunks_exact(bytes).zip(right).enumerate();
        pairs.map(move |(y, (left, right))| {
            let line = |view: usize, bytes| ViewLine {
                pixels: RawLine::new(self.format, bytes, Portable),
                grey: None,
                valid_columns: match self.valid_columns[view].get(y) {
                    Some(columns) => columns.start.into()..columns.end.into(),
                    None => 0..self.width,
                },
            };
            (line(0, left), line(1, right))
        })
    }
}

/// Offsets of lines for a frame to begin with: for half of the seeds none, for some of the others far more than lines
/// are moved by.
#[must_use]
pub fn line_offsets(seed: u64) -> LineOffsets {
    let mut random = Pcg32::seed_from_u64(seed);
    let mut within = |magnitude: i32| {
        let value = i64::from(random.next_u32()) - i64::from(i32::MIN).abs();
        ((value * i64::from(magnitude)) >> 31) as i32
    };
    match seed % 8 {
        0..4 => LineOffsets::NONE,
        4 => LineOffsets {
            shift_q24: within(1 << 29),
            tilt_q24: within(1 << 29),
            stretch_q24: within(i32::MAX),
        },
        _ => LineOffsets {
            shift_q24: within(2 << 24),
            tilt_q24: within(1 << 20),
            stretch_q24: within(1 << 20),
        },
    }
}

/// Makes the right view follow the left at a few disparities, so that some matches pass the checks
/// and others do not. Some lines are left unrelated.
pub fn follow(pair: &mut Pair, range: DisparityRange, seed: u64) {
    let mut random = Pcg32::seed_from_u64(seed);
    let bytes = pair.format.bytes_per_pixel();
    let row_bytes = pair.width * bytes;
    let lines = pair
        .left
        .chunks_exact(row_bytes)
        .zip(pair.right.chunks_exact_mut(row_bytes));
    for (left, right) in lines {
        if random.next_u32() % 8 == 0 {
            continue;
        }
        let mut shift = range.minimum_px;
        for x in 0..pair.width {
            if x == 0 || random.next_u32() % 16 == 0 {
                let index = random.next_u32() % u32::from(range.count);
                shift = range.minimum_px + index as i16;
            }
            let Some(from) = x.checked_add_signed(shift.into()) else {
                continue;
            };
            if from < pair.width && random.next_u32() % 32 > 0 {
                right[x * bytes..(x + 1) * bytes]
                    .copy_from_slice(&left[from * bytes..(from + 1) * bytes]);
            }
        }
    }
}

/// Returns parameters of the SGM method with a change to those of the method.
///
/// # Panics
/// Panics if they are of the paper's method.
#[must_use]
pub fn with_sgm(parameters: Parameters, change: impl FnOnce(&mut SgmParameters)) -> Parameters {
    let mut parameters = parameters;
    let Method::Sgm(sgm) = &mut parameters.method else {
        panic!("not the SGM method: {:?}", parameters.method);
    };
    change(sgm);
    parameters
}

/// The failure of a test by this error, with all its causes.
#[must_use]
pub fn failed(error: anyhow::Error) -> Failed {
    format!("{error:#}").into()
}

/// Right and wrong disparities that were found, percent of the pixels that are not occluded.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// Disparities up to a threshold from the truth.
    pub right: f64,
    /// Disparities further from the truth.
    pub wrong: f64,
}

impl Found {
    /// Counts what was found in a scene, not what was filled. Disparities further than `threshold_px` from the truth are
    /// wrong.
    ///
    /// # Panics
    /// Panics if the scene has no ground truth.
    #[must_use]
    pub fn new(matched: &Matched, scene: &Scene, threshold_px: f32) -> Self {
        let truth = scene.truth.as_ref().unwrap();
        let inside = truth.nonocc.as_ref().or(truth.all.as_ref()).unwrap();
        let (mut pixels, mut right, mut wrong) = (0_u32, 0_u32, 0_u32);
        let map = matched.disparities_q4.iter().zip(&matched.confidences);
        let map = map.zip(&truth.left_px).zip(inside.iter());
        for (((&found_q4, &confidence), &known_px), &is_inside) in map {
            if !is_inside || known_px.is_nan() {
                continue;
            }
            pixels += 1;
            if confidence > 0 {
                let is_wrong = is_bad(found_q4, known_px, threshold_px);
                *(if is_wrong { &mut wrong } else { &mut right }) += 1;
            }
        }
        let percent = |part: u32| 100.0 * f64::from(part) / f64::from(pixels);
        Self {
            right: percent(right),
            wrong: percent(wrong),
        }
    }
}

/// Matches a scene with a preset, and with the preset without its doubt of rivals.
///
/// # Panics
/// Panics if the scene cannot be matched.
#[must_use]
pub fn matched_with_and_without_doubt(prepared: &Prepared, preset: Preset) -> [Matched; 2] {
    let parameters = preset.parameters();
    let without = with_sgm(parameters, |sgm| sgm.rivals = None);
    let matched = |parameters| prepared.matched(parameters, Output::Dense, 2);
    [parameters, without].map(|parameters| matched(parameters).unwrap())
}

/// Returns the percentage of pixels whose disparity is more than 1 px from the scene's truth,
/// averaged over the scene's masks.
#[must_use]
pub fn bad_percent(parameters: Parameters, scene: &Scene) -> f64 {
    bad_percent_in(parameters, scene, false)
}

/// Returns what [`bad_percent`] does; the views are matched in grey if `grey` is set.
#[must_use]
pub fn bad_percent_in(parameters: Parameters, scene: &Scene, grey: bool) -> f64 {
    let scene = Prepared::new(scene.clone(), grey).unwrap();
    let matched = scene.matched(parameters, Output::Dense, 1).unwrap();
    let bad = scene.measure(&matched, 1.0, false).unwrap();
    bad.average().unwrap()
}

/// Returns the mean of [`bad_percent`] over seeds 1 to 6, because the synapses drawn decide from
/// which side a blank wall is filled.
#[must_use]
pub fn mean_bad_percent(parameters: Parameters, scene: &Scene) -> f64 {
    let bad = (1..=6).map(|seed| bad_percent(parameters.with_seed(seed), scene));
    bad.sum::<f64>() / 6.0
}

/// Output of a matcher for one frame, row by row.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Map {
    /// Disparities of the region, 1/16 px.
    pub disparities_q4: Vec<i16>,
    /// Confidences of the disparities.
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
