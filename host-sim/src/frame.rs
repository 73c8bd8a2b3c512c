//! Whole frames on the host, through the core's line-streaming matcher.

use std::ops::Range;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use vgstereo_core::config::{Config, ConfigError, Method, Recall, Region};
use vgstereo_core::matcher::{MAX_LINES, Matcher, PushError};
use vgstereo_core::matching::RowMatcher;
use vgstereo_core::memory::Arena;
use vgstereo_core::refine::Refiner;

use crate::kernels::HostKernels;
use crate::views::Views;

mod pipelined;

/// Largest number of threads that match a frame; more are not started.
pub const MAX_THREADS: usize = 256;

/// What matching a frame gave and took.
#[derive(Debug, Clone)]
pub struct Matched {
    /// Disparities of the region, 1/16 px, row-major.
    pub disparities_q4: Vec<i16>,
    /// Confidence of each: 0 where it was filled in or is not known.
    pub confidences: Vec<u8>,
    /// Time from the first line in to the last line out, set-up of the memory excluded.
    pub time: Duration,
    /// Bytes of working memory that a matcher takes.
    pub working_bytes: usize,
    /// Lines from a pair going in to its disparities coming out.
    pub latency_lines: u32,
}

/// Why a frame was not matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameError {
    /// The configuration is not valid.
    Config(ConfigError),
    /// The pair does not fit the configuration.
    Push(PushError),
    /// The system does not give this many threads.
    Threads(usize),
}

impl std::fmt::Display for FrameError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Config(error) => error.fmt(f),
            Self::Push(error) => error.fmt(f),
            Self::Threads(threads) => write!(f, "cannot start {threads} threads"),
        }
    }
}

impl std::error::Error for FrameError {}

impl From<ConfigError> for FrameError {
    fn from(error: ConfigError) -> Self {
        Self::Config(error)
    }
}

impl From<PushError> for FrameError {
    fn from(error: PushError) -> Self {
        Self::Push(error)
    }
}

/// Matches a frame with up to `threads` threads; the disparities do not depend on their
/// number. The paper's method takes at most [`MAX_THREADS`] and one per row; what aggregates
/// needs the rows above, and takes at most two.
///
/// # Errors
/// [`FrameError`] when the configuration is not valid or the views do not fit it.
pub fn match_frame(
    config: &Config,
    views: &Views,
    kernels: HostKernels,
    threads: usize,
) -> Result<Matched, FrameError> {
    config.validate()?;
    if (views.width, views.format) != (config.width, config.format) {
        return Err(PushError::Width.into());
    }
    let (map, time) = match &config.parameters.method {
        Method::Recall(recall) if threads > 1 => {
            match_parallel(config, recall, views, kernels, threads)?
        }
        Method::Aggregation(aggregation) if threads > 1 => {
            pipelined::match_pipelined(config, aggregation, views, kernels)?
        }
        _ => match_alone(config, views, kernels)?,
    };
    Ok(Matched {
        time,
        disparities_q4: map.disparities_q4,
        confidences: map.confidences,
        working_bytes: config.memory_words() * size_of::<u32>(),
        latency_lines: config.parameters.latency_lines(),
    })
}

/// Lines of disparities, one after another.
#[derive(Debug)]
struct Map {
    disparities_q4: Vec<i16>,
    confidences: Vec<u8>,
}

impl Map {
    /// With room for the lines of a frame: they are not moved to make some.
    fn with_room(config: &Config, views: &Views) -> Self {
        let region = config.region;
        let lines = views.lines().count().min(region.height as usize);
        let pixels = lines * usize::from(region.width);
        Self {
            disparities_q4: Vec::with_capacity(pixels),
            confidences: Vec::with_capacity(pixels),
        }
    }

    fn push(&mut self, line_q4: &[i16], confidences: &[u8]) {
        self.disparities_q4.extend_from_slice(line_q4);
        self.confidences.extend_from_slice(confidences);
    }
}

/// The rows of a frame inside the region.
fn rows_of(config: &Config, views: &Views) -> Result<Range<u32>, PushError> {
    let lines = u32::try_from(views.lines().count()).unwrap_or(u32::MAX);
    if lines > MAX_LINES {
        return Err(PushError::TooManyLines);
    }
    let region = config.region;
    let end = region.y.saturating_add(region.height).min(lines);
    Ok(region.y.min(end)..end)
}

/// Matches a frame; gives its map and the time from the first line in to the last out.
fn match_alone(
    config: &Config,
    views: &Views,
    kernels: HostKernels,
) -> Result<(Map, Duration), FrameError> {
    let mut memory = vec![0; config.memory_words()];
    let mut matcher = Matcher::new(config, kernels, &mut memory)?;
    let mut map = Map::with_room(config, views);
    let started = Instant::now();
    for (left, right) in views.lines() {
        if let Some(line) = matcher.push(left, right)? {
            map.push(line.disparities_q4, line.confidences);
        }
    }
    while let Some(line) = matcher.finish() {
        map.push(line.disparities_q4, line.confidences);
    }
    Ok((map, started.elapsed()))
}

/// The same for the paper's method, its rows in bands.
fn match_parallel(
    config: &Config,
    recall: &Recall,
    views: &Views,
    kernels: HostKernels,
    threads: usize,
) -> Result<(Map, Duration), FrameError> {
    let mut memory = vec![0; Refiner::memory_words(config, recall)];
    let mut refiner = Refiner::new(config, recall, &mut Arena::new(&mut memory))?;
    let mut map = Map::with_room(config, views);
    let started = Instant::now();
    let views = views.to_grey();
    for band in match_bands(config, recall, &views, kernels, threads)? {
        for row in band.chunks_exact(candidates_length(config, recall)) {
            if refiner.push(row) {
                map.push(refiner.line_q4(), refiner.line_confidences());
            }
        }
    }
    while refiner.flush() {
        map.push(refiner.line_q4(), refiner.line_confidences());
    }
    Ok((map, started.elapsed()))
}

/// Rows of candidates do not depend on each other: each thread computes a band of them.
/// The refinement after them goes over all rows in turn.
fn match_bands(
    config: &Config,
    recall: &Recall,
    views: &Views,
    kernels: HostKernels,
    threads: usize,
) -> Result<Vec<Vec<i16>>, FrameError> {
    let Range { start, end } = rows_of(config, views)?;
    // More bands than rows would be empty, and `start..end` may be.
    let most = usize::try_from(end - start).unwrap_or(usize::MAX).max(1);
    let threads = threads.clamp(1, most.min(MAX_THREADS));
    let height = (end - start).div_ceil(threads as u32).max(1);
    let bands: Vec<Range<u32>> = (start..end)
        .step_by(height as usize)
        .map(|y| y..(y + height).min(end))
        .collect();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|_| FrameError::Threads(threads))?;
    pool.install(|| {
        bands
            .into_par_iter()
            .map(|band| match_band(config, recall, views, kernels, band))
            .collect()
    })
}

fn match_band(
    config: &Config,
    recall: &Recall,
    views: &Views,
    kernels: HostKernels,
    band: Range<u32>,
) -> Result<Vec<i16>, FrameError> {
    let config = Config {
        region: Region {
            y: band.start,
            height: band.end - band.start,
            ..config.region
        },
        ..*config
    };
    let mut memory = vec![0; RowMatcher::memory_words(&config, recall)];
    let mut rows = RowMatcher::new(&config, recall, kernels, &mut Arena::new(&mut memory))?;
    let mut candidates = Vec::with_capacity(band.len() * candidates_length(&config, recall));
    let reach = usize::from(config.parameters.support.y_px);
    for (left, right) in views.lines().take(band.end as usize + reach) {
        if rows.push(left, right).is_some() {
            candidates.extend_from_slice(rows.candidates_px());
        }
    }
    while rows.flush().is_some() {
        candidates.extend_from_slice(rows.candidates_px());
    }
    Ok(candidates)
}

fn candidates_length(config: &Config, recall: &Recall) -> usize {
    usize::from(recall.candidates) * usize::from(config.region.width)
}
