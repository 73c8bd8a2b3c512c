//! Weighted median in vector registers: many pixels at once, with 16-bit words for values and
//! weights.
//!
//! All instruction sets share the loops: [`median_in_registers`] is expanded beside the operations
//! on each set's registers.

use vgstereo_core::kernel::{MAX_CHANNELS, MAX_TAP_ROWS, WeightedMedianRow};

/// Whether all slices are as long as the row states, for an output of `width` pixels.
pub(super) fn is_whole(row: &WeightedMedianRow<'_>, weights: usize, width: usize) -> bool {
    let taps = row.rows.checked_mul(row.tap_columns().len());
    let padded = width.saturating_add(row.window_width).saturating_sub(1);
    let values = row.values.iter().take(row.rows);
    let mut channels = row.levels.iter().zip(row.centres).take(row.channels);
    (1..=MAX_TAP_ROWS).contains(&row.rows)
        && row.window_width > 0
        && taps.is_some_and(|taps| taps <= row.places.len() && 16 * taps <= weights)
        && values
            .map(|values| values.len())
            .all(|length| padded <= length)
        && (row.channels == 1 || row.channels == MAX_CHANNELS)
        && channels.all(|(levels, centre)| {
            let mut levels = levels.iter().take(row.rows);
            levels.all(|levels| padded <= levels.len()) && width <= centre.len()
        })
}

/// A tap of `LANES` pixels; aligned, so that no load straddles two cache lines.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Tap<const LANES: usize> {
    pub(super) values: [i16; LANES],
    pub(super) weights: [i16; LANES],
}

impl<const LANES: usize> Tap<LANES> {
    pub(super) const NONE: Self = Self {
        values: [0; LANES],
        weights: [0; LANES],
    };
}

/// Defines `weighted_median_row`, which equals core's bit for bit and calls it for short rows
/// and where [`is_whole`] does not hold.
///
/// A macro, because a function cannot be compiled for the instruction set of its caller. Where it
/// is expanded, it expects `Bytes` and `Words`, registers of `LANES` bytes and words, and the
/// operations on them under the names used here.
macro_rules! median_in_registers {
    ($features:literal) => {
        std::thread_local! {
            /// Scratch of a thread: the taps of the pixels that are filtered together.
            static TAPS: Cell<Vec<Tap<LANES>>> = const { Cell::new(Vec::new()) };
        }

        #[target_feature(enable = $features)]
        pub(super) fn weighted_median_row(
            row: &WeightedMedianRow<'_>,
            weights: &mut [u8],
            output: &mut [i16],
        ) {
            let width = output.len();
            if width < LANES || !is_whole(row, weights.len(), width) {
                kernel::weighted_median_row(row, weights, output);
                return;
            }
            let taps = row.rows * row.tap_columns().len();
            let mut scratch = TAPS.take();
            scratch.resize(scratch.len().max(taps), Tap::NONE);
            let taps = &mut scratch[..taps];
            // The last block overlaps the one before it, so that nothing remains.
            for x in (0..width).step_by(LANES) {
                let x = x.min(width - LANES);
                if let Some(output) = output[x..].first_chunk_mut() {
                    filter_block(row, x, taps, output);
                }
            }
            TAPS.set(scratch);
        }

        /// Filters the `LANES` pixels from `x` on.
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
                    // SAFETY: `column` is less than the window's width, and the runs have `LANES -
                    // 1` elements more than that.
                    let (values, levels) = unsafe {
                        let levels = [
                            load_bytes_at(levels[0], column),
                            load_bytes_at(levels[1], column),
                            load_bytes_at(levels[2], column),
                        ];
                        (load_words_at(values, column), levels)
                    };
                    // At most 255, from which on no tap has a weight.
                    let difference = difference(centres, levels);
                    let likeness = subtract_saturating(reach, difference);
                    let square = shift_right::<4>(multiply(likeness, likeness));
                    let weight = shift_right::<4>(multiply(square, broadcast(place.into())));
                    let weight = select(is_equal(values, invalid), broadcast(0), weight);
                    totals = add(totals, weight);
                    let is_nothing = is_equal(weight, broadcast(0));
                    low = least(low, select(is_nothing, low, values));
                    high = greatest(high, select(is_nothing, high, values));
                    // The next tap overwrites one without a weight in any pixel.
                    if let Some(tap) = taps.get_mut(count) {
                        store_words(&mut tap.values, values);
                        store_words(&mut tap.weights, weight);
                    }
                    count += usize::from(!is_all(is_nothing));
                }
            }
            let taps = taps.get(..count).unwrap_or_default();
            // Bisection for the smallest value at or below which lies at least half of the weight.
            loop {
                let is_open = is_greater(high, low);
                if is_none(is_open) {
                    break;
                }
                // Rounded down, without overflow.
                let middle = add(and(low, high), shift_right_signed::<1>(xor(low, high)));
                // Does not overflow for pixels whose search is open.
                let next = add(middle, broadcast(1));
                // Four partial sums, so that additions do not wait for each other.
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

        /// Returns a tap's weights where its value is less than `value`, and 0 elsewhere.
        #[target_feature(enable = $features)]
        #[inline]
        fn weight_below(tap: &Tap<LANES>, value: Words) -> Words {
            let counts = is_greater(value, load_words(&tap.values));
            keep(counts, load_words(&tap.weights))
        }

        /// Loads the first `LANES` words; returns all 0 if there are fewer.
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
            // SAFETY: both have the same size, and any bits are words.
            unsafe { words.as_mut_ptr().cast::<Words>().write_unaligned(register) }
        }

        /// Loads the first `LANES` bytes; returns all 0 if there are fewer.
        #[target_feature(enable = $features)]
        #[inline]
        fn load_bytes(bytes: &[u8]) -> Bytes {
            let bytes = bytes.first_chunk::<LANES>().unwrap_or(&[0; LANES]);
            // SAFETY: the array has `LANES` bytes.
            unsafe { load_bytes_at(bytes, 0) }
        }

        /// Loads the `LANES` words from `start` on.
        ///
        /// # Safety
        /// `words` has `LANES` elements from `start` on.
        #[target_feature(enable = $features)]
        #[inline]
        unsafe fn load_words_at(words: &[i16], start: usize) -> Words {
            // SAFETY: any bits are words, and the caller promises them.
            unsafe { words.as_ptr().add(start).cast::<Words>().read_unaligned() }
        }

        /// Loads the `LANES` bytes from `start` on.
        ///
        /// # Safety
        /// `bytes` has `LANES` elements from `start` on.
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
