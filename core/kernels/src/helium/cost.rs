//! Matching costs of sixteen disparities at once.
//!
//! First the differing cells are counted, up to 64 disparities of a pixel in one pass over the bytes of
//! its pattern: a load from a table of 256 bytes at sixteen places counts the ones of sixteen bytes. The
//! counts stand where the costs will. Then one pass makes costs of them and of the levels.

use core::ops::Range;

use vgstereo_core::kernel::{CostRun, Kernels, NO_COST, Planes, Portable, cost_stride};

use super::{LANES, vector_asm};

/// Disparities of which the counts stay in registers at a time.
const MAX_BLOCKS: usize = 4;

/// Largest number of bytes of a pattern whose differing cells a byte can count.
const PART: usize = 31;

/// Number of ones in each byte.
static ONES: [u8; 256] = {
    let mut ones = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        ones[byte] = byte.count_ones() as u8;
        byte += 1;
    }
    ones
};

/// Equals [`vgstereo_core::kernel::cost_run`] bit for bit.
pub(super) fn cost_run(run: &CostRun<'_>, costs: &mut [u8]) {
    let stride = cost_stride(run.disparities);
    let pixels = run.cell_costs_q8.len().min(run.truncations.len());
    let pixels = pixels.min(costs.len() / stride.max(1));
    if !is_within(run, pixels, stride) {
        Portable.cost_run(run, costs);
        return;
    }
    let weights = Weights::new(run);
    let rows = costs.chunks_exact_mut(stride);
    for (x, (costs, (&cell_cost_q8, &truncation))) in rows
        .zip(run.cell_costs_q8.iter().zip(run.truncations))
        .enumerate()
    {
        let lowest = run.first_position - x;
        for (costs, start) in costs
            .chunks_mut(MAX_BLOCKS * LANES)
            .zip((0..).step_by(MAX_BLOCKS * LANES))
        {
            let first = lowest + start;
            count(run, 0..run.inputs.count, x, first, costs);
            if run.difference_weight_q4 == 0 {
                weigh(costs, cell_cost_q8, truncation);
            } else {
                let cell = (cell_cost_q8, truncation);
                weigh_with_levels(run, x, first, costs, cell, &weights);
            }
        }
        if run.disparities < stride
            && let Some(beyond) = costs.get_mut(run.disparities..)
        {
            beyond.fill(NO_COST);
        }
    }
}

/// Whether this code takes the run: all that it loads for `pixels` pixels of `stride` disparities stands in the
/// slices.
fn is_within(run: &CostRun<'_>, pixels: usize, stride: usize) -> bool {
    let (bytes, stored_end) = (run.inputs.count, run.first_position + stride);
    let has = |planes: &Planes<'_>, end: usize| {
        end <= planes.stride && planes.bytes.len() >= bytes * planes.stride
    };
    let input_end = run.start + pixels;
    let has_levels = run.difference_weight_q4 == 0
        || run.channels == 1
            && run.levels[0].len() >= input_end
            && run.other_low[0].len() >= stored_end
            && run.other_high[0].len() >= stored_end;
    pixels > 0
        && (1..=PART).contains(&bytes)
        && run.first_position + 1 >= pixels
        && has(&run.inputs, input_end)
        && run.stored.count == bytes
        && has(&run.stored, stored_end)
        && (run.masks.count == 0 || run.masks.count == bytes && has(&run.masks, pixels))
        && has_levels
}

/// Writes how many cells of the bytes `bytes` of pixel `x`'s pattern differ from those of the patterns from
/// `first` on, as many as `counts` has.
#[inline(always)]
fn count(run: &CostRun<'_>, bytes: Range<usize>, x: usize, first: usize, counts: &mut [u8]) {
    let (input, is_masked) = (run.start + x, run.masks.count > 0);
    let blocks = counts.len() / LANES;
    let ends_within = |planes: &Planes<'_>, position: usize| {
        bytes.end * planes.stride - planes.stride + position <= planes.bytes.len()
    };
    debug_assert!((1..=PART).contains(&bytes.len()));
    debug_assert!(counts.len().is_multiple_of(LANES) && (1..=MAX_BLOCKS).contains(&blocks));
    debug_assert!(ends_within(&run.inputs, input + 1));
    debug_assert!(ends_within(&run.stored, first + counts.len()));
    debug_assert!(!is_masked || ends_within(&run.masks, x + 1));
    let at = |planes: &Planes<'_>, position: usize| {
        let first = bytes.start * planes.stride + position;
        planes.bytes.as_ptr().wrapping_add(first)
    };
    macro_rules! add_ones {
        ($others:literal, $sum:literal, [$($mask:literal,)*]) => {
            concat!(
                "vldrb.u8 q6, [{stored}", $others, "]\n",
                "veor q6, q6, q4\n",
                $($mask, "\n",)*
                "vldrb.u8 q7, [{ones}, q6]\n",
                "vadd.i8 ", $sum, ", ", $sum, ", q7",
            )
        };
    }
    // For each block, the ones of the differing cells are added up in a register of its own.
    macro_rules! count_blocks {
        (masked: $(($others:literal, $sum:literal)),+) => {
            count_blocks!(@
                ["ldrb {byte}, [{mask}]", "add {mask}, {mask}, {mask_stride}", "vdup.8 q5, {byte}",],
                ["vand q6, q6, q5",],
                $(($others, $sum)),+;
                mask = inout(reg) at(&run.masks, x) => _,
                mask_stride = in(reg) run.masks.stride,
            )
        };
        (all: $(($others:literal, $sum:literal)),+) => {
            count_blocks!(@ [], [], $(($others, $sum)),+;)
        };
        (@ [$($load:literal,)*], $mask:tt, $(($others:literal, $sum:literal)),+; $($operands:tt)*) => {
            vector_asm!(
                $(concat!("vmov.i8 ", $sum, ", #0"),)+
                "dls lr, {bytes}",
                "2:",
                "ldrb {byte}, [{input}]",
                "add {input}, {input}, {input_stride}",
                "vdup.8 q4, {byte}",
                $($load,)*
                $(add_ones!($others, $sum, $mask),)+
                "add {stored}, {stored}, {stored_stride}",
                "le lr, 2b"
                $(, concat!("vstrb.8 ", $sum, ", [{counts}", $others, "]"))+;
                $($operands)*
                bytes = in(reg) bytes.len(),
                byte = out(reg) _,
                input = inout(reg) at(&run.inputs, input) => _,
                input_stride = in(reg) run.inputs.stride,
                stored = inout(reg) at(&run.stored, first) => _,
                stored_stride = in(reg) run.stored.stride,
                ones = in(reg) ONES.as_ptr(),
                counts = in(reg) counts.as_mut_ptr(),
            )
        };
    }
    // SAFETY: as asserted, each byte of the pixel's pattern and mask, and the vectors of the patterns from the first
    // on, are within their planes; the counts have as many vectors; and the table has 256 bytes.
    unsafe {
        match (is_masked, blocks) {
            (true, 1) => count_blocks!(masked: ("", "q0")),
            (true, 2) => count_blocks!(masked: ("", "q0"), (", #16", "q1")),
            (true, 3) => count_blocks!(masked: ("", "q0"), (", #16", "q1"), (", #32", "q2")),
            (true, _) => {
                count_blocks!(masked: ("", "q0"), (", #16", "q1"), (", #32", "q2"), (", #48", "q3"));
            }
            (false, 1) => count_blocks!(all: ("", "q0")),
            (false, 2) => count_blocks!(all: ("", "q0"), (", #16", "q1")),
            (false, 3) => count_blocks!(all: ("", "q0"), (", #16", "q1"), (", #32", "q2")),
            (false, _) => {
                count_blocks!(all: ("", "q0"), (", #16", "q1"), (", #32", "q2"), (", #48", "q3"));
            }
        }
    }
}

/// What the levels of a run weigh.
struct Weights {
    /// Vectors of the largest difference that counts, and of the part of the weight below one, 1/256.
    vectors: [[u8; LANES]; 2],
    /// The whole part of the weight.
    whole: u32,
}

impl Weights {
    fn new(run: &CostRun<'_>) -> Self {
        let weight_q4 = run.difference_weight_q4;
        Self {
            vectors: [run.difference_truncation, weight_q4 % 16 * 16].map(|byte| [byte; _]),
            whole: (weight_q4 / 16).into(),
        }
    }
}

/// Replaces counts of differing cells by their costs.
///
/// The high byte of a cost per cell times the count is a whole cost; of the low byte's the rounded high half is.
#[inline(always)]
fn weigh(costs: &mut [u8], cell_cost_q8: u16, truncation: u8) {
    debug_assert!(costs.len().is_multiple_of(LANES) && !costs.is_empty());
    // SAFETY: as asserted, there are whole vectors of costs.
    unsafe {
        vector_asm!(
            "vdup.8 q0, {cell_cost}",
            "lsr {cell_cost}, {cell_cost}, #8",
            "vdup.8 q1, {truncation}",
            "dls lr, {blocks}",
            "2:",
            "vldrb.u8 q5, [{costs}]",
            "vrmulh.u8 q6, q5, q0",
            "vmla.u8 q6, q5, {cell_cost}",
            "vmin.u8 q6, q6, q1",
            "vstrb.8 q6, [{costs}], #16",
            "le lr, 2b";
            blocks = in(reg) costs.len() / LANES,
            costs = inout(reg) costs.as_mut_ptr() => _,
            cell_cost = inout(reg) u32::from(cell_cost_q8) => _,
            truncation = in(reg) u32::from(truncation),
        );
    }
}

/// [`weigh`], and adds the weighted difference of the levels of pixel `x` from those of the other view from `first` on.
#[inline(always)]
fn weigh_with_levels(
    run: &CostRun<'_>,
    x: usize,
    first: usize,
    costs: &mut [u8],
    (cell_cost_q8, truncation): (u16, u8),
    weights: &Weights,
) {
    debug_assert!(costs.len().is_multiple_of(LANES) && !costs.is_empty());
    debug_assert!(run.other_low[0].len() >= first + costs.len());
    debug_assert!(run.other_high[0].len() >= first + costs.len());
    let level = run.levels[0].get(run.start + x).copied().unwrap_or(0);
    // SAFETY: as asserted, there are whole vectors of costs, and as many levels of the other view.
    unsafe {
        vector_asm!(
            "vldrb.u8 q3, [{weights}]",
            "vldrb.u8 q4, [{weights}, #16]",
            "vdup.8 q0, {cell_cost}",
            "lsr {cell_cost}, {cell_cost}, #8",
            "vdup.8 q1, {truncation}",
            "vdup.8 q2, {level}",
            "dls lr, {blocks}",
            "2:",
            "vldrb.u8 q5, [{costs}]",
            "vrmulh.u8 q6, q5, q0",
            "vmla.u8 q6, q5, {cell_cost}",
            "vmin.u8 q6, q6, q1",
            // How far the level is outside of what counts as equal: one of the two differences is 0.
            "vldrb.u8 q5, [{low}], #16",
            "vqsub.u8 q5, q5, q2",
            "vldrb.u8 q7, [{high}], #16",
            "vqsub.u8 q7, q2, q7",
            "vorr q5, q5, q7",
            "vmin.u8 q5, q5, q3",
            "vmulh.u8 q7, q5, q4",
            "vmla.u8 q7, q5, {whole}",
            "vqadd.u8 q6, q6, q7",
            "vstrb.8 q6, [{costs}], #16",
            "le lr, 2b";
            weights = in(reg) weights.vectors.as_ptr(),
            whole = in(reg) weights.whole,
            blocks = in(reg) costs.len() / LANES,
            costs = inout(reg) costs.as_mut_ptr() => _,
            low = inout(reg) run.other_low[0].as_ptr().wrapping_add(first) => _,
            high = inout(reg) run.other_high[0].as_ptr().wrapping_add(first) => _,
            level = in(reg) u32::from(level),
            cell_cost = inout(reg) u32::from(cell_cost_q8) => _,
            truncation = in(reg) u32::from(truncation),
        );
    }
}
