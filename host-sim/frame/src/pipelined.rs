//! SGM in two threads, line by line as in one.
//!
//! A row is matched after the one above it, for the path down and the exposure. But its
//! masks depend on the image alone, and its refinement comes after. So one thread matches,
//! and the other makes masks ahead of it and refines behind it.

use std::iter::Flatten;
use std::ops::Range;
use std::panic::resume_unwind;
use std::sync::mpsc::{IntoIter, Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use vgstereo_core::kernel::MASK_LANES;
use vgstereo_core::rows::{Arena, Strip, View};
use vgstereo_core::sgm::{
    BlockMasks, RowMasks, SgmMasks, SgmMatcher, SgmPlan, SgmRefiner, block_first,
};
use vgstereo_core::{Config, ConfigError, Reference, SgmParameters};
use vgstereo_kernels::NativeKernels;

use crate::map::{FrameError, Map, rows_of};
use crate::views::{ViewLine, Views};

/// Rows handed over at a time: waking a thread can take as long as a row.
const BATCH_ROWS: usize = 16;

/// Batches that may wait for the other thread.
const BATCHES_AHEAD: usize = 2;

/// Threads in use.
const THREADS: usize = 2;

/// Matches a frame; gives its map and the time from the first line in to the last out.
pub(crate) fn match_pipelined(
    config: &Config,
    sgm: &SgmParameters,
    views: &Views,
    kernels: NativeKernels,
) -> Result<(Map, Duration), FrameError> {
    let (mask_sender, mask_receiver) = sync_channel(BATCHES_AHEAD);
    let (found_sender, found_receiver) = sync_channel(BATCHES_AHEAD);
    let mask_words = SgmMasks::words(config, sgm);
    let channels_words = SgmPlan::new(config, sgm).refinement_view().words();

    let mut memory = vec![0; SgmMatcher::<NativeKernels>::words(config, sgm)];
    let arena = &mut Arena::new(&mut memory);
    let masks = (mask_words > 0).then(|| MasksAhead::new(mask_receiver));
    let mut matcher = SgmMatcher::with_masks(config, sgm, kernels, masks, arena)?;

    let mut memory = vec![0; mask_words + channels_words];
    let arena = &mut Arena::new(&mut memory);
    let synapses = matcher.synapses();
    let mut masks =
        SgmMasks::new(config, sgm, synapses, kernels, arena).map_err(ConfigError::from)?;
    let mut lines = ReferenceLines::new(config, sgm, views, kernels, arena)?;
    let width = usize::from(config.width);
    let mut rows = rows_of(config, views)?;
    let mut scratch = vec![0; SgmMasks::scratch_bytes(config, sgm)];
    // As many rows as were found: masks stay as far ahead as they were at first.
    let make_masks = move || {
        let Some(masks) = &mut masks else { return };
        let rows = rows.by_ref().take(BATCH_ROWS);
        let batch: Vec<_> = rows
            .map(|row| MaskRow::new(masks, lines.around(row), row, width, &mut scratch))
            .collect();
        // Not taken only after a panic of the other thread, which is passed on.
        let _ = mask_sender.send(batch);
    };

    let mut memory = vec![0; SgmRefiner::<NativeKernels>::words(config, sgm) + channels_words];
    let arena = &mut Arena::new(&mut memory);
    let mut refiner = SgmRefiner::new(config, sgm, kernels, arena)?;
    let mut behind = ReferenceLines::new(config, sgm, views, kernels, arena)?;

    let mut map = Map::with_room(config, views);
    let started = Instant::now();
    thread::scope(|scope| {
        // Dropped with the scope: a panic here ends the other thread's wait.
        let mut make_masks = make_masks;
        let rows = thread::Builder::new()
            .spawn_scoped(scope, move || {
                match_rows(&mut matcher, views, kernels, &found_sender);
                matcher.end_frame();
                matcher.line_offsets()
            })
            .map_err(|_| FrameError::Threads(THREADS))?;
        for _ in 0..BATCHES_AHEAD {
            make_masks();
        }
        for batch in found_receiver {
            for found in batch {
                let channels = behind.around(found.line);
                if refiner.push(&found.found, &found.confidences, found.valid, channels) {
                    map.push(refiner.line_q4(), refiner.line_confidences());
                }
            }
            make_masks();
        }
        map.line_offsets = rows.join().unwrap_or_else(|panic| resume_unwind(panic));
        Ok::<_, FrameError>(())
    })?;
    while refiner.flush(behind.view.channels()) {
        map.push(refiner.line_q4(), refiner.line_confidences());
    }
    Ok((map, started.elapsed()))
}

/// Matches all rows of a frame and hands them over.
fn match_rows(
    matcher: &mut SgmMatcher<'_, NativeKernels, MasksAhead>,
    views: &Views,
    kernels: NativeKernels,
    sender: &SyncSender<Vec<FoundRow>>,
) {
    let mut batch = Vec::new();
    let mut lines = views.lines(kernels);
    loop {
        let line = match lines.next() {
            Some((left, right)) => matcher.push(&left, &right),
            None => match matcher.flush() {
                Some(line) => Some(line),
                None => break,
            },
        };
        if let Some(line) = line {
            batch.push(FoundRow {
                line,
                found: matcher.found().to_vec(),
                confidences: matcher.confidences().to_vec(),
                valid: matcher.valid(),
            });
        }
        if batch.len() == BATCH_ROWS && sender.send(std::mem::take(&mut batch)).is_err() {
            // The other thread has panicked.
            return;
        }
    }
    let _ = sender.send(batch);
}

/// A row of checked disparities on its way to the refinement.
struct FoundRow {
    line: u32,
    found: Vec<i16>,
    confidences: Vec<u8>,
    valid: [Range<usize>; 2],
}

/// The masks of a row on their way to the matcher, block after block.
#[derive(Default)]
struct MaskRow {
    masks: Vec<u8>,
    counts: Vec<[u16; MASK_LANES]>,
}

impl MaskRow {
    fn new(
        masks: &mut impl RowMasks,
        channels: &[Strip<'_>],
        line: u32,
        width: usize,
        scratch: &mut [u8],
    ) -> Self {
        let mut row = Self::default();
        masks.begin(channels, line);
        for start in (0..width).step_by(MASK_LANES) {
            let block = masks.block(channels, block_first(start, width), scratch);
            row.masks.extend_from_slice(block.masks);
            row.counts.push(block.counts);
        }
        row
    }
}

/// The masks that the other thread made.
struct MasksAhead {
    rows: Flatten<IntoIter<Vec<MaskRow>>>,
    row: MaskRow,
    line: Option<u32>,
}

impl MasksAhead {
    fn new(receiver: Receiver<Vec<MaskRow>>) -> Self {
        Self {
            rows: receiver.into_iter().flatten(),
            row: MaskRow::default(),
            line: None,
        }
    }
}

impl RowMasks for MasksAhead {
    fn begin(&mut self, _: &[Strip<'_>], line: u32) {
        // The first row is begun twice: see `RowMasks::begin`.
        if self.line != Some(line) {
            self.row = self.rows.next().unwrap_or_default();
            self.line = Some(line);
        }
    }

    fn block(&mut self, _: &[Strip<'_>], first: usize, _: &mut [u8]) -> BlockMasks<'_> {
        // The last block may begin within the one before.
        let index = first.div_ceil(MASK_LANES);
        let bytes = self.row.masks.len() / self.row.counts.len().max(1);
        BlockMasks {
            masks: &self.row.masks[index * bytes..(index + 1) * bytes],
            counts: self.row.counts[index],
        }
    }
}

/// The reference view's lines, as far down as a row looks.
struct ReferenceLines<'a> {
    view: View<'a>,
    lines: Box<dyn Iterator<Item = ViewLine<'a, NativeKernels>> + 'a>,
    kernels: NativeKernels,
    taken: u32,
    reach: u32,
}

impl<'a> ReferenceLines<'a> {
    fn new(
        config: &Config,
        sgm: &SgmParameters,
        views: &'a Views,
        kernels: NativeKernels,
        arena: &mut Arena<'a>,
    ) -> Result<Self, ConfigError> {
        let reference = config.reference;
        let lines = views
            .lines(kernels)
            .map(move |(left, right)| match reference {
                Reference::Left => left,
                Reference::Right => right,
            });
        Ok(Self {
            view: View::new(
                SgmPlan::new(config, sgm).refinement_view(),
                SgmPlan::orders(reference)[0],
                arena,
            )?,
            lines: Box::new(lines),
            kernels,
            taken: 0,
            reach: config.parameters.support.y_px.into(),
        })
    }

    /// Takes the lines up to the lowest that `row` looks at; gives the strips.
    fn around(&mut self, row: u32) -> &[Strip<'a>] {
        while self.taken <= row + self.reach
            && let Some(line) = self.lines.next()
        {
            self.view.push(&line, &self.kernels);
            self.taken += 1;
        }
        self.view.channels()
    }
}
