//! Masks of a whole block of 32 pixels in two vectors of sixteen.

use vgstereo_core::kernel::{CELLS_PER_BYTE, Kernels, MASK_LANES, MAX_CHANNELS, MaskBlock};

use super::{LANES, vector_asm};
use crate::armv7em::Armv7em;

/// One byte for each pixel of the block.
type Row = [u8; MASK_LANES];

const _: () = assert!(MASK_LANES == 2 * LANES);

/// Largest number of cells that are counted in 8 bits.
const GROUP: usize = u8::MAX as usize;

/// Equals [`vgstereo_core::kernel::mask_block`] bit for bit.
pub(super) fn mask_block(block: &mut MaskBlock<'_>) {
    if is_whole(block) {
        find_masks(block);
    } else {
        Armv7em.mask_block(block);
    }
}

/// Whether the block has all its pixels, whole bytes of cells, and all samples stand in the rows.
fn is_whole(block: &MaskBlock<'_>) -> bool {
    let cells = block.starts.len();
    let last = block.starts.iter().fold(0, |last, &start| last.max(start));
    let end = (last as usize + block.first).max(block.centre) + MASK_LANES;
    let mut levels = block.levels.iter().take(block.channels);
    block.lanes == MASK_LANES
        && cells > 0
        && cells.is_multiple_of(CELLS_PER_BYTE)
        && block.cells.len() == cells * MASK_LANES
        && block.masks.len() == cells / CELLS_PER_BYTE * MASK_LANES
        && [1, MAX_CHANNELS].contains(&block.channels)
        && levels.all(|levels| levels.len() >= end)
}

#[inline(never)]
fn find_masks(block: &mut MaskBlock<'_>) {
    let cells = block.cells.as_chunks_mut::<MASK_LANES>().0;
    let levels = block.levels.iter().take(block.channels);
    for (channel, levels) in levels.enumerate() {
        compare(
            levels,
            block.centre,
            block.starts,
            block.first,
            channel > 0,
            cells,
        );
    }
    join_cells(cells);
    let mut thresholds = [block.floor; MASK_LANES];
    let mut excess = block.step.get();
    let kept = block.kept;
    loop {
        block.counts = [0; MASK_LANES];
        for group in cells.chunks(GROUP) {
            count_within(group, &thresholds, &mut block.counts);
        }
        let higher = block.floor.saturating_add(excess);
        let mut is_done = true;
        for (threshold, &count) in thresholds.iter_mut().zip(&block.counts) {
            // Every difference is within the highest threshold.
            let rises = (count < kept) & (*threshold < u8::MAX);
            *threshold = if rises { higher } else { *threshold };
            is_done &= !rises;
        }
        if is_done {
            break;
        }
        excess = excess.saturating_mul(2);
    }
    write_masks(cells, &thresholds, block.masks);
}

/// Writes the differences of the samples from their pixels in a channel, or adds them to those of another one.
#[inline(always)]
fn compare(
    levels: &[u8],
    centre: usize,
    starts: &[u32],
    first: usize,
    adds: bool,
    cells: &mut [Row],
) {
    debug_assert!(!starts.is_empty() && starts.len() == cells.len());
    let length = levels.len();
    debug_assert!(centre + MASK_LANES <= length);
    let mut ends = starts
        .iter()
        .map(|&start| start as usize + first + MASK_LANES);
    debug_assert!(ends.all(|end| end <= length));
    macro_rules! compare {
        ($($add:literal),*) => {
            vector_asm!(
                "vldrb.u8 q0, [{centre}]",
                "vldrb.u8 q1, [{centre}, #16]",
                "dls lr, {count}",
                "2:",
                "ldr {sample}, [{starts}], #4",
                "add {sample}, {sample}, {levels}",
                "vldrb.u8 q2, [{sample}]",
                "vldrb.u8 q3, [{sample}, #16]",
                "vabd.u8 q2, q2, q0",
                "vabd.u8 q3, q3, q1",
                $($add,)*
                "vstrb.8 q2, [{cells}], #16",
                "vstrb.8 q3, [{cells}], #16",
                "le lr, 2b";
                count = in(reg) starts.len(),
                starts = inout(reg) starts.as_ptr() => _,
                sample = out(reg) _,
                levels = in(reg) levels.as_ptr().wrapping_add(first),
                centre = in(reg) levels.as_ptr().wrapping_add(centre),
                cells = inout(reg) cells.as_mut_ptr() => _,
            )
        };
    }
    // SAFETY: as asserted, the pixels and all samples are within the levels, and there are as many rows of cells as
    // samples.
    unsafe {
        if adds {
            compare!(
                "vldrb.u8 q4, [{cells}]",
                "vldrb.u8 q5, [{cells}, #16]",
                "vqadd.u8 q2, q2, q4",
                "vqadd.u8 q3, q3, q5"
            );
        } else {
            compare!();
        }
    }
}

/// Turns the differences of samples into those of cells: the larger of a synapse's and its partner's, the first
/// one being that of the last.
#[inline(always)]
fn join_cells(cells: &mut [Row]) {
    debug_assert!(!cells.is_empty());
    let Some(first) = cells.first().copied() else {
        return;
    };
    // SAFETY: the row after each but the last is one of the cells, and after the last the copy of the first is taken.
    unsafe {
        vector_asm!(
            "vldrb.u8 q0, [{cells}]",
            "vldrb.u8 q1, [{cells}, #16]",
            "wls lr, {count}, 3f",
            "2:",
            "vldrb.u8 q2, [{cells}, #32]",
            "vldrb.u8 q3, [{cells}, #48]",
            "vmax.u8 q0, q0, q2",
            "vmax.u8 q1, q1, q3",
            "vstrb.8 q0, [{cells}], #16",
            "vstrb.8 q1, [{cells}], #16",
            "vorr q0, q2, q2",
            "vorr q1, q3, q3",
            "le lr, 2b",
            "3:",
            "vldrb.u8 q2, [{first}]",
            "vldrb.u8 q3, [{first}, #16]",
            "vmax.u8 q0, q0, q2",
            "vmax.u8 q1, q1, q3",
            "vstrb.8 q0, [{cells}]",
            "vstrb.8 q1, [{cells}, #16]";
            count = in(reg) cells.len() - 1,
            cells = inout(reg) cells.as_mut_ptr() => _,
            first = in(reg) first.as_ptr(),
        );
    }
}

/// Adds the numbers of cells of each pixel whose difference is within its threshold.
#[inline(always)]
fn count_within(cells: &[Row], thresholds: &Row, counts: &mut [u16; MASK_LANES]) {
    debug_assert!((1..=GROUP).contains(&cells.len()));
    let mut sums = [0_u8; MASK_LANES];
    // SAFETY: there are as many rows of two vectors as the loop has turns.
    unsafe {
        vector_asm!(
            "vmrs {predicate}, p0",
            "vldrb.u8 q0, [{thresholds}]",
            "vldrb.u8 q1, [{thresholds}, #16]",
            "vmov.i8 q2, #0",
            "vmov.i8 q3, #0",
            "dls lr, {count}",
            "2:",
            "vldrb.u8 q4, [{cells}], #16",
            "vldrb.u8 q5, [{cells}], #16",
            "vpt.u8 cs, q0, q4",
            "vaddt.i8 q2, q2, {one}",
            "vpt.u8 cs, q1, q5",
            "vaddt.i8 q3, q3, {one}",
            "le lr, 2b",
            "vstrb.8 q2, [{sums}]",
            "vstrb.8 q3, [{sums}, #16]",
            "vmsr p0, {predicate}";
            predicate = out(reg) _,
            count = in(reg) cells.len(),
            cells = inout(reg) cells.as_ptr() => _,
            thresholds = in(reg) thresholds.as_ptr(),
            sums = in(reg) sums.as_mut_ptr(),
            one = in(reg) 1,
        );
    }
    for (count, sum) in counts.iter_mut().zip(sums) {
        *count += u16::from(sum);
    }
}

/// Writes one bit per cell: 1 where its difference is within the pixel's threshold.
#[inline(always)]
fn write_masks(cells: &[Row], thresholds: &Row, masks: &mut [u8]) {
    debug_assert!(!cells.is_empty() && cells.len().is_multiple_of(CELLS_PER_BYTE));
    debug_assert!(masks.len() * CELLS_PER_BYTE == cells.as_flattened().len());
    macro_rules! add_bit {
        ($bit:literal) => {
            concat!(
                "vldrb.u8 q4, [{cells}], #16\n",
                "vldrb.u8 q5, [{cells}], #16\n",
                "mov {bit}, #",
                $bit,
                "\n",
                "vpt.u8 cs, q0, q4\n",
                "vaddt.i8 q2, q2, {bit}\n",
                "vpt.u8 cs, q1, q5\n",
                "vaddt.i8 q3, q3, {bit}",
            )
        };
    }
    // SAFETY: as asserted, there are as many rows of masks as eight rows of cells, and as many turns of the loop.
    unsafe {
        vector_asm!(
            "vmrs {predicate}, p0",
            "vldrb.u8 q0, [{thresholds}]",
            "vldrb.u8 q1, [{thresholds}, #16]",
            "dls lr, {count}",
            "2:",
            "vmov.i8 q2, #0",
            "vmov.i8 q3, #0",
            add_bit!("1"),
            add_bit!("2"),
            add_bit!("4"),
            add_bit!("8"),
            add_bit!("16"),
            add_bit!("32"),
            add_bit!("64"),
            add_bit!("128"),
            "vstrb.8 q2, [{masks}], #16",
            "vstrb.8 q3, [{masks}], #16",
            "le lr, 2b",
            "vmsr p0, {predicate}";
            predicate = out(reg) _,
            count = in(reg) cells.len() / CELLS_PER_BYTE,
            cells = inout(reg) cells.as_ptr() => _,
            thresholds = in(reg) thresholds.as_ptr(),
            masks = inout(reg) masks.as_mut_ptr() => _,
            bit = out(reg) _,
        );
    }
}
