//! Weighted median of eight pixels at once, in halfwords.
//!
//! The weights of all taps are listed once, with the least and the greatest value that has one. Then the
//! median is searched for between them by bisection, as in the reference.

use core::ptr;

use vgstereo_core::disparity::INVALID;
use vgstereo_core::kernel::{Kernels, MAX_CHANNELS, MAX_TAP_ROWS, WeightedMedianRow};

use super::vector_asm;
use crate::armv7em::Armv7em;

/// Pixels filtered at once.
const PIXELS: usize = 8;

/// Equals [`vgstereo_core::kernel::weighted_median_row`] bit for bit.
pub(super) fn weighted_median_row(
    row: &WeightedMedianRow<'_>,
    weights: &mut [u8],
    output: &mut [i16],
) {
    let width = output.len();
    if !is_whole(row, weights, width) {
        Armv7em.weighted_median_row(row, weights, output);
        return;
    }
    // The last block overlaps the one before it, so that nothing remains.
    for x in (0..width).step_by(PIXELS) {
        let x = x.min(width - PIXELS);
        let medians = filter_block(row, x, weights);
        if let Some(output) = output.get_mut(x..x + PIXELS) {
            output.copy_from_slice(&medians);
        }
    }
}

/// Whether this code takes the row: all that it loads and stores for `width` pixels stands in the slices.
fn is_whole(row: &WeightedMedianRow<'_>, weights: &[u8], width: usize) -> bool {
    let padded = width + row.window_width.saturating_sub(1);
    let taps = row.rows * row.tap_columns().len();
    let values = row.values.iter().take(row.rows);
    let levels = row.levels.iter().take(row.channels);
    let mut levels = levels.flat_map(|rows| rows.iter().take(row.rows));
    let mut centres = row.centres.iter().take(row.channels);
    width >= PIXELS
        && taps > 0
        && row.rows <= MAX_TAP_ROWS
        && [1, MAX_CHANNELS].contains(&row.channels)
        && row.places.len() >= taps
        && weights.len() >= taps * PIXELS
        && values.into_iter().all(|values| values.len() >= padded)
        && levels.all(|levels| levels.len() >= padded)
        && centres.all(|levels| levels.len() >= width)
}

/// Sums and ranges of the weighted median of a block of pixels, and their levels; assembly addresses the fields by their
/// order.
#[repr(C)]
struct Block {
    /// The sum of the weights.
    totals: [u16; PIXELS],
    /// The least value with a weight.
    low: [i16; PIXELS],
    /// The greatest value with a weight.
    high: [i16; PIXELS],
    reach: [u16; PIXELS],
    centres: [[u16; PIXELS]; MAX_CHANNELS],
}

/// Returns the medians of the pixels from `x` on.
#[inline(never)]
fn filter_block<'a>(row: &WeightedMedianRow<'a>, x: usize, weights: &mut [u8]) -> [i16; PIXELS] {
    let columns = row.tap_columns().len();
    let mut block = Block {
        totals: [0; _],
        low: [i16::MAX; _],
        high: [i16::MIN; _],
        reach: [row.colour_reach.into(); _],
        centres: [[0; _]; _],
    };
    for (centres, levels) in block.centres.iter_mut().zip(row.centres).take(row.channels) {
        if let Some(levels) = levels.get(x..x + PIXELS) {
            for (centre, &level) in centres.iter_mut().zip(levels) {
                *centre = level.into();
            }
        }
    }
    let mut values = [ptr::null(); MAX_TAP_ROWS];
    let places = row.places.chunks_exact(columns.max(1));
    let lists = weights.chunks_exact_mut((columns * PIXELS).max(1));
    let rows = row.values.iter().zip(&mut values).take(row.rows);
    for (index, ((own, values), (places, weights))) in rows.zip(places.zip(lists)).enumerate() {
        let of_row = |rows: &[&'a [u8]; MAX_TAP_ROWS]| rows.get(index)?.get(x..);
        let taps = Taps {
            values: own.get(x..).unwrap_or_default(),
            levels: row.levels.map(|rows| of_row(&rows).unwrap_or_default()),
            places,
        };
        *values = taps.values.as_ptr();
        if row.channels == 1 {
            taps.weigh_grey(&mut block, weights);
        } else {
            taps.weigh_colour(&mut block, weights);
        }
    }
    let debugged = row.values.iter().take(row.rows);
    debug_assert!(
        debugged
            .into_iter()
            .all(|row| row.len() >= x + 2 * columns - 2 + PIXELS)
    );
    debug_assert!(weights.len() >= row.rows * columns * PIXELS);
    // SAFETY: as asserted, each row of values has those of all taps, and the weights are as many.
    unsafe { search(&mut block, &values, row.rows, columns, weights) };
    let mut medians = block.low;
    for (median, total) in medians.iter_mut().zip(block.totals) {
        *median = if total == 0 { INVALID } else { *median };
    }
    medians
}

/// A row of taps, from that of the first column on; there is one at every second column.
struct Taps<'a> {
    values: &'a [i16],
    levels: [&'a [u8]; MAX_CHANNELS],
    places: &'a [u8],
}

/// Assembly of the weights of a block: the lines given compute in q5 how alike the colours of a tap and of the pixels
/// are, 0 if not at all; from that follow the weight of the tap, which is listed and added up, and the range of the
/// values that have a weight.
macro_rules! weigh {
    ($($likeness:literal),+; $($operands:tt)*) => {
        vector_asm!(
            "vmrs {predicate}, p0",
            "vldrh.u16 q0, [{block}]",
            "vldrh.u16 q1, [{block}, #16]",
            "vldrh.u16 q2, [{block}, #32]",
            "vldrh.u16 q4, [{block}, #48]",
            "dls lr, {count}",
            "2:",
            $($likeness,)+
            "ldrb {place}, [{places}], #1",
            "vmul.i16 q5, q5, q5",
            "vldrh.u16 q6, [{values}], #4",
            "vshr.u16 q5, q5, #4",
            "vmul.i16 q5, q5, {place}",
            "vshr.u16 q5, q5, #4",
            "vpt.i16 eq, q6, {invalid}",
            "vmovt.i16 q5, #0",
            "vstrb.16 q5, [r1], #8",
            "vadd.i16 q0, q0, q5",
            "vptt.i16 ne, q5, zr",
            "vmint.s16 q1, q1, q6",
            "vmaxt.s16 q2, q2, q6",
            "le lr, 2b",
            "vstrh.16 q0, [{block}]",
            "vstrh.16 q1, [{block}, #16]",
            "vstrh.16 q2, [{block}, #32]",
            "vmsr p0, {predicate}";
            predicate = out(reg) _,
            invalid = in(reg) i32::from(INVALID),
            place = out(reg) _,
            $($operands)*
        )
    };
}

impl Taps<'_> {
    /// Lists the weights of the taps, eight bytes each, and adds what follows from them to the block.
    #[inline(always)]
    fn weigh_grey(&self, block: &mut Block, weights: &mut [u8]) {
        self.assert_within(weights, 1);
        // SAFETY: as asserted, values and levels have those of all taps, and the weights are as many.
        unsafe {
            weigh!(
                "vldrb.u16 q5, [r0], #2",
                "vldrh.u16 q3, [{block}, #64]",
                "vabd.u16 q5, q5, q3",
                // Grey counts as three equal channels.
                "vmul.i16 q5, q5, {three}",
                "vqsub.u16 q5, q4, q5";
                three = in(reg) 3,
                block = in(reg) ptr::from_mut(block),
                count = in(reg) self.places.len(),
                places = inout(reg) self.places.as_ptr() => _,
                values = inout(reg) self.values.as_ptr() => _,
                // Loads that widen and stores that narrow take these registers alone as addresses.
                inout("r0") self.levels[0].as_ptr() => _,
                inout("r1") weights.as_mut_ptr() => _,
            );
        }
    }

    /// [`Self::weigh_grey`] of three channels.
    #[inline(always)]
    fn weigh_colour(&self, block: &mut Block, weights: &mut [u8]) {
        self.assert_within(weights, MAX_CHANNELS);
        // SAFETY: as asserted, values and levels have those of all taps, and the weights are as many.
        unsafe {
            weigh!(
                "vldrb.u16 q5, [r0], #2",
                "vldrh.u16 q3, [{block}, #64]",
                "vabd.u16 q5, q5, q3",
                "vldrb.u16 q7, [r2], #2",
                "vldrh.u16 q3, [{block}, #80]",
                "vabd.u16 q7, q7, q3",
                "vadd.i16 q5, q5, q7",
                "vldrb.u16 q7, [r3], #2",
                "vldrh.u16 q3, [{block}, #96]",
                "vabd.u16 q7, q7, q3",
                "vadd.i16 q5, q5, q7",
                "vqsub.u16 q5, q4, q5";
                block = in(reg) ptr::from_mut(block),
                count = in(reg) self.places.len(),
                places = inout(reg) self.places.as_ptr() => _,
                values = inout(reg) self.values.as_ptr() => _,
                inout("r0") self.levels[0].as_ptr() => _,
                inout("r1") weights.as_mut_ptr() => _,
                inout("r2") self.levels[1].as_ptr() => _,
                inout("r3") self.levels[2].as_ptr() => _,
            );
        }
    }

    fn assert_within(&self, weights: &[u8], channels: usize) {
        debug_assert!(!self.places.is_empty());
        let reach = 2 * self.places.len() - 2 + PIXELS;
        debug_assert!(weights.len() == self.places.len() * PIXELS);
        debug_assert!(self.values.len() >= reach);
        let mut levels = self.levels.iter().take(channels);
        debug_assert!(levels.all(|levels| levels.len() >= reach));
    }
}

/// Moves the least value of a block to the median: the smallest value at or below which lies at least half of the
/// weight.
///
/// # Safety
/// The first `rows` pointers are of the values of a row's `columns` taps, and there are weights of all of them.
#[inline(always)]
unsafe fn search(
    block: &mut Block,
    values: &[*const i16; MAX_TAP_ROWS],
    rows: usize,
    columns: usize,
    weights: &[u8],
) {
    // SAFETY: as the caller promises.
    unsafe {
        vector_asm!(
            "vmrs {predicate}, p0",
            "vldrh.u16 q6, [{block}]",
            "vldrh.u16 q4, [{block}, #16]",
            "vldrh.u16 q5, [{block}, #32]",
            "vmov.i16 q7, #1",
            "4:",
            "vcmp.s16 gt, q5, q4",
            "vmrs {left}, p0",
            "cmp {left}, #0",
            "beq 5f",
            // Rounded down, without overflow.
            "vhadd.s16 q1, q4, q5",
            "vmov.i16 q0, #0",
            "mov {row}, {values}",
            "mov r1, {weights}",
            "mov {left}, {rows}",
            "3:",
            "ldr {value}, [{row}], #4",
            "dls lr, {columns}",
            "2:",
            "vldrh.u16 q2, [{value}], #4",
            "vldrb.u16 q3, [r1], #8",
            "vpt.s16 ge, q1, q2",
            "vaddt.i16 q0, q0, q3",
            "le lr, 2b",
            "subs {left}, {left}, #1",
            "bne 3b",
            // Where at least half is at or below the middle, that is the greatest, and else the next the least.
            "vsub.i16 q2, q6, q0",
            "vcmp.u16 cs, q0, q2",
            "vpsel q3, q1, q5",
            "vadd.i16 q1, q1, q7",
            "vpsel q2, q4, q1",
            "vcmp.s16 gt, q5, q4",
            "vpsel q4, q2, q4",
            "vpsel q5, q3, q5",
            "b 4b",
            "5:",
            "vstrh.16 q4, [{block}, #16]",
            "vmsr p0, {predicate}";
            predicate = out(reg) _,
            block = in(reg) ptr::from_mut(block),
            values = in(reg) values.as_ptr(),
            row = out(reg) _,
            value = out(reg) _,
            left = out(reg) _,
            rows = in(reg) rows,
            columns = in(reg) columns,
            weights = in(reg) weights.as_ptr(),
            // Loads that widen take this register alone, and others below it, as address.
            out("r1") _,
        );
    }
}
