//! The paper's method in many threads, each of which matches a band of rows.

use std::ops::Range;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use vgstereo_core::recall::{RecallMatcher, RecallRefiner};
use vgstereo_core::rows::Arena;
use vgstereo_core::{Config, RecallParameters, Region};
use vgstereo_kernels::NativeKernels;

use crate::map::{FrameError, Map, rows_of};
use crate::views::Views;

/// Largest number of threads that match a frame; more are not started.
pub const MAX_THREADS: usize = 256;

/// Matches a frame by the paper's method, its rows in bands; gives its map and the time from the
/// first line in to the last line out.
pub(crate) fn match_in_bands(
    config: &Config,
    recall: &RecallParameters,
    views: &Views,
    kernels: NativeKernels,
    threads: usize,
) -> Result<(Map, Duration), FrameError> {
    let mut memory = vec![0; RecallRefiner::words(config, recall)];
    let mut refiner = RecallRefiner::new(config, recall, &mut Arena::new(&mut memory))?;
    let mut map = Map::with_room(config, views);
    let started = Instant::now();
    // Bands overlap: grey is made once.
    let views = views.to_grey();
    let config = &Config {
        colour: false,
        ..*config
    };
    for row in match_bands(config, recall, &views, kernels, threads)?
        .iter()
        .flatten()
    {
        if refiner.push(&row.candidates_px, row.valid.clone()) {
            map.push(refiner.line_q4(), refiner.line_confidences());
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
    recall: &RecallParameters,
    views: &Views,
    kernels: NativeKernels,
    threads: usize,
) -> Result<Vec<Vec<Row>>, FrameError> {
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
    recall: &RecallParameters,
    views: &Views,
    kernels: NativeKernels,
    band: Range<u32>,
) -> Result<Vec<Row>, FrameError> {
    let config = Config {
        region: Region {
            y: band.start,
            height: band.end - band.start,
            ..config.region
        },
        ..*config
    };
    let mut memory = vec![0; RecallMatcher::<NativeKernels>::words(&config, recall)];
    let mut rows = RecallMatcher::new(&config, recall, kernels, &mut Arena::new(&mut memory))?;
    let mut band_rows = Vec::with_capacity(band.len());
    let reach = usize::from(config.parameters.support.y_px);
    for (left, right) in views.lines(kernels).take(band.end as usize + reach) {
        if rows.push(&left, &right).is_some() {
            band_rows.push(Row::of(&rows));
        }
    }
    while rows.flush().is_some() {
        band_rows.push(Row::of(&rows));
    }
    Ok(band_rows)
}

/// A row of candidates on its way to the refinement.
struct Row {
    candidates_px: Vec<i16>,
    valid: [Range<usize>; 2],
}

impl Row {
    fn of(rows: &RecallMatcher<'_, NativeKernels>) -> Self {
        Self {
            candidates_px: rows.candidates_px().to_vec(),
            valid: rows.valid(),
        }
    }
}
