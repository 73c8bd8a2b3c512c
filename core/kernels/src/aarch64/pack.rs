//! Minchinton cells of 16 pixels at once: one comparison and one insertion per sample.

use core::arch::aarch64::{uint8x16_t, vcgtq_u8, vdupq_n_u8, vld1q_u8, vsriq_n_u8, vst1q_u8};

use vgstereo_core::kernel::{self, CELLS_PER_BYTE};

/// Bytes per register.
const LANES: usize = 16;

/// Forms eight cells for each neuron of a run, as [`kernel::pack_cells`] does.
pub(super) fn pack_cells(samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
    let common = samples.iter().fold(packed.len(), |n, row| n.min(row.len()));
    let blocks = samples.map(|row| row.get(..common).unwrap_or_default().as_chunks().0);
    let (packed, _) = packed.split_at_mut(common);
    let (packed, rest) = packed.as_chunks_mut();
    let [a, b, c, d, e, f, g, h, i] = blocks.map(<[_]>::iter);
    let neurons = a.zip(b).zip(c).zip(d).zip(e).zip(f).zip(g).zip(h).zip(i);
    for (packed, ((((((((first, b), c), d), e), f), g), h), i)) in packed.iter_mut().zip(neurons) {
        pack_block(first, [b, c, d, e, f, g, h, i], packed);
    }
    if rest.is_empty() {
        return;
    }
    let first = common - rest.len();
    let samples = samples.map(|row| row.get(first..).unwrap_or_default());
    kernel::pack_cells(&samples, rest);
}

/// Forms the cells of [`LANES`] neurons.
#[inline(always)]
fn pack_block(
    first: &[u8; LANES],
    partners: [&[u8; LANES]; CELLS_PER_BYTE],
    packed: &mut [u8; LANES],
) {
    // SAFETY: this module is compiled only for targets with Neon; see the crate's root.
    let mut cells = unsafe { vdupq_n_u8(0) };
    let mut own = load(first);
    for partner in partners {
        let partner = load(partner);
        // SAFETY: this module is compiled only for targets with Neon.
        cells = unsafe {
            // The cells so far move down by one bit; the new cell becomes the top bit.
            vsriq_n_u8::<1>(vcgtq_u8(own, partner), cells)
        };
        own = partner;
    }
    // SAFETY: the array has the register's 16 bytes; the store needs no alignment.
    unsafe { vst1q_u8(packed.as_mut_ptr(), cells) };
}

#[inline(always)]
fn load(bytes: &[u8; LANES]) -> uint8x16_t {
    // SAFETY: the array has the register's 16 bytes; the load needs no alignment.
    unsafe { vld1q_u8(bytes.as_ptr()) }
}
