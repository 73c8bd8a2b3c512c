//! Minchinton cells of four pixels to a register.

use bytemuck::try_cast_slice_mut;
use vgstereo_core::kernel::{self, CELLS_PER_BYTE};

use super::instructions::greater;
use super::quads::{Quads, join_all};

/// Number of samples that form a byte of cells.
const SAMPLES: usize = CELLS_PER_BYTE + 1;

/// Words whose cells are formed side by side, and their pixels.
const BLOCK: usize = 4;
const BLOCK_PX: usize = 4 * BLOCK;

/// Equals [`kernel::pack_cells`] bit for bit.
#[inline(never)]
pub(super) fn pack_cells(samples: &[&[u8]; SAMPLES], packed: &mut [u8]) {
    let common = samples.iter().fold(packed.len(), |n, row| n.min(row.len()));
    let rows = samples.map(|row| Quads::new(row.get(..common).unwrap_or_default()));
    let words = rows.map(|row| row.words.as_chunks::<BLOCK>().0);
    let mut left = rows.map(|row| row.left);
    let count = words.iter().fold(usize::MAX, |n, row| n.min(row.len()));
    let (blocks, rest) = packed
        .split_at_mut_checked(BLOCK_PX * count)
        .unwrap_or_default();
    for (block, packed) in blocks.chunks_exact_mut(BLOCK_PX).enumerate() {
        let (mut own, mut cells) = ([0; BLOCK], [0; BLOCK]);
        macro_rules! compare {
            ($($sample:literal)+) => {
                $(let Some(&quads) = words[$sample].get(block) else {
                    return;
                };
                let partner = join_all(&mut left[$sample], quads);
                if $sample > 0 {
                    for ((cells, own), partner) in cells.iter_mut().zip(own).zip(partner) {
                        *cells |= greater::<{ ($sample + 7) % 8 }>(own, partner);
                    }
                }
                own = partner;)+
            };
        }
        compare!(0 1 2 3 4 5 6 7 8);
        // The last sample has no partner.
        let _ = own;
        store(cells, packed);
    }
    let first = BLOCK_PX * count;
    kernel::pack_cells(
        &samples.map(|row| row.get(first..).unwrap_or_default()),
        rest,
    );
}

/// Stores words, as such where their place is aligned.
#[inline(always)]
fn store(words: [u32; BLOCK], bytes: &mut [u8]) {
    let places: Result<&mut [u32], _> = try_cast_slice_mut(bytes);
    if let Ok(places) = places {
        for (place, word) in places.iter_mut().zip(words) {
            *place = word;
        }
        return;
    }
    for (place, word) in bytes.as_chunks_mut().0.iter_mut().zip(words) {
        *place = word.to_le_bytes();
    }
}
