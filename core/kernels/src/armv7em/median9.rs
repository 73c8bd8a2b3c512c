//! Median of 3 x 3 pixels, two pixels per word.

use vgstereo_core::kernel;

use super::simd::{max_i16x2, min_i16x2, order_i16x2, pair_of};

/// Two columns of three values, each sorted: the two least, the two middle and the two largest
/// values.
pub(crate) type Columns = [u32; 3];

/// Equals [`kernel::median9_row`] bit for bit.
#[inline(never)]
pub(super) fn median9_row(rows: [&[i16]; 3], output: &mut [i16]) {
    if filter(rows, output).is_none() {
        kernel::median9_row(rows, output);
    }
}

#[inline(always)]
fn filter(rows: [&[i16]; 3], output: &mut [i16]) -> Option<()> {
    let width = output.len();
    let (outputs, odd) = output.as_chunks_mut::<2>();
    let mut pairs = [&[][..]; 3];
    let mut firsts = [0; 3];
    for ((pairs, first), row) in pairs.iter_mut().zip(&mut firsts).zip(rows) {
        let (own, rest) = row.get(..width + 2)?.as_chunks::<2>().0.split_first()?;
        *first = pair_of(own);
        *pairs = rest.get(..outputs.len())?;
    }
    let mut before = sorted::<Simd>(firsts);
    let [a, b, c] = pairs.map(<[_]>::iter);
    for (((a, b), c), output) in a.zip(b).zip(c).zip(outputs) {
        let after = sorted::<Simd>([a, b, c].map(pair_of));
        let medians = medians::<Simd>(before, after);
        *output = [medians as i16, (medians >> 16) as i16];
        before = after;
    }
    if let [output] = odd {
        // The last column has no neighbour in its word; what stands in its place is not used.
        let mut after = [0; 3];
        for (after, row) in after.iter_mut().zip(rows) {
            *after = pair_of(&[*row.get(width + 1)?, 0]);
        }
        *output = medians::<Simd>(before, sorted::<Simd>(after)) as i16;
    }
    Some(())
}

/// Operations on words of two signed halfwords, the pixel on the left in the low one.
pub(crate) trait Pairs {
    /// The lesser halfword of each lane.
    fn lesser(a: u32, b: u32) -> u32;

    /// The greater halfword of each lane.
    fn greater(a: u32, b: u32) -> u32;

    /// Both.
    #[inline(always)]
    fn order(a: u32, b: u32) -> [u32; 2] {
        [Self::lesser(a, b), Self::greater(a, b)]
    }

    /// The high halfword of the first word, and the low one of the second.
    #[inline(always)]
    fn between(before: u32, after: u32) -> u32 {
        before >> 16 | after << 16
    }
}

struct Simd;

impl Pairs for Simd {
    #[inline(always)]
    fn lesser(a: u32, b: u32) -> u32 {
        min_i16x2(a, b)
    }

    #[inline(always)]
    fn greater(a: u32, b: u32) -> u32 {
        max_i16x2(a, b)
    }

    #[inline(always)]
    fn order(a: u32, b: u32) -> [u32; 2] {
        order_i16x2(a, b)
    }
}

/// Returns the medians of the two pixels in the middle of four sorted columns.
#[inline(always)]
pub(crate) fn medians<P: Pairs>(before: Columns, after: Columns) -> u32 {
    // The three operands of each step are columns 0 and 1, columns 1 and 2, and columns 2 and 3.
    let middle: Columns = core::array::from_fn(|i| P::between(before[i], after[i]));
    let low = P::greater(P::greater(before[0], middle[0]), after[0]);
    let half = middle_of::<P>(before[1], middle[1], after[1]);
    let high = P::lesser(P::lesser(before[2], middle[2]), after[2]);
    middle_of::<P>(low, half, high)
}

/// Sorts two columns of three values.
#[inline(always)]
pub(crate) fn sorted<P: Pairs>([a, b, c]: [u32; 3]) -> Columns {
    let [low, high] = P::order(a, b);
    let [middle, high] = P::order(high, c);
    let [low, middle] = P::order(low, middle);
    [low, middle, high]
}

#[inline(always)]
fn middle_of<P: Pairs>(a: u32, b: u32, c: u32) -> u32 {
    let [low, high] = P::order(a, b);
    P::greater(low, P::lesser(high, c))
}
