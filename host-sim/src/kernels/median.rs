//! Weighted median in vector registers: pixels side by side, words for values and weights.
//!
//! The loops are the same for every instruction set; [`median_in_registers`] puts them
//! beside the registers' own operations.

/// A tap of `LANES` centres side by side. No load of it straddles two cache lines.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Tap<const LANES: usize> {
    pub values: [i16; LANES],
    pub weights: [i16; LANES],
}

impl<const LANES: usize> Tap<LANES> {
    pub const NONE: Self = Self {
        values: [0; LANES],
        weights: [0; LANES],
    };
}

/// Defines `weighted_median_row`, the same as core's and that itself for short rows.
///
/// A macro because a function cannot be compiled for the instruction set of its caller. It
/// takes from where it stands `Bytes` and `Words`, registers of `LANES` of them, and the
/// operations on them, by the names used here.
macro_rules! median_in_registers {
    ($features:literal) => {
        thread_local! {
            /// Scratch of a thread: the taps of the pixels that are filtered side by side.
            static TAPS: Cell<Vec<Tap<LANES>>> = const { Cell::new(Vec::new()) };
        }

        #[target_feature(enable = $features)]
        pub fn weighted_median_row(
            row: &WeightedMedianRow<'_>,
            weights: &mut [u8],
            output: &mut [i16],
        ) {
            let width = output.len();
            let taps = row.rows * row.tap_columns().len();
            if width < LANES || taps > row.places.len() || row.window_width == 0 {
                refine::weighted_median_row(row, weights, output);
                return;
            }
            let mut scratch = TAPS.take();
            scratch.resize(scratch.len().max(taps), Tap::NONE);
            let taps = &mut scratch[..taps];
            // The last block overlaps the one before rather than leave a rest.
            for x in (0..width).step_by(LANES) {
                let x = x.min(width - LANES);
                if let Some(output) = output[x..].first_chunk_mut() {
                    filter_block(row, x, taps, output);
                }
            }
            TAPS.set(scratch);
        }

        /// Filters the pixels from `x` on.
        #[target_feature(enable = $features)]
        #[inline]
        fn filter_block(
            row: &WeightedMedianRow<'_>,
            x: usize,
            taps: &mut [Tap<LANES>],
            output: &mut [i16; LANES],
        ) {
            // Grey counts as three equal channels.
            let [a, b, c] = if row.channels == 1 { [0; 3] } else { [0, 1, 2] };
            let run = x..x + row.window_width - 1 + LANES;
            let centre = |channel: usize| load_bytes(&row.centres[channel][x..x + LANES]);
            let centres = [centre(a), centre(b), centre(c)];
            let reach = broadcast(row.colour_reach.into());
            let invalid = broadcast(INVALID);
            let mut totals = broadcast(0);
            let mut low = broadcast(i16::MAX);
            let mut high = broadcast(i16::MIN);
            let mut count = 0;
            let columns = row.tap_columns().len();
            let rows = row.places.chunks_exact(columns).take(row.rows);
            for (index, places) in rows.enumerate() {
                let values = &row.values[index][run.clone()];
                let levels = |channel: usize| &row.levels[channel][index][run.clone()];
                let levels = [levels(a), levels(b), levels(c)];
                for (&place, column) in places.iter().zip((0..).step_by(2)) {
                    // SAFETY: a column is less than the window's width, which the runs are
                    // longer than by one less than a register.
                    let (values, levels) = unsafe {
                        let levels = [
                            load_bytes_at(levels[0], column),
                            load_bytes_at(levels[1], column),
                            load_bytes_at(levels[2], column),
                        ];
                        (load_words_at(values, column), levels)
                    };
                    // Cut off at 255, where nothing weighs any more.
                    let difference = difference(centres, levels);
                    let likeness = subtract_saturating(reach, difference);
                    let square = shift_right::<4>(multiply(likeness, likeness));
                    let weight = shift_right::<4>(multiply(square, broadcast(place.into())));
                    let weight = select(is_equal(values, invalid), broadcast(0), weight);
                    totals = add(totals, weight);
                    let is_nothing = is_equal(weight, broadcast(0));
                    low = least(low, select(is_nothing, low, values));
                    high = greatest(high, select(is_nothing, high, values));
                    // What weighs nothing anywhere is written over by the next.
                    if let Some(tap) = taps.get_mut(count) {
                        store_words(&mut tap.values, values);
                        store_words(&mut tap.weights, weight);
                    }
                    count += usize::from(!is_all(is_nothing));
                }
            }
            let taps = taps.get(..count).unwrap_or_default();
            // Bisection: the smallest value at or below which lies half of the weight.
            loop {
                let is_open = is_greater(high, low);
                if is_none(is_open) {
                    break;
                }
                // Rounded down, without overflow.
                let middle = add(and(low, high), shift_right_signed::<1>(xor(low, high)));
                // Where the search is open, this does not overflow.
                let next = add(middle, broadcast(1));
                // In four parts, so that not each waits for the one before.
                let mut parts = [broadcast(0); 4];
                let (groups, rest) = taps.as_chunks::<4>();
                for group in groups {
                    for (part, tap) in parts.iter_mut().zip(group) {
                        *part = add(*part, weight_below(tap, next));
                    }
                }
                for (part, tap) in parts.iter_mut().zip(rest) {
                    *part = add(*part, weight_below(tap, next));
                }
                let below = add(add(parts[0], parts[1]), add(parts[2], parts[3]));
                let is_below = at_least_unsigned(below, subtract(totals, below));
                high = select(is_open, select(is_below, middle, high), high);
                low = select(is_open, select(is_below, low, next), low);
            }
            let is_unknown = is_equal(totals, broadcast(0));
            store_words(output, select(is_unknown, invalid, low));
        }

        /// The weights of a tap where its value is less than another.
        #[target_feature(enable = $features)]
        #[inline]
        fn weight_below(tap: &Tap<LANES>, value: Words) -> Words {
            let counts = is_greater(value, load_words(&tap.values));
            keep(counts, load_words(&tap.weights))
        }

        /// The first words; all 0 where there are fewer than a register has.
        #[target_feature(enable = $features)]
        #[inline]
        fn load_words(words: &[i16]) -> Words {
            const { assert!(size_of::<Words>() == size_of::<[i16; LANES]>()) };
            let Some(words) = words.first_chunk::<LANES>() else {
                return broadcast(0);
            };
            // SAFETY: both have the same size, and any bits are words.
            unsafe { words.as_ptr().cast::<Words>().read_unaligned() }
        }

        #[target_feature(enable = $features)]
        #[inline]
        fn store_words(words: &mut [i16; LANES], register: Words) {
            // SAFETY: as above.
            unsafe { words.as_mut_ptr().cast::<Words>().write_unaligned(register) }
        }

        /// The first bytes; all 0 where there are fewer than [`LANES`].
        #[target_feature(enable = $features)]
        #[inline]
        fn load_bytes(bytes: &[u8]) -> Bytes {
            let bytes = bytes.first_chunk::<LANES>().unwrap_or(&[0; LANES]);
            // SAFETY: the array has as many.
            unsafe { load_bytes_at(bytes, 0) }
        }

        /// The words from `start` on.
        ///
        /// # Safety
        /// There are [`LANES`] of them.
        #[target_feature(enable = $features)]
        #[inline]
        unsafe fn load_words_at(words: &[i16], start: usize) -> Words {
            // SAFETY: any bits are words, and the caller promises them.
            unsafe { words.as_ptr().add(start).cast::<Words>().read_unaligned() }
        }

        /// The bytes from `start` on.
        ///
        /// # Safety
        /// There are [`LANES`] of them.
        #[target_feature(enable = $features)]
        #[inline]
        unsafe fn load_bytes_at(bytes: &[u8], start: usize) -> Bytes {
            const { assert!(size_of::<Bytes>() == LANES) };
            // SAFETY: any bits are bytes, and the caller promises them.
            unsafe { bytes.as_ptr().add(start).cast::<Bytes>().read_unaligned() }
        }
    };
}
pub(super) use median_in_registers;
