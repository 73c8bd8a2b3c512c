//! Minchinton cells of four pixels to a register.

use vgstereo_core::kernel::{self, CELLS_PER_BYTE};

use crate::xpulp::{greater_u8x4, sub_u8x4};

/// Number of samples that form a byte of cells.
const SAMPLES: usize = CELLS_PER_BYTE + 1;

/// Pixels whose loop is unrolled, as words.
const BLOCK: usize = 4;

/// Equals [`kernel::pack_cells`] bit for bit.
#[inline(never)]
pub(super) fn pack_cells(samples: &[&[u8]; SAMPLES], packed: &mut [u8]) {
    let common = samples.iter().fold(packed.len(), |n, row| n.min(row.len()));
    let blocks = samples.map(|row| {
        let row = row.get(..common).unwrap_or_default();
        row.as_chunks::<4>().0.as_chunks::<BLOCK>().0
    });
    let (packed, _) = packed.split_at_mut(common);
    let (words, _) = packed.as_chunks_mut::<4>();
    let [a, b, c, d, e, f, g, h, i] = blocks.map(<[_]>::iter);
    let pixels = a.zip(b).zip(c).zip(d).zip(e).zip(f).zip(g).zip(h).zip(i);
    let mut done = 0;
    for (packed, ((((((((a, b), c), d), e), f), g), h), i)) in
        words.as_chunks_mut::<BLOCK>().0.iter_mut().zip(pixels)
    {
        // Not by a closure, which the compiler would not inline so often.
        macro_rules! pack {
            ($($word:literal)+) => {
                $(packed[$word] = cells([a, b, c, d, e, f, g, h, i].map(|row| &row[$word]));)+
            };
        }
        pack!(0 1 2 3);
        done += 4 * BLOCK;
    }
    kernel::pack_cells(
        &samples.map(|row| row.get(done..).unwrap_or_default()),
        packed.get_mut(done..).unwrap_or_default(),
    );
}

/// The cells of four pixels.
#[inline(always)]
fn cells(samples: [&[u8; 4]; SAMPLES]) -> [u8; 4] {
    let [first, .., mut partner] = samples.map(|bytes| u32::from_le_bytes(*bytes));
    let mut cells = 0;
    // The last cell first: each is doubled by those before it.
    for &own in samples[1..CELLS_PER_BYTE].iter().rev() {
        let own = u32::from_le_bytes(*own);
        // A cell is all bits of a byte, which is -1. No byte carries.
        cells = sub_u8x4(cells << 1, greater_u8x4(own, partner));
        partner = own;
    }
    sub_u8x4(cells << 1, greater_u8x4(first, partner)).to_le_bytes()
}
