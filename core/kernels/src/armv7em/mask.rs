//! Masks of the cells on each pixel's surface, four pixels per word.

use bytemuck::try_cast_slice;
use vgstereo_core::kernel::{self, CELLS_PER_BYTE, MASK_LANES, MAX_CHANNELS, MaskBlock};

use super::simd::{
    add_even_bytes, add_odd_bytes, add_saturating_u8x4, distance_u8x4, is_ge_u8x4, load, load_six,
    max_u8x4, min_u8x4, select_ge_u8x4, select_ge_u16x2, splat_u8, splat_u16, store,
    sub_saturating_u8x4,
};

/// Pixels per word.
const LANES: usize = 4;
/// Words per row of the block.
const WORDS: usize = MASK_LANES / LANES;
/// Number of words compared at once: as many as fit the registers.
const GROUP: usize = 4;

/// Number of thresholds on the ladder: at least ten, because the step can double eight times before
/// it exceeds every difference, and a power of two, so that an index is cheaply kept in range.
const RUNGS: usize = 16;

/// One byte of the masks.
type Row = [[u8; LANES]; WORDS];
type Group = [u32; GROUP];
/// Differences of the eight cells of one byte of the mask of four pixels.
type Column = [[u8; LANES]; CELLS_PER_BYTE];
/// A [`Column`] that is aligned to words: four pixels in each.
type AlignedColumn = [u32; CELLS_PER_BYTE];

/// Number of mask bytes whose cells are counted in 8 bits before the counts are widened.
const COUNTED: usize = u8::MAX as usize / CELLS_PER_BYTE;

/// Four values in two words of halfwords: those of pixels 0 and 2, then those of pixels 1 and 3.
type Halfwords = [u32; 2];

/// Equals [`kernel::mask_block`] bit for bit.
#[inline(never)]
pub(super) fn mask_block(block: &mut MaskBlock<'_>) {
    let count = block.starts.len();
    let is_counted = (block.kept.into()..=usize::from(u16::MAX)).contains(&count);
    let fits = is_counted
        && count.is_multiple_of(CELLS_PER_BYTE)
        && block.cells.len() == count * MASK_LANES;
    let compared = match block.channels {
        _ if block.lanes != MASK_LANES || !fits => None,
        1 => compare::<1>(block),
        _ => compare::<MAX_CHANNELS>(block),
    };
    if compared.is_none() {
        kernel::mask_block(block);
        return;
    }
    let ladder = Ladder::new(block);
    let masks = block.masks.as_chunks_mut::<LANES>().0;
    let masks = masks.as_chunks_mut::<WORDS>().0;
    if let Ok(words) = try_cast_slice(block.cells) {
        let columns: &[AlignedColumn] = words.as_chunks().0;
        ladder.choose(columns.as_chunks().0, masks, &mut block.counts);
    } else {
        let columns: &[Column] = block.cells.as_chunks().0.as_chunks().0;
        ladder.choose(columns.as_chunks().0, masks, &mut block.counts);
    }
}

/// Differences of the eight cells of one byte of the mask of four pixels.
trait Cells {
    /// Calls `body` with each, from the last to the first.
    fn each_reversed(&self, body: impl FnMut(u32));
}

impl Cells for Column {
    #[inline(always)]
    fn each_reversed(&self, body: impl FnMut(u32)) {
        self.iter().rev().map(load).for_each(body);
    }
}

impl Cells for AlignedColumn {
    #[inline(always)]
    fn each_reversed(&self, mut body: impl FnMut(u32)) {
        let [first @ .., g, h] = self;
        body(*h);
        body(*g);
        load_six(first).into_iter().rev().for_each(body);
    }
}

/// The ladder of thresholds, levels.
struct Ladder {
    thresholds: [u8; RUNGS],
    /// Smallest number of cells to keep, in both halfwords.
    kept: u32,
}

impl Ladder {
    fn new(block: &MaskBlock<'_>) -> Self {
        let mut thresholds = [block.floor; RUNGS];
        let mut excess = block.step.get();
        for threshold in thresholds.iter_mut().skip(1) {
            *threshold = block.floor.saturating_add(excess);
            excess = excess.saturating_mul(2);
        }
        Self {
            thresholds,
            kept: splat_u16(block.kept),
        }
    }

    /// Chooses the rung of each pixel. Writes its mask and the number of cells in it.
    #[inline(always)]
    fn choose(
        &self,
        cells: &[[impl Cells; WORDS]],
        masks: &mut [Row],
        counts: &mut [u16; MASK_LANES],
    ) {
        // The search starts at the neighbours' thresholds, which are usually similar.
        let mut rungs = 0;
        for (word, counts) in (0..WORDS).zip(counts.as_chunks_mut::<LANES>().0) {
            let kept_cells;
            (rungs, kept_cells) = self.search(cells, word, rungs);
            let [even, odd] = kept_cells;
            *counts = [even, odd, even >> 16, odd >> 16].map(|count| count as u16);
            write_masks(cells, word, self.thresholds(rungs), masks);
        }
    }

    /// Returns the thresholds of four rungs.
    #[inline(always)]
    fn thresholds(&self, rungs: u32) -> u32 {
        let rungs = rungs.to_le_bytes();
        load(&rungs.map(|rung| self.thresholds[usize::from(rung) % RUNGS]))
    }

    /// Returns the lowest rung that keeps enough cells for each of four pixels, and the number of
    /// cells within it. The search moves by one rung at a time, from `probes` on.
    #[inline(never)]
    fn search(
        &self,
        cells: &[[impl Cells; WORDS]],
        word: usize,
        mut probes: u32,
    ) -> (u32, Halfwords) {
        // Every difference is within the highest threshold.
        let (mut low, mut high) = (0, splat_u8(RUNGS as u8 - 1));
        // The number of all cells, which fits 16 bits.
        let mut counts = [splat_u16((cells.len() * CELLS_PER_BYTE) as u16); 2];
        loop {
            let counted = count_within(cells, word, self.thresholds(probes));
            let [even, odd] = counted;
            let are_enough = select_ge_u16x2(even, self.kept, splat_u16(0xff), 0)
                | select_ge_u16x2(odd, self.kept, splat_u16(0xff00), 0);
            let enough = |yes, no| select_ge_u8x4(are_enough, splat_u8(u8::MAX), yes, no);
            high = enough(probes, high);
            for (count, counted) in counts.iter_mut().zip(counted) {
                *count = select_ge_u16x2(counted, self.kept, counted, *count);
            }
            let above = probes + splat_u8(1);
            low = enough(low, above);
            if low == high {
                return (high, counts);
            }
            let below = max_u8x4(sub_saturating_u8x4(probes, splat_u8(1)), low);
            probes = enough(below, min_u8x4(above, high));
        }
    }
}

/// Writes the differences of all cells: the larger of those of two neighbouring synapses' samples.
/// Returns `None` if a sample is not within the levels.
#[inline(always)]
fn compare<const CHANNELS: usize>(block: &mut MaskBlock<'_>) -> Option<()> {
    let mut levels = [&[][..]; CHANNELS];
    for (levels, channel) in levels.iter_mut().zip(block.levels) {
        *levels = channel;
    }
    let columns = block.cells.as_chunks_mut::<LANES>().0.as_chunks_mut().0;
    let cells = columns.as_chunks_mut::<WORDS>().0;
    for group in 0..WORDS / GROUP {
        let shift = group * GROUP * LANES;
        let mut centres = [[0; GROUP]; CHANNELS];
        for (centre, levels) in centres.iter_mut().zip(levels) {
            *centre = run_at(levels, block.centre + shift)?.map(|four| load(&four));
        }
        let first = block.first + shift;
        // Backwards, because a synapse's partner is the one after it; two at a time, so that
        // few values have to be moved to another register.
        let mut partner = differences(&levels, &centres, first, *block.starts.first()?)?;
        let bytes = cells
            .iter_mut()
            .zip(block.starts.as_chunks::<CELLS_PER_BYTE>().0);
        for (columns, starts) in bytes.rev() {
            let columns: &mut [Column; GROUP] = columns.as_chunks_mut().0.get_mut(group)?;
            for (cell, starts) in starts.as_chunks::<2>().0.iter().enumerate().rev() {
                for (cell, start) in [(2 * cell + 1, starts[1]), (2 * cell, starts[0])] {
                    partner = if CHANNELS == 1 {
                        let first = start as usize + first;
                        one_channel::write_larger(
                            columns,
                            cell,
                            &centres[0],
                            levels[0],
                            first,
                            partner,
                        )?
                    } else {
                        let own = differences(&levels, &centres, first, start)?;
                        write_larger(columns, cell, &own, &partner);
                        own
                    };
                }
            }
        }
    }
    Some(())
}

/// Returns the differences of a synapse's samples from their centre pixels, summed over the
/// channels.
#[inline(always)]
fn differences<const CHANNELS: usize>(
    levels: &[&[u8]; CHANNELS],
    centres: &[Group; CHANNELS],
    first: usize,
    start: u32,
) -> Option<Group> {
    let mut sums = [0; GROUP];
    for (centre, levels) in centres.iter().zip(levels) {
        let samples = run_at(levels, start as usize + first)?;
        for ((sum, &centre), sample) in sums.iter_mut().zip(centre).zip(samples) {
            let difference = distance_u8x4(centre, load(sample));
            *sum = if CHANNELS == 1 {
                difference
            } else {
                add_saturating_u8x4(*sum, difference)
            };
        }
    }
    Some(sums)
}

/// Returns the levels of a group's pixels.
#[inline(always)]
fn run_at(levels: &[u8], start: usize) -> Option<&[[u8; LANES]; GROUP]> {
    levels.get(start..)?.as_chunks().0.first_chunk()
}

/// Writes the larger values of two groups as the differences of a cell.
#[inline(always)]
fn write_larger(columns: &mut [Column; GROUP], cell: usize, a: &Group, b: &Group) {
    for ((column, &a), &b) in columns.iter_mut().zip(a).zip(b) {
        // The remainder changes nothing, but shows the compiler that the index is in range.
        store(max_u8x4(a, b), &mut column[cell % CELLS_PER_BYTE]);
    }
}

/// The same as [`differences`] and [`write_larger`], in registers: the compiler does not find enough for both.
#[cfg(dsp_extension)]
#[allow(unsafe_code)]
mod one_channel {
    use core::arch::asm;

    use super::{Column, GROUP, Group, LANES};
    use vgstereo_core::kernel::CELLS_PER_BYTE;

    /// Writes the differences of a cell: the larger of those of its samples, of which the first is `first` of the
    /// levels, from the centre pixels and of its partner. Returns the former, or `None` if a sample is not within the
    /// levels.
    #[inline(always)]
    pub(super) fn write_larger(
        columns: &mut [Column; GROUP],
        cell: usize,
        centres: &Group,
        levels: &[u8],
        first: usize,
        [a, b, c, d]: Group,
    ) -> Option<Group> {
        // One comparison, where that of a slice takes two.
        if first > levels.len().checked_sub(GROUP * LANES)? {
            return None;
        }
        let samples = levels.as_ptr().wrapping_add(first);
        let (own_a, own_b, own_c, own_d);
        let written = columns
            .as_mut_ptr()
            .cast::<u32>()
            .wrapping_add(cell % CELLS_PER_BYTE);
        // SAFETY: the words are those of the samples, which are within the levels, and of the cell in each column.
        unsafe {
            asm!(
                // A register that has been used is that of the next difference.
                "ldr {own}, [{samples}]",
                "uqsub8 {less}, {centre_a}, {own}",
                "uqsub8 {own}, {own}, {centre_a}",
                "orr {own}, {own}, {less}",
                "uqsub8 {less}, {a}, {own}",
                "add {less}, {less}, {own}",
                "str {less}, [{written}]",
                "ldr {a}, [{samples}, #4]",
                "uqsub8 {less}, {centre_b}, {a}",
                "uqsub8 {a}, {a}, {centre_b}",
                "orr {a}, {a}, {less}",
                "uqsub8 {less}, {b}, {a}",
                "add {less}, {less}, {a}",
                "str {less}, [{written}, #{column}]",
                "ldr {b}, [{samples}, #8]",
                "uqsub8 {less}, {centre_c}, {b}",
                "uqsub8 {b}, {b}, {centre_c}",
                "orr {b}, {b}, {less}",
                "uqsub8 {less}, {c}, {b}",
                "add {less}, {less}, {b}",
                "str {less}, [{written}, #2 * {column}]",
                "ldr {c}, [{samples}, #12]",
                "uqsub8 {less}, {centre_d}, {c}",
                "uqsub8 {c}, {c}, {centre_d}",
                "orr {c}, {c}, {less}",
                "uqsub8 {less}, {d}, {c}",
                "add {less}, {less}, {c}",
                "str {less}, [{written}, #3 * {column}]",
                samples = in(reg) samples, written = in(reg) written,
                centre_a = in(reg) centres[0], centre_b = in(reg) centres[1],
                centre_c = in(reg) centres[2], centre_d = in(reg) centres[3],
                own = out(reg) own_a, a = inout(reg) a => own_b, b = inout(reg) b => own_c,
                c = inout(reg) c => own_d, d = in(reg) d, less = out(reg) _,
                column = const size_of::<Column>(),
                options(nostack, preserves_flags),
            );
        }
        Some([own_a, own_b, own_c, own_d])
    }
}

/// The same in plain code.
#[cfg(not(dsp_extension))]
mod one_channel {
    use super::{Column, GROUP, Group, run_at};
    use crate::armv7em::simd::{distance_u8x4, load};
    use core::array::from_fn;

    pub(super) fn write_larger(
        columns: &mut [Column; GROUP],
        cell: usize,
        centres: &Group,
        levels: &[u8],
        first: usize,
        partner: Group,
    ) -> Option<Group> {
        let samples = run_at(levels, first)?;
        let own = from_fn(|word| distance_u8x4(centres[word], load(&samples[word])));
        super::write_larger(columns, cell, &own, &partner);
        Some(own)
    }
}

/// Counts the cells of each of four pixels whose difference is within the pixel's threshold.
#[inline(always)]
fn count_within(cells: &[[impl Cells; WORDS]], word: usize, thresholds: u32) -> Halfwords {
    // The remainder changes nothing, but shows the compiler that the index is below `WORDS`.
    let word = word % WORDS;
    let mut counts = [0; 2];
    for counted in cells.chunks(COUNTED) {
        let mut four = 0;
        for columns in counted {
            columns[word].each_reversed(|differences| {
                four += is_ge_u8x4(thresholds, differences);
            });
        }
        let [even, odd] = counts;
        counts = [add_even_bytes(even, four), add_odd_bytes(odd, four)];
    }
    counts
}

/// Writes the masks of four pixels: one bit per cell, set if its difference is within the
/// threshold.
#[inline(never)]
fn write_masks(cells: &[[impl Cells; WORDS]], word: usize, thresholds: u32, masks: &mut [Row]) {
    let word = word % WORDS;
    for (mask, columns) in masks.iter_mut().zip(cells) {
        let mut bits = 0;
        columns[word].each_reversed(|differences| {
            bits = bits << 1 | is_ge_u8x4(thresholds, differences);
        });
        store(bits, &mut mask[word]);
    }
}
