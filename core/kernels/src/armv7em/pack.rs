//! Minchinton cells of four pixels at once.

use vgstereo_core::kernel::CELLS_PER_BYTE;

use super::simd::in_order;

/// Neurons to a word.
const QUAD: usize = 4;

/// Number of samples that form a byte of cells.
const SAMPLES: usize = CELLS_PER_BYTE + 1;

/// Forms eight cells for each neuron of a run, as
/// [`pack_cells`](vgstereo_core::kernel::pack_cells) does.
pub(super) fn pack_cells(samples: &[&[u8]; SAMPLES], packed: &mut [u8]) {
    if !quads::pack(samples, packed) {
        pack_few(samples, packed);
    }
}

/// The same for a few neurons, in little code.
#[inline(never)]
fn pack_few(samples: &[&[u8]; SAMPLES], packed: &mut [u8]) {
    // How many they are is hidden from the compiler, which would write the loop out.
    let rows = samples.get(..in_order(SAMPLES as u32) as usize);
    let rows = rows.unwrap_or_default();
    for (x, packed) in packed.iter_mut().enumerate() {
        let (mut cells, mut own) = (0, 0);
        for row in rows {
            let Some(&partner) = row.get(x) else { return };
            // What is shifted in at the first is shifted out at the last.
            cells = in_order(cells >> 1 | u32::from(own > partner) << (CELLS_PER_BYTE - 1));
            own = partner;
        }
        *packed = cells as u8;
    }
}

/// The loop over words as instructions: there are just enough registers.
#[cfg(dsp_extension)]
#[allow(unsafe_code)]
mod quads {
    use core::arch::asm;

    use super::{QUAD, SAMPLES};

    /// Packs the cells of the neurons that all rows have, if they are at least four; returns whether they are. The
    /// second word overlaps the first, so that nothing remains.
    // Not inlined, so that all of a processor's registers are its own.
    #[inline(never)]
    pub(super) fn pack(samples: &[&[u8]; SAMPLES], packed: &mut [u8]) -> bool {
        let count = samples.iter().fold(packed.len(), |n, row| n.min(row.len()));
        if count < QUAD {
            return false;
        }
        let packed = packed.as_mut_ptr();
        let first = if count.is_multiple_of(QUAD) {
            count
        } else {
            QUAD
        };
        let (mut start, mut stop) = (packed, first);
        // Seen from the packed cells, samples are always as far away.
        let [a, b, c, d, e, f, g, h, i] = samples.map(|row| {
            let start = row.as_ptr().expose_provenance();
            start.wrapping_sub(packed.addr())
        });
        loop {
            // SAFETY: the addresses are within the rows, of which all have `count` bytes. The stack is as it was.
            unsafe {
                asm!(
                    "push {{{own}}}",
                    "2:",
                    "ldr {own}, [{packed}, {a}]",
                    "ldr {partner}, [{packed}, {b}]",
                    // The difference is negative, and its top bit set, if the synapse's own sample is greater.
                    "uhsub8 {own}, {partner}, {own}",
                    "bic {cells}, {own}, #0x7f7f7f7f",
                    "ldr {own}, [{packed}, {c}]",
                    "uhsub8 {partner}, {own}, {partner}",
                    "bic {partner}, {partner}, #0x7f7f7f7f",
                    "orr {cells}, {partner}, {cells}, lsr #1",
                    "ldr {partner}, [{packed}, {d}]",
                    "uhsub8 {own}, {partner}, {own}",
                    "bic {own}, {own}, #0x7f7f7f7f",
                    "orr {cells}, {own}, {cells}, lsr #1",
                    "ldr {own}, [{packed}, {e}]",
                    "uhsub8 {partner}, {own}, {partner}",
                    "bic {partner}, {partner}, #0x7f7f7f7f",
                    "orr {cells}, {partner}, {cells}, lsr #1",
                    "ldr {partner}, [{packed}, {f}]",
                    "uhsub8 {own}, {partner}, {own}",
                    "bic {own}, {own}, #0x7f7f7f7f",
                    "orr {cells}, {own}, {cells}, lsr #1",
                    "ldr {own}, [{packed}, {g}]",
                    "uhsub8 {partner}, {own}, {partner}",
                    "bic {partner}, {partner}, #0x7f7f7f7f",
                    "orr {cells}, {partner}, {cells}, lsr #1",
                    "ldr {partner}, [{packed}, {h}]",
                    "uhsub8 {own}, {partner}, {own}",
                    "bic {own}, {own}, #0x7f7f7f7f",
                    "orr {cells}, {own}, {cells}, lsr #1",
                    "ldr {own}, [{packed}, {i}]",
                    "uhsub8 {partner}, {own}, {partner}",
                    "bic {partner}, {partner}, #0x7f7f7f7f",
                    "orr {cells}, {partner}, {cells}, lsr #1",
                    "str {cells}, [{packed}], #4",
                    "ldr {own}, [sp]",
                    "cmp {packed}, {own}",
                    "bne 2b",
                    "add sp, #4",
                    a = in(reg) a, b = in(reg) b, c = in(reg) c, d = in(reg) d, e = in(reg) e,
                    f = in(reg) f, g = in(reg) g, h = in(reg) h, i = in(reg) i,
                    packed = inout(reg) start => _, own = inout(reg) packed.wrapping_add(stop) => _,
                    partner = out(reg) _, cells = out(reg) _,
                );
            }
            if stop == count {
                return true;
            }
            (start, stop) = (packed.wrapping_add(count % QUAD), count);
        }
    }
}

/// The same in plain code, to which the assembly is held.
#[cfg(not(dsp_extension))]
mod quads {
    use vgstereo_core::kernel::pack_cells as portable;

    use super::{QUAD, SAMPLES};
    use crate::armv7em::simd::{halve_difference_u8x4, in_order, load, store};

    /// Top bit of each byte.
    const TOP_BITS: u32 = 0x8080_8080;

    #[inline(never)]
    pub(super) fn pack(samples: &[&[u8]; SAMPLES], packed: &mut [u8]) -> bool {
        let common = samples.iter().fold(packed.len(), |n, row| n.min(row.len()));
        if common < QUAD {
            return false;
        }
        let quads = samples.map(|row| row.get(..common).unwrap_or_default().as_chunks().0);
        let (packed, _) = packed.split_at_mut(common);
        let (packed, rest) = packed.as_chunks_mut();
        let [a, b, c, d, e, f, g, h, i] = quads.map(<[_]>::iter);
        let neurons = a.zip(b).zip(c).zip(d).zip(e).zip(f).zip(g).zip(h).zip(i);
        for (packed, ((((((((first, b), c), d), e), f), g), h), i)) in
            packed.iter_mut().zip(neurons)
        {
            let (mut cells, mut own) = (0, load(first));
            for partner in [b, c, d, e, f, g, h, i] {
                let partner = load(partner);
                // The difference is negative, and its top bit set, if the synapse's own sample is
                // greater.
                let cell = halve_difference_u8x4(partner, own) & TOP_BITS;
                cells = in_order(cells >> 1 | cell);
                own = partner;
            }
            store(cells, packed);
        }
        if !rest.is_empty() {
            let first = common - rest.len();
            portable(
                &samples.map(|row| row.get(first..).unwrap_or_default()),
                rest,
            );
        }
        true
    }
}
