//! Matching costs in AVX-512.

use std::arch::x86_64::{
    __m512i as Register, _mm512_add_epi16 as add_words, _mm512_add_epi32 as add_doubles,
    _mm512_and_si512 as and, _mm512_loadu_si512, _mm512_mask_storeu_epi8, _mm512_maskz_loadu_epi8,
    _mm512_min_epu16 as least_words, _mm512_mullo_epi16 as multiply, _mm512_or_si512 as or,
    _mm512_packus_epi16 as pack, _mm512_packus_epi32, _mm512_permutex2var_epi64,
    _mm512_popcnt_epi32 as popcount, _mm512_set1_epi8 as broadcast_byte,
    _mm512_set1_epi16 as broadcast_word, _mm512_set1_epi32 as broadcast_double, _mm512_setr_epi64,
    _mm512_setzero_si512 as zero, _mm512_srli_epi16 as shift_right,
    _mm512_subs_epu8 as subtract_saturating, _mm512_unpackhi_epi8 as unpack_high,
    _mm512_unpacklo_epi8 as unpack_low, _mm512_xor_si512 as xor,
};
use std::cell::Cell;

use vgstereo_core::matching::{self, CostRun, MAX_CHANNELS, cost_stride};
use vgstereo_core::minchinton::Planes;

use super::cost::{beyond, cost_in_registers, is_inside};

/// Disparities side by side.
const LANES: usize = 64;

/// Planes of a pattern in a double word.
const PLANES: usize = 4;
/// Double words of a register.
const DOUBLES: usize = LANES / PLANES;

cost_in_registers!("avx512f,avx512bw,avx512vl,avx512vpopcntdq");

thread_local! {
    /// Scratch of a thread: the patterns of a run.
    static DOUBLE_WORDS: Cell<Vec<u32>> = const { Cell::new(Vec::new()) };
}

/// The patterns of a run, four planes side by side: a byte of a pixel's pattern takes an
/// instruction to be spread over a register, a double word is loaded so.
struct Patterns {
    /// Of the other view, from the last pixel's lowest disparity on; then the inputs and the
    /// masks.
    doubles: Vec<u32>,
    /// Double words of each pattern.
    count: usize,
    positions: usize,
    pixels: usize,
}

impl Patterns {
    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vpopcntdq")]
    fn new(row: &CostRun<'_>) -> Self {
        let pixels = row.cell_costs_q8.len();
        let count = row.inputs.count.div_ceil(PLANES);
        let stride = cost_stride(row.disparities);
        // Registers are always loaded whole.
        let positions = pixels - 1 + stride.max(LANES);
        let mut doubles = DOUBLE_WORDS.take();
        let length = count * (positions + 2 * pixels);
        doubles.resize(length.max(doubles.len()), 0);
        let (stored, rest) = doubles.split_at_mut(count * positions);
        let (inputs, masks) = rest.split_at_mut(count * pixels);
        let first = row.first_position + 1 - pixels;
        for quad in 0..count {
            let stored = &mut stored[quad * positions..][..pixels - 1 + stride];
            put_side_by_side(row.stored, quad, first, stored);
            let inputs = &mut inputs[quad * pixels..][..pixels];
            put_side_by_side(row.inputs, quad, row.start, inputs);
            let masks = &mut masks[quad * pixels..][..pixels];
            put_side_by_side(row.masks, quad, 0, masks);
        }
        Self {
            doubles,
            count,
            positions,
            pixels,
        }
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vpopcntdq")]
    #[inline]
    fn differing_cells<const MASKED: bool, const REGISTERS: usize>(
        &self,
        x: usize,
        start: usize,
        _lanes: usize,
    ) -> [[Register; 2]; REGISTERS] {
        let mut sums = [[zero(); PLANES]; REGISTERS];
        let inputs = self.count * self.positions;
        let masks = inputs + self.count * self.pixels;
        let first = self.pixels - 1 - x + start;
        for quad in 0..self.count {
            let at = quad * self.pixels + x;
            // SAFETY: the run has pixel `x`.
            let [input, mask] = [inputs, masks]
                .map(|start| unsafe { *self.doubles.get_unchecked(start + at) })
                .map(|double| broadcast_double(double.cast_signed()));
            let at = quad * self.positions + first;
            for (register, sums) in sums.iter_mut().enumerate() {
                for (part, sum) in sums.iter_mut().enumerate() {
                    let at = at + register * LANES + part * DOUBLES;
                    // SAFETY: there are as many as registers need for every pixel.
                    let stored =
                        unsafe { _mm512_loadu_si512(self.doubles.as_ptr().add(at).cast()) };
                    let mut differing = xor(input, stored);
                    if MASKED {
                        differing = and(differing, mask);
                    }
                    *sum = add_doubles(*sum, popcount(differing));
                }
            }
        }
        sums.map(|[a, b, c, d]| {
            let (low, high) = (_mm512_packus_epi32(a, b), _mm512_packus_epi32(c, d));
            // Four words of each in turn; back in the order in which bytes are unpacked.
            let first = _mm512_setr_epi64(0, 2, 1, 3, 8, 10, 9, 11);
            let second = _mm512_setr_epi64(4, 6, 5, 7, 12, 14, 13, 15);
            [
                _mm512_permutex2var_epi64(low, first, high),
                _mm512_permutex2var_epi64(low, second, high),
            ]
        })
    }
}

impl Drop for Patterns {
    fn drop(&mut self) {
        DOUBLE_WORDS.set(std::mem::take(&mut self.doubles));
    }
}

/// Four planes from number `PLANES * quad` on, those that are there, from position `first`
/// on.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vpopcntdq")]
#[inline]
fn put_side_by_side(planes: Planes<'_>, quad: usize, first: usize, doubles: &mut [u32]) {
    let row = |plane: usize| {
        let at = (PLANES * quad + plane) * planes.stride + first;
        &planes.bytes[at..at + doubles.len()]
    };
    if PLANES * quad + PLANES <= planes.count {
        let rows = row(0).iter().zip(row(1)).zip(row(2)).zip(row(3));
        for (double, (((&a, &b), &c), &d)) in doubles.iter_mut().zip(rows) {
            *double = u32::from_le_bytes([a, b, c, d]);
        }
        return;
    }
    doubles.fill(0);
    for plane in 0..planes.count.saturating_sub(PLANES * quad) {
        let at = (PLANES * quad + plane) * planes.stride + first;
        for (double, &byte) in doubles.iter_mut().zip(&planes.bytes[at..]) {
            *double |= u32::from(byte) << (8 * plane);
        }
    }
}

/// Ones for the first lanes; there is at least one.
#[inline]
fn mask_of(lanes: usize) -> u64 {
    u64::MAX >> (LANES - lanes)
}

/// # Safety
/// The slice has `lanes` bytes from `start` on.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
unsafe fn load(bytes: &[u8], start: usize, lanes: usize) -> Register {
    // SAFETY: only these lanes are read, which the caller promises.
    unsafe { _mm512_maskz_loadu_epi8(mask_of(lanes), bytes.as_ptr().add(start).cast()) }
}

#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
fn store(bytes: &mut [u8], register: Register) {
    // SAFETY: only the lanes that the slice has are written.
    unsafe {
        _mm512_mask_storeu_epi8(bytes.as_mut_ptr().cast(), mask_of(bytes.len()), register);
    }
}
