//! Packing: eight Minchinton cells of each neuron of a run, one bit each.

/// Cells per byte of a packed pattern.
pub const CELLS_PER_BYTE: usize = 8;

/// Forms eight Minchinton cells for each neuron of a run: bit `k` of `packed[i]` is 1 if
/// `samples[k][i] > samples[k + 1][i]`, else 0 (paper, Section III).
///
/// `samples` has one row per synapse, with one sample per neuron; the ninth row is the first of the
/// next byte. If rows are shorter than `packed`, only the common length is written.
#[inline(always)]
pub fn pack_cells(samples: &[&[u8]; CELLS_PER_BYTE + 1], packed: &mut [u8]) {
    let [a, b, c, d, e, f, g, h, i] = *samples;
    let common = samples.iter().fold(packed.len(), |n, row| n.min(row.len()));
    // Equal lengths, proven once: no check is left in the loop.
    let (a, b, c) = (&a[..common], &b[..common], &c[..common]);
    let (d, e, f) = (&d[..common], &e[..common], &f[..common]);
    let (g, h, i) = (&g[..common], &h[..common], &i[..common]);
    let packed = &mut packed[..common];
    let bit = |own: u8, partner: u8, place: u32| u8::from(own > partner) << place;
    for x in 0..common {
        packed[x] = bit(a[x], b[x], 0)
            | bit(b[x], c[x], 1)
            | bit(c[x], d[x], 2)
            | bit(d[x], e[x], 3)
            | bit(e[x], f[x], 4)
            | bit(f[x], g[x], 5)
            | bit(g[x], h[x], 6)
            | bit(h[x], i[x], 7);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_one_where_its_sample_is_the_greater() {
        // Two neurons: in the first, every sample is greater than the next; in the second, every
        // other one is.
        let rows: [[u8; 2]; 9] = core::array::from_fn(|k| [90 - k as u8, 5 + (k as u8 + 1) % 2]);
        let samples = core::array::from_fn(|k| &rows[k][..]);
        let mut packed = [7; 3];
        pack_cells(&samples, &mut packed);
        assert_eq!(packed, [0b1111_1111, 0b0101_0101, 7]);
        // Equal samples give cells of 0.
        pack_cells(&[&[4; 3]; 9], &mut packed);
        assert_eq!(packed, [0; 3]);
    }
}
