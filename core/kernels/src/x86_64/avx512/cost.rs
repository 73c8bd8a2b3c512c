//! Matching costs in AVX-512.

use core::arch::x86_64::{
    __m512i as Register, _mm_loadu_si128, _mm512_add_epi16 as add_words,
    _mm512_add_epi32 as add_doubles, _mm512_adds_epu8 as add_saturating, _mm512_and_si512 as and,
    _mm512_castsi128_si512, _mm512_inserti32x4, _mm512_loadu_si512, _mm512_mask_storeu_epi8,
    _mm512_maskz_loadu_epi8, _mm512_min_epu8 as least_bytes, _mm512_mullo_epi16 as multiply,
    _mm512_or_si512 as or, _mm512_packus_epi16, _mm512_packus_epi32, _mm512_permutex2var_epi8,
    _mm512_permutexvar_epi8, _mm512_permutexvar_epi32, _mm512_popcnt_epi32 as popcount,
    _mm512_set1_epi8 as broadcast_byte, _mm512_set1_epi16 as broadcast_word,
    _mm512_set1_epi32 as broadcast_double, _mm512_setr_epi32, _mm512_setzero_si512 as zero,
    _mm512_srli_epi16 as shift_right, _mm512_storeu_si512, _mm512_subs_epu8 as subtract_saturating,
    _mm512_xor_si512 as xor,
};
use core::cell::Cell;
use std::vec::Vec;

use vgstereo_core::kernel::{self, CostRun, Planes, cost_stride};

use super::mask_of;
use crate::x86_64::cost::{
    SUMS, beyond, cost_in_registers, difference_costs, is_inside, sums_fit_bytes,
};

/// Number of disparities compared at once.
const LANES: usize = 64;

/// Number of pixels handled together: they share the loads of the other view's patterns, which
/// straddle cache lines.
const GROUP: usize = 4;

/// Number of planes whose bytes a double word joins.
const PLANES: usize = 4;
/// Double words per register.
const DOUBLES: usize = LANES / PLANES;

cost_in_registers!("avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq");

std::thread_local! {
    /// Scratch of a thread: the patterns of a run.
    static DOUBLE_WORDS: Cell<Vec<u32>> = const { Cell::new(Vec::new()) };
}

/// Patterns of a run, with the bytes of four planes joined to a double word: broadcasting a byte to
/// a register takes an instruction of its own, but a double word is broadcast as it is loaded.
struct Patterns {
    /// Patterns of the other view from the last pixel's lowest disparity on, then those of the
    /// reference view, then the masks.
    doubles: Vec<u32>,
    /// Double words per pattern.
    count: usize,
    positions: usize,
    pixels: usize,
}

impl Patterns {
    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq")]
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

    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq")]
    #[inline]
    fn differing_cells<const MASKED: bool, const REGISTERS: usize, const PIXELS: usize>(
        &self,
        x: usize,
        start: usize,
        _lanes: usize,
    ) -> [[[Register; 2]; PIXELS]; REGISTERS] {
        let mut sums = [[[zero(); PLANES]; PIXELS]; REGISTERS];
        let inputs = self.count * self.positions;
        let masks = inputs + self.count * self.pixels;
        let first = self.pixels - PIXELS - x + start;
        for quad in 0..self.count {
            let at = quad * self.pixels + x;
            let mut own = [[zero(); 2]; PIXELS];
            for (own, pixel) in own.iter_mut().zip(0..) {
                for (own, start) in own.iter_mut().zip([inputs, masks]) {
                    // SAFETY: the run has `PIXELS` pixels from `x` on.
                    let double = unsafe { *self.doubles.get_unchecked(start + at + pixel) };
                    *own = broadcast_double(double.cast_signed());
                }
            }
            let at = quad * self.positions + first;
            for (register, sums) in sums.iter_mut().enumerate() {
                for part in 0..PLANES {
                    let at = at + register * LANES + part * DOUBLES;
                    // SAFETY: `new` has made room for whole registers at every pixel.
                    let stored =
                        unsafe { _mm512_loadu_si512(self.doubles.as_ptr().add(at).cast()) };
                    for (sums, [input, mask]) in sums.iter_mut().zip(own) {
                        let mut differing = xor(input, stored);
                        if MASKED {
                            differing = and(differing, mask);
                        }
                        sums[part] = add_doubles(sums[part], popcount(differing));
                    }
                }
            }
        }
        let mut words = [[[zero(); 2]; PIXELS]; REGISTERS];
        for (words, sums) in words.iter_mut().zip(sums) {
            for (words, [a, b, c, d]) in words.iter_mut().zip(sums) {
                *words = [_mm512_packus_epi32(a, b), _mm512_packus_epi32(c, d)];
            }
        }
        words
    }
}

/// Moves the lanes from `place` on to the front, and those before it to the end.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq")]
#[inline]
fn lanes_from(register: Register, place: usize) -> Register {
    if place == 0 {
        return register;
    }
    static PLACES: [u8; 2 * LANES] = {
        let mut places = [0; 2 * LANES];
        let mut place = 0;
        while place < places.len() {
            places[place] = (place % LANES) as u8;
            place += 1;
        }
        places
    };
    // SAFETY: the table has `LANES` bytes from every place on.
    let places = unsafe { load(&PLACES, place % LANES, LANES) };
    _mm512_permutexvar_epi8(places, register)
}

impl Drop for Patterns {
    fn drop(&mut self) {
        DOUBLE_WORDS.set(core::mem::take(&mut self.doubles));
    }
}

/// Writes the patterns from position `first` on, with the bytes of planes `PLANES * quad` and the
/// three after it joined to double words. Bytes of planes that do not exist are 0; does nothing if
/// none of the four exists.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq")]
#[inline]
fn put_side_by_side(planes: Planes<'_>, quad: usize, first: usize, doubles: &mut [u32]) {
    let count = planes.count.saturating_sub(PLANES * quad).min(PLANES);
    let Some(last) = count.checked_sub(1) else {
        return;
    };
    let length = doubles.len();
    let row = |plane: usize| {
        let at = (PLANES * quad + plane.min(last)) * planes.stride + first;
        &planes.bytes[at..at + length]
    };
    let (a, b, c, d) = (row(0), row(1), row(2), row(3));
    let there = u32::MAX >> (8 * (PLANES - count));
    if length < DOUBLES {
        let rows = a.iter().zip(b).zip(c).zip(d);
        for (double, (((&a, &b), &c), &d)) in doubles.iter_mut().zip(rows) {
            *double = u32::from_le_bytes([a, b, c, d]) & there;
        }
        return;
    }
    let there = broadcast_double(there.cast_signed());
    // The last block overlaps the one before it, so that nothing remains.
    if let (Some(a), Some(b), Some(c), Some(d)) = (
        a.last_chunk(),
        b.last_chunk(),
        c.last_chunk(),
        d.last_chunk(),
    ) && let Some(doubles) = doubles.last_chunk_mut()
    {
        put_block([a, b, c, d], there, doubles);
    }
    let (a, b, c, d) = (
        a.as_chunks().0,
        b.as_chunks().0,
        c.as_chunks().0,
        d.as_chunks().0,
    );
    let blocks = a.iter().zip(b).zip(c).zip(d);
    for (doubles, (((a, b), c), d)) in doubles.as_chunks_mut().0.iter_mut().zip(blocks) {
        put_block([a, b, c, d], there, doubles);
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq")]
#[inline]
fn put_block(
    [a, b, c, d]: [&[u8; DOUBLES]; PLANES],
    there: Register,
    doubles: &mut [u32; DOUBLES],
) {
    let turned = _mm512_setr_epi32(
        0x3020_1000,
        0x3121_1101,
        0x3222_1202,
        0x3323_1303, //
        0x3424_1404,
        0x3525_1505,
        0x3626_1606,
        0x3727_1707, //
        0x3828_1808,
        0x3929_1909,
        0x3a2a_1a0a,
        0x3b2b_1b0b, //
        0x3c2c_1c0c,
        0x3d2d_1d0d,
        0x3e2e_1e0e,
        0x3f2f_1f0f,
    );
    // SAFETY: each array has a register's 16 bytes; loads need no alignment.
    let [a, b, c, d] = [a, b, c, d].map(|row| unsafe { _mm_loadu_si128(row.as_ptr().cast()) });
    let bytes = _mm512_inserti32x4::<1>(_mm512_castsi128_si512(a), b);
    let bytes = _mm512_inserti32x4::<2>(bytes, c);
    let bytes = _mm512_inserti32x4::<3>(bytes, d);
    let bytes = and(_mm512_permutexvar_epi8(turned, bytes), there);
    // SAFETY: the array has the register's 64 bytes; the store needs no alignment.
    unsafe { _mm512_storeu_si512(doubles.as_mut_ptr().cast(), bytes) };
}

/// Cost of each sum of level differences: the first half of the table and the second.
struct Differences([Register; 2]);

impl Differences {
    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq")]
    #[inline]
    fn new(row: &CostRun<'_>) -> Self {
        let costs = difference_costs(row);
        // SAFETY: both registers are within the table.
        Self([0, LANES].map(|start| unsafe { load(&costs, start, LANES) }))
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi,avx512vpopcntdq")]
    #[inline]
    fn costs(&self, sums: Register) -> Register {
        let sums = least_bytes(sums, broadcast_byte((SUMS - 1) as i8));
        _mm512_permutex2var_epi8(self.0[0], sums, self.0[1])
    }
}

/// Narrows words to bytes, at most 255, in the order of the disparities. `low` alternates between
/// quarters of the first and the second 16 disparities, `high` likewise between those of the
/// others.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
fn pack(low: Register, high: Register) -> Register {
    let order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
    _mm512_permutexvar_epi32(order, _mm512_packus_epi16(low, high))
}

/// Loads the first `lanes` bytes from `start` on; the others are 0.
///
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
