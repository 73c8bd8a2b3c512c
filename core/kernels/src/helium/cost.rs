//! Matching costs of sixteen disparities at once.
//!
//! First the differing cells are counted, up to 64 disparities of a pixel in one pass over the bytes of
//! its pattern: a load from a table of 256 bytes at sixteen places counts the ones of sixteen bytes. The
//! counts stand where the costs will. Then one pass makes costs of them and of the levels.

use core::ops::Range;
use core::slice;

use vgstereo_core::kernel::{CostRun, Kernels, MAX_CHANNELS, Planes, Portable, cost_stride};

use super::{LANES, vector_asm};
use crate::armv7em::cost::fill_beyond;

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
    let costs = costs.get_mut(..pixels * stride).unwrap_or_default();
    let is_masked = run.masks.count > 0;
    // As many blocks of disparities as registers take at a time, and what remains.
    for start in (0..stride).step_by(MAX_BLOCKS * LANES) {
        let rows = Rows { run, stride, start };
        match ((stride - start) / LANES, is_masked) {
            (1, false) => rows.fill::<1, false>(costs),
            (1, true) => rows.fill::<1, true>(costs),
            (2, false) => rows.fill::<2, false>(costs),
            (2, true) => rows.fill::<2, true>(costs),
            (3, false) => rows.fill::<3, false>(costs),
            (3, true) => rows.fill::<3, true>(costs),
            (_, false) => rows.fill::<MAX_BLOCKS, false>(costs),
            (_, true) => rows.fill::<MAX_BLOCKS, true>(costs),
        }
    }
    fill_beyond(run, costs);
}

/// Some disparities, from `start` on, of all pixels of a run.
#[derive(Clone, Copy)]
struct Rows<'a> {
    run: &'a CostRun<'a>,
    stride: usize,
    start: usize,
}

impl Rows<'_> {
    /// Writes the costs of `BLOCKS` blocks of disparities.
    #[inline(never)]
    fn fill<const BLOCKS: usize, const MASKED: bool>(self, costs: &mut [u8]) {
        let run = self.run;
        let bytes = run.inputs.count;
        let pixels = costs.len() / self.stride.max(1);
        let Some(costs) = costs.get_mut(self.start..) else {
            return;
        };
        // A count beyond a byte is the largest byte, which suffices where that costs the most already.
        let suffices =
            |(&cost_q8, &most): (&u16, &u8)| (u32::from(cost_q8) * 255 + 128) >> 8 >= most.into();
        let cells = run.cell_costs_q8.iter().zip(run.truncations);
        if bytes <= PART || cells.clone().all(suffices) {
            self.count::<BLOCKS, MASKED>(0..bytes, 0..pixels, costs);
            self.weigh::<BLOCKS>(0..pixels, run.cell_costs_q8, run.truncations, costs);
            return;
        }
        for (x, (&cost_q8, &most)) in (0..pixels).zip(cells) {
            let Some(costs) = costs.get_mut(x * self.stride..) else {
                return;
            };
            let cost_q8 = if suffices((&cost_q8, &most)) {
                self.count::<BLOCKS, MASKED>(0..bytes, x..x + 1, costs);
                cost_q8
            } else {
                self.weigh_parts::<BLOCKS, MASKED>(x, (cost_q8, most), costs);
                // What stands there are costs: one each.
                1 << 8
            };
            self.weigh::<BLOCKS>(x..x + 1, &[cost_q8], &[most], costs);
        }
    }

    /// Replaces counts of differing cells by costs, for pixels of which `costs` begins with the first one's.
    #[inline(always)]
    fn weigh<const BLOCKS: usize>(
        &self,
        pixels: Range<usize>,
        cell_costs_q8: &[u16],
        truncations: &[u8],
        costs: &mut [u8],
    ) {
        let run = self.run;
        let first = run.first_position + self.start - pixels.start;
        if run.difference_weight_q4 > 0 && run.channels == 1 {
            let levels = run.levels[0].get(run.start + pixels.start..);
            let low = run.other_low[0].get((first + 1).saturating_sub(pixels.len())..);
            let high = run.other_high[0].get((first + 1).saturating_sub(pixels.len())..);
            if let (Some(levels), Some(low), Some(high)) = (levels, low, high) {
                let weighing = Weighing {
                    cell_costs_q8,
                    truncations,
                    levels,
                    others: [low, high],
                };
                weighing.weigh::<BLOCKS>(run, self.stride, costs);
            }
            return;
        }
        let cells = cell_costs_q8.iter().zip(truncations);
        for (index, (cost_q8, most)) in (0..pixels.len()).zip(cells) {
            let at = index * self.stride;
            let Some(costs) = costs.get_mut(at..at + BLOCKS * LANES) else {
                return;
            };
            if run.difference_weight_q4 == 0 {
                weigh(costs, (*cost_q8, *most));
                continue;
            }
            let mut means = [0; MAX_BLOCKS * LANES];
            let Some(means) = means.get_mut(..costs.len()) else {
                return;
            };
            mean_differences(run, pixels.start + index, first - index, means);
            // A difference is one from level 0.
            let weighing = Weighing {
                cell_costs_q8: slice::from_ref(cost_q8),
                truncations: slice::from_ref(most),
                levels: &[0],
                others: [means, means],
            };
            weighing.weigh::<BLOCKS>(run, self.stride, costs);
        }
    }

    /// Writes how many cells, at most 255, of the bytes `bytes` of the pixels' patterns differ from those of the other
    /// view's patterns. `counts` begins with the first pixel's.
    #[inline(always)]
    fn count<const BLOCKS: usize, const MASKED: bool>(
        &self,
        bytes: Range<usize>,
        pixels: Range<usize>,
        counts: &mut [u8],
    ) {
        let run = self.run;
        let first = run.first_position + self.start - pixels.start;
        let ends_within = |planes: &Planes<'_>, end: usize| {
            bytes.end * planes.stride - planes.stride + end <= planes.bytes.len()
        };
        debug_assert!(!bytes.is_empty() && !pixels.is_empty());
        debug_assert!((1..=MAX_BLOCKS).contains(&BLOCKS) && BLOCKS * LANES <= self.stride);
        debug_assert!(counts.len() >= (pixels.len() - 1) * self.stride + BLOCKS * LANES);
        debug_assert!(ends_within(&run.inputs, run.start + pixels.end));
        debug_assert!(ends_within(&run.stored, first + BLOCKS * LANES));
        debug_assert!(first + 1 >= pixels.len());
        debug_assert!(!MASKED || ends_within(&run.masks, pixels.end));
        let at = |planes: &Planes<'_>, position: usize| {
            let first = bytes.start * planes.stride + position;
            planes.bytes.as_ptr().wrapping_add(first)
        };
        let past = |planes: &Planes<'_>| bytes.len() * planes.stride;
        // From a pixel to the next, the patterns and masks are one further, and the other view's one less.
        let steps = Steps {
            bytes: bytes.len(),
            counts: self.stride,
            inputs: past(&run.inputs).wrapping_sub(1),
            stored: past(&run.stored).wrapping_add(1),
            masks: past(&run.masks).wrapping_sub(1),
        };
        macro_rules! add_ones {
            ($others:literal, $sum:literal, [$($mask:literal,)*]) => {
                concat!(
                    "vldrb.u8 q6, [{stored}", $others, "]\n",
                    "veor q6, q6, q4\n",
                    $($mask, "\n",)*
                    "vldrb.u8 q7, [{ones}, q6]\n",
                    "vqadd.u8 ", $sum, ", ", $sum, ", q7",
                )
            };
        }
        // For each block, the ones of the differing cells are added up in a register of its own.
        macro_rules! count_blocks {
            (masked: $(($others:literal, $sum:literal)),+) => {
                count_blocks!(@
                    ["ldrb {byte}, [{mask}]", "add {mask}, {mask}, {mask_stride}", "vdup.8 q5, {byte}",],
                    ["vand q6, q6, q5",],
                    ["ldr {byte}, [{steps}, #16]", "sub {mask}, {mask}, {byte}",],
                    $(($others, $sum)),+;
                    mask = inout(reg) at(&run.masks, pixels.start) => _,
                    mask_stride = in(reg) run.masks.stride,
                )
            };
            (all: $(($others:literal, $sum:literal)),+) => {
                count_blocks!(@ [], [], [], $(($others, $sum)),+;)
            };
            (@ [$($load:literal,)*], $mask:tt, [$($step:literal,)*], $(($others:literal, $sum:literal)),+;
                $($operands:tt)*) => {
                vector_asm!(
                    "3:",
                    "ldr {byte}, [{steps}]",
                    "dls lr, {byte}",
                    $(concat!("vmov.i8 ", $sum, ", #0"),)+
                    "2:",
                    "ldrb {byte}, [{input}]",
                    "add {input}, {input}, {input_stride}",
                    "vdup.8 q4, {byte}",
                    $($load,)*
                    $(add_ones!($others, $sum, $mask),)+
                    "add {stored}, {stored}, {stored_stride}",
                    "le lr, 2b",
                    $(concat!("vstrb.8 ", $sum, ", [{counts}", $others, "]"),)+
                    "ldr {byte}, [{steps}, #4]",
                    "add {counts}, {counts}, {byte}",
                    "ldr {byte}, [{steps}, #8]",
                    "sub {input}, {input}, {byte}",
                    "ldr {byte}, [{steps}, #12]",
                    "sub {stored}, {stored}, {byte}",
                    $($step,)*
                    "subs {pixels}, {pixels}, #1",
                    "bne 3b";
                    $($operands)*
                    steps = in(reg) &raw const steps,
                    pixels = inout(reg) pixels.len() => _,
                    byte = out(reg) _,
                    input = inout(reg) at(&run.inputs, run.start + pixels.start) => _,
                    input_stride = in(reg) run.inputs.stride,
                    stored = inout(reg) at(&run.stored, first) => _,
                    stored_stride = in(reg) run.stored.stride,
                    ones = in(reg) ONES.as_ptr(),
                    counts = inout(reg) counts.as_mut_ptr() => _,
                )
            };
        }
        // SAFETY: as asserted, each byte of the pixels' patterns and masks, and the vectors of the other view's patterns
        // from the last pixel's on, are within their planes; the counts have as many vectors; and the table has 256
        // bytes.
        unsafe {
            match (MASKED, BLOCKS) {
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

    /// Writes the costs of a pixel's pattern of more cells than a count of 8 bits takes.
    #[inline(always)]
    fn weigh_parts<const BLOCKS: usize, const MASKED: bool>(
        &self,
        x: usize,
        cell: (u16, u8),
        costs: &mut [u8],
    ) {
        let bytes = self.run.inputs.count;
        let mut sums = Sums([0; _]);
        for start in (0..bytes).step_by(PART) {
            self.count::<BLOCKS, MASKED>(start..bytes.min(start + PART), x..x + 1, costs);
            sums.add(costs.get(..BLOCKS * LANES).unwrap_or_default());
        }
        sums.weigh(costs.get_mut(..BLOCKS * LANES).unwrap_or_default(), cell);
    }
}

/// Numbers and steps, in bytes, of the loop over the bytes of patterns; assembly addresses the fields by their order.
#[repr(C)]
struct Steps {
    bytes: usize,
    counts: usize,
    /// Bytes back from behind a pixel's last plane to the next pixel.
    inputs: usize,
    stored: usize,
    masks: usize,
}

/// Whether this code takes the run: all that it loads for `pixels` pixels of `stride` disparities stands in the
/// slices.
fn is_within(run: &CostRun<'_>, pixels: usize, stride: usize) -> bool {
    let (bytes, stored_end) = (run.inputs.count, run.first_position + stride);
    let has = |planes: &Planes<'_>, end: usize| {
        end <= planes.stride && planes.bytes.len() >= bytes * planes.stride
    };
    let input_end = run.start + pixels;
    let have = |rows: &[&[u8]; MAX_CHANNELS], end: usize| {
        rows.iter().take(run.channels).all(|row| row.len() >= end)
    };
    let has_levels = run.difference_weight_q4 == 0
        || have(&run.levels, input_end)
            && have(&run.other_low, stored_end)
            && have(&run.other_high, stored_end);
    pixels > 0
        && bytes > 0
        && [1, MAX_CHANNELS].contains(&run.channels)
        && run.first_position + 1 >= pixels
        && has(&run.inputs, input_end)
        && run.stored.count == bytes
        && has(&run.stored, stored_end)
        && (run.masks.count == 0 || run.masks.count == bytes && has(&run.masks, pixels))
        && has_levels
}

/// Replaces counts of differing cells by their costs.
///
/// The high byte of a cost per cell times the count is a whole cost; of the low byte's the rounded high half is.
#[inline(always)]
fn weigh(costs: &mut [u8], (cell_cost_q8, truncation): (u16, u8)) {
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

/// Inputs of the costs of a run of pixels, besides the numbers of their differing cells.
struct Weighing<'a> {
    cell_costs_q8: &'a [u16],
    truncations: &'a [u8],
    levels: &'a [u8],
    /// Lowest and highest levels of the other view that count as equal, from the last pixel's first disparity on.
    others: [&'a [u8]; 2],
}

impl Weighing<'_> {
    /// [`weigh`] for each pixel, and adds the weighted differences of the levels from those of the other view.
    #[inline(always)]
    fn weigh<const BLOCKS: usize>(&self, run: &CostRun<'_>, stride: usize, costs: &mut [u8]) {
        let pixels = self.cell_costs_q8.len();
        let pixels = pixels.min(self.truncations.len()).min(self.levels.len());
        let [low, high] = self.others;
        debug_assert!(pixels > 0 && BLOCKS > 0 && BLOCKS * LANES <= stride);
        debug_assert!(low.len() >= pixels - 1 + BLOCKS * LANES && high.len() >= low.len());
        debug_assert!(costs.len() >= (pixels - 1) * stride + BLOCKS * LANES);
        let first = |others: &[u8]| others.as_ptr().wrapping_add(pixels - 1);
        // The whole part of the weight, and the rest, 1/256.
        let (whole, rest) = (
            run.difference_weight_q4 / 16,
            run.difference_weight_q4 % 16 * 16,
        );
        // SAFETY: as asserted, there are whole vectors of costs, and as many levels of the other view from each pixel's
        // first disparity on, which is one less from pixel to pixel.
        unsafe {
            vector_asm!(
                "vdup.8 q3, {t}",
                "vdup.8 q4, {cell_cost}",
                "3:",
                "ldrh {cell_cost}, [{cell_costs}], #2",
                "ldrb {t}, [{truncations}], #1",
                "vdup.8 q0, {cell_cost}",
                "lsr {cell_cost}, {cell_cost}, #8",
                "vdup.8 q1, {t}",
                "ldrb {t}, [{levels}], #1",
                "vdup.8 q2, {t}",
                "mov {t}, #{blocks}",
                "dls lr, {t}",
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
                "le lr, 2b",
                "sub {low}, {low}, #{step}",
                "sub {high}, {high}, #{step}",
                "add {costs}, {costs}, {beyond}",
                "subs {pixels}, {pixels}, #1",
                "bne 3b";
                blocks = const BLOCKS,
                step = const BLOCKS * LANES + 1,
                pixels = inout(reg) pixels => _,
                cell_costs = inout(reg) self.cell_costs_q8.as_ptr() => _,
                truncations = inout(reg) self.truncations.as_ptr() => _,
                levels = inout(reg) self.levels.as_ptr() => _,
                low = inout(reg) first(low) => _,
                high = inout(reg) first(high) => _,
                costs = inout(reg) costs.as_mut_ptr() => _,
                beyond = in(reg) stride - BLOCKS * LANES,
                whole = in(reg) u32::from(whole),
                t = inout(reg) u32::from(run.difference_truncation) => _,
                cell_cost = inout(reg) u32::from(rest) => _,
            );
        }
    }
}

/// Writes the means of the differences of the three levels of pixel `x` from those of the other view from `first` on, as
/// many as `means` has.
fn mean_differences(run: &CostRun<'_>, x: usize, first: usize, means: &mut [u8]) {
    let end = first + means.len();
    debug_assert!(means.len().is_multiple_of(LANES) && !means.is_empty());
    debug_assert!(run.other_low.iter().all(|row| row.len() >= end));
    debug_assert!(run.other_high.iter().all(|row| row.len() >= end));
    let own = run.levels.iter().rev();
    let own = own.map(|levels| levels.get(run.start + x).copied().unwrap_or(0));
    let own = own.fold(0, |all, level| all << 8 | u32::from(level));
    let [low, high] = [run.other_low, run.other_high]
        .map(|rows| rows.map(|row| row.as_ptr().wrapping_add(first)));
    macro_rules! difference {
        ($low:literal, $high:literal, $own:literal) => {
            concat!(
                "vldrb.u8 q4, [",
                $low,
                "], #16\n",
                "vldrb.u8 q5, [",
                $high,
                "], #16\n",
                "vqsub.u8 q4, q4, ",
                $own,
                "\n",
                "vqsub.u8 q5, ",
                $own,
                ", q5\n",
                "vorr q4, q4, q5",
            )
        };
    }
    // SAFETY: as asserted, there are whole vectors of means, and as many levels of the other view.
    unsafe {
        vector_asm!(
            "vdup.8 q0, {own}",
            "lsr {own}, {own}, #8",
            "vdup.8 q1, {own}",
            "lsr {own}, {own}, #8",
            "vdup.8 q2, {own}",
            // 85 / 256 is a third.
            "vmov.i8 q3, #85",
            "dls lr, {blocks}",
            "2:",
            difference!("{low0}", "{high0}", "q0"),
            "vmullb.u8 q6, q4, q3",
            "vmullt.u8 q7, q4, q3",
            difference!("{low1}", "{high1}", "q1"),
            "vmullb.u8 q5, q4, q3",
            "vadd.i16 q6, q6, q5",
            "vmullt.u8 q5, q4, q3",
            "vadd.i16 q7, q7, q5",
            difference!("{low2}", "{high2}", "q2"),
            "vmullb.u8 q5, q4, q3",
            "vadd.i16 q6, q6, q5",
            "vmullt.u8 q5, q4, q3",
            "vadd.i16 q7, q7, q5",
            "vshrnb.i16 q4, q6, #8",
            "vshrnt.i16 q4, q7, #8",
            "vstrb.8 q4, [{means}], #16",
            "le lr, 2b";
            blocks = in(reg) means.len() / LANES,
            own = inout(reg) own => _,
            low0 = inout(reg) low[0] => _,
            low1 = inout(reg) low[1] => _,
            low2 = inout(reg) low[2] => _,
            high0 = inout(reg) high[0] => _,
            high1 = inout(reg) high[1] => _,
            high2 = inout(reg) high[2] => _,
            means = inout(reg) means.as_mut_ptr() => _,
        );
    }
}

/// Counts of 16 bits: of each sixteen, those of the even ones, then those of the odd ones.
struct Sums([u16; MAX_BLOCKS * LANES]);

impl Sums {
    #[inline(always)]
    fn add(&mut self, counts: &[u8]) {
        debug_assert!(counts.len().is_multiple_of(LANES));
        debug_assert!((LANES..=MAX_BLOCKS * LANES).contains(&counts.len()));
        // SAFETY: as asserted, the counts are whole vectors, and the sums twice as many.
        unsafe {
            vector_asm!(
                "dls lr, {blocks}",
                "2:",
                "vldrb.u8 q0, [{counts}], #16",
                "vldrh.u16 q1, [{sums}]",
                "vldrh.u16 q2, [{sums}, #16]",
                "vmovlb.u8 q3, q0",
                "vmovlt.u8 q4, q0",
                "vadd.i16 q1, q1, q3",
                "vadd.i16 q2, q2, q4",
                "vstrh.16 q1, [{sums}], #16",
                "vstrh.16 q2, [{sums}], #16",
                "le lr, 2b";
                blocks = in(reg) counts.len() / LANES,
                counts = inout(reg) counts.as_ptr() => _,
                sums = inout(reg) self.0.as_mut_ptr() => _,
            );
        }
    }

    /// Writes the costs of the sums.
    #[inline(always)]
    fn weigh(&self, costs: &mut [u8], (cell_cost_q8, truncation): (u16, u8)) {
        debug_assert!(costs.len().is_multiple_of(LANES));
        debug_assert!((LANES..=MAX_BLOCKS * LANES).contains(&costs.len()));
        // SAFETY: as asserted, the costs are whole vectors, and the sums twice as many.
        unsafe {
            vector_asm!(
                "vdup.8 q3, {truncation}",
                "dls lr, {blocks}",
                "2:",
                "vldrh.u16 q1, [{sums}], #16",
                "vldrh.u16 q2, [{sums}], #16",
                "vmul.i16 q1, q1, {cell_cost}",
                "vmul.i16 q2, q2, {cell_cost}",
                "vrshrnb.i16 q0, q1, #8",
                "vrshrnt.i16 q0, q2, #8",
                "vmin.u8 q0, q0, q3",
                "vstrb.8 q0, [{costs}], #16",
                "le lr, 2b";
                blocks = in(reg) costs.len() / LANES,
                costs = inout(reg) costs.as_mut_ptr() => _,
                sums = inout(reg) self.0.as_ptr() => _,
                cell_cost = in(reg) u32::from(cell_cost_q8),
                truncation = in(reg) u32::from(truncation),
            );
        }
    }
}
