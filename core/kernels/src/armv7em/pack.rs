//! Minchinton cells of four pixels at once.

use vgstereo_core::kernel::{CELLS_PER_BYTE, pack_cells as portable};

use super::simd::{halve_difference_u8x4, in_order, load, store};

/// Number of samples that form a byte of cells.
const SAMPLES: usize = CELLS_PER_BYTE + 1;

/// Top bit of each byte.
const TOP_BITS: u32 = 0x8080_8080;

/// Forms eight cells for each neuron of a run, as [`portable`] does.
// Not inlined, so that all of a processor's registers are its own.
#[inline(never)]
pub(super) fn pack_cells(samples: &[&[u8]; SAMPLES], packed: &mut [u8]) {
    let common = samples.iter().fold(packed.len(), |n, row| n.min(row.len()));
    let quads = samples.map(|row| row.get(..common).unwrap_or_default().as_chunks().0);
    let (packed, _) = packed.split_at_mut(common);
    let (packed, rest) = packed.as_chunks_mut();
    let [a, b, c, d, e, f, g, h, i] = quads.map(<[_]>::iter);
    let neurons = a.zip(b).zip(c).zip(d).zip(e).zip(f).zip(g).zip(h).zip(i);
    for (packed, ((((((((first, b), c), d), e), f), g), h), i)) in packed.iter_mut().zip(neurons) {
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
    if rest.is_empty() {
        return;
    }
    let first = common - rest.len();
    portable(
        &samples.map(|row| row.get(first..).unwrap_or_default()),
        rest,
    );
}
