//! A step along a path of SGM. In assembly, because the compiler does not find the registers for it, of which there are
//! just enough.

use core::cell::Cell;

use super::simd::{in_order, min_u8x4};

/// Path costs of a pixel, eight disparities to a pair of registers.
pub(super) type Path<const PAIRS: usize> = [[u32; 2]; PAIRS];

/// Takes one step along a path to another pixel, whose matching costs are in place of its path costs if they are `None`.
/// The least of the previous path costs, P1 and P2 come in all four bytes, and so does the least path cost, which is
/// returned.
#[inline(always)]
pub(super) fn step<const PAIRS: usize>(
    previous: &Cell<Path<PAIRS>>,
    costs: Option<&Cell<Path<PAIRS>>>,
    path: &Cell<Path<PAIRS>>,
    penalties: [u32; 3],
) -> u32 {
    let least = match costs {
        Some(costs) => steps::step(previous, costs, path, penalties),
        None => steps::step_in_place(previous, path, penalties),
    };
    least_of(least)
}

/// Takes one step along a path, from the path costs of a pixel to those of the next, in place. P1 and P2 come in all four
/// bytes.
#[inline(always)]
pub(super) fn descend<const PAIRS: usize>(
    path: &mut Path<PAIRS>,
    costs: &Cell<Path<PAIRS>>,
    [p1, p2]: [u32; 2],
) {
    let least = least_in(path);
    steps::descend(path, costs, [least, p1, p2]);
}

/// Returns the least of the costs, in all four bytes.
#[inline(always)]
pub(super) fn least_in<const PAIRS: usize>(costs: &Path<PAIRS>) -> u32 {
    let mut least = u32::MAX;
    for (index, costs) in costs.iter().enumerate() {
        // Pair after pair, because there are few registers.
        let [a, b] = costs.map(in_order);
        least = if index == 0 { a } else { min_u8x4(least, a) };
        least = in_order(min_u8x4(least, b));
    }
    least_of(least)
}

/// Returns the least of four bytes, in all four bytes.
#[inline(always)]
fn least_of(quad: u32) -> u32 {
    let pair = min_u8x4(quad, quad.rotate_right(16));
    min_u8x4(pair, pair.rotate_right(8))
}

/// Steps as instructions. The cost of a disparity is its matching cost plus P2, less how much its least cost of being
/// reached is below the ceiling: the least previous path cost plus P2. That fits a byte, because the least path cost is
/// at most the largest matching cost. The least path costs that are returned are those of every fourth disparity.
#[cfg(dsp_extension)]
#[allow(unsafe_code)]
mod steps {
    use core::arch::asm;
    use core::cell::Cell;

    use super::Path;
    use crate::armv7em::simd::add_saturating_u8x4;

    /// The step of pair `$index` of the registers of a path. `below` and `above` bring the previous path costs one
    /// disparity below the first four and one above the last four to `{b}`. `write` takes the path costs, `{c}` and
    /// `{d}`. Subtractions and shifts set flags because these forms are shorter.
    macro_rules! pair {
        (
            $index:literal, below: [$($below:literal),*], above: [$($above:literal),+], write: [$($write:literal),+],
            [$($operands:tt)+]
        ) => {
            // SAFETY: the addresses are within the paths of which the function has references.
            unsafe {
                asm!(
                    "ldrd {c}, {d}, [{previous}, #8 * {index}]",
                    $($below,)*
                    "ldr {a}, [{previous}, #8 * {index} + 1]",
                    "uqsub8 {a}, {b}, {a}",
                    "subs {a}, {b}, {a}",
                    "uqadd8 {a}, {a}, {p1}",
                    "uqsub8 {a}, {c}, {a}",
                    "subs {a}, {c}, {a}",
                    "uqsub8 {a}, {ceiling}, {a}",
                    "subs {a}, {p2}, {a}",
                    $($above,)+
                    "ldr {c}, [{previous}, #8 * {index} + 3]",
                    "uqsub8 {b}, {c}, {b}",
                    "subs {b}, {c}, {b}",
                    "uqadd8 {b}, {b}, {p1}",
                    "uqsub8 {b}, {d}, {b}",
                    "subs {b}, {d}, {b}",
                    "uqsub8 {b}, {ceiling}, {b}",
                    "subs {b}, {p2}, {b}",
                    "ldrd {c}, {d}, [{costs}, #8 * {index}]",
                    "uqadd8 {c}, {c}, {a}",
                    "uqadd8 {d}, {d}, {b}",
                    $($write,)+
                    a = out(reg) _, c = out(reg) _, d = out(reg) _,
                    index = const $index,
                    $($operands)+
                    options(nostack),
                );
            }
        };
    }

    /// The steps of all pairs of a path. There is nothing below its first disparity and above its last, at the highest
    /// cost, which is never the least.
    macro_rules! pairs {
        ($pairs:ident, $how:tt) => {
            pairs!(@ $pairs, $how, 0 1 2 3 4 5 6 7);
        };
        (@ $pairs:ident, $how:tt, $($index:literal)+) => {
            $(pairs!(@@ $index, $pairs, $how);)+
        };
        (
            @@ $index:literal, $pairs:ident,
            { below: $below:tt, first: $first:tt, write: $write:tt, operands: $operands:tt }
        ) => {
            if $index == 0 {
                pair!($index, below: ["lsls {b}, {c}, #8", "orr {b}, {b}, #255"],
                    above: ["ldr {b}, [{previous}, #8 * {index} + 5]"], write: $first, $operands);
            } else if $index + 1 < $pairs {
                pair!($index, below: $below,
                    above: ["ldr {b}, [{previous}, #8 * {index} + 5]"], write: $write, $operands);
            } else if $index < $pairs {
                pair!($index, below: $below,
                    above: ["lsrs {b}, {d}, #8", "orr {b}, {b}, #0xff000000"], write: $write, $operands);
            }
        };
    }

    /// Writes a path; returns its least costs.
    #[inline(always)]
    pub(super) fn step<const PAIRS: usize>(
        previous: &Cell<Path<PAIRS>>,
        costs: &Cell<Path<PAIRS>>,
        path: &Cell<Path<PAIRS>>,
        [mut least, p1, p2]: [u32; 3],
    ) -> u32 {
        let ceiling = add_saturating_u8x4(least, p2);
        pairs!(PAIRS, {
            below: ["ldr {b}, [{previous}, #8 * {index} - 1]"],
            first: [
                "strd {c}, {d}, [{path}, #8 * {index}]",
                "uqsub8 {a}, {c}, {d}",
                "subs {least}, {c}, {a}"
            ],
            write: [
                "strd {c}, {d}, [{path}, #8 * {index}]",
                "uqsub8 {a}, {least}, {c}",
                "subs {least}, {least}, {a}",
                "uqsub8 {a}, {least}, {d}",
                "subs {least}, {least}, {a}"
            ],
            operands: [
                b = out(reg) _, previous = in(reg) previous.as_ptr(), costs = in(reg) costs.as_ptr(),
                path = in(reg) path.as_ptr(), p1 = in(reg) p1, p2 = in(reg) p2,
                ceiling = in(reg) ceiling, least = inout(reg) least,
            ]
        });
        least
    }

    /// Writes a path in place of its matching costs; returns its least costs.
    #[inline(always)]
    pub(super) fn step_in_place<const PAIRS: usize>(
        previous: &Cell<Path<PAIRS>>,
        path: &Cell<Path<PAIRS>>,
        [mut least, p1, p2]: [u32; 3],
    ) -> u32 {
        let ceiling = add_saturating_u8x4(least, p2);
        pairs!(PAIRS, {
            below: ["ldr {b}, [{previous}, #8 * {index} - 1]"],
            first: [
                "strd {c}, {d}, [{costs}, #8 * {index}]",
                "uqsub8 {a}, {c}, {d}",
                "subs {least}, {c}, {a}"
            ],
            write: [
                "strd {c}, {d}, [{costs}, #8 * {index}]",
                "uqsub8 {a}, {least}, {c}",
                "subs {least}, {least}, {a}",
                "uqsub8 {a}, {least}, {d}",
                "subs {least}, {least}, {a}"
            ],
            operands: [
                b = out(reg) _, previous = in(reg) previous.as_ptr(), costs = in(reg) path.as_ptr(),
                p1 = in(reg) p1, p2 = in(reg) p2, ceiling = in(reg) ceiling,
                least = inout(reg) least,
            ]
        });
        least
    }

    /// Writes a path in place of the previous one. The last cost of a pair is loaded for the next before it is
    /// overwritten.
    #[inline(always)]
    pub(super) fn descend<const PAIRS: usize>(
        path: &mut Path<PAIRS>,
        costs: &Cell<Path<PAIRS>>,
        [least, p1, p2]: [u32; 3],
    ) {
        let ceiling = add_saturating_u8x4(least, p2);
        // Any value: the first pair has nothing below it.
        let mut below = ceiling;
        pairs!(PAIRS, {
            below: [],
            first: [
                "ldr {b}, [{previous}, #8 * {index} + 7]",
                "strd {c}, {d}, [{previous}, #8 * {index}]"
            ],
            write: [
                "ldr {b}, [{previous}, #8 * {index} + 7]",
                "strd {c}, {d}, [{previous}, #8 * {index}]"
            ],
            operands: [
                b = inout(reg) below, previous = in(reg) &raw mut *path, costs = in(reg) costs.as_ptr(),
                p1 = in(reg) p1, p2 = in(reg) p2, ceiling = in(reg) ceiling,
            ]
        });
        let _ = below;
    }
}

/// The same steps in plain code, to which those in assembly are held.
#[cfg(not(dsp_extension))]
mod steps {
    use bytemuck::must_cast_slice;
    use core::array::from_fn;
    use core::cell::Cell;

    use super::Path;
    use crate::armv7em::simd::{add_saturating_u8x4, load, min_u8x4, sub_saturating_u8x4};

    pub(super) fn step<const PAIRS: usize>(
        previous: &Cell<Path<PAIRS>>,
        costs: &Cell<Path<PAIRS>>,
        path: &Cell<Path<PAIRS>>,
        penalties: [u32; 3],
    ) -> u32 {
        let next = next(&previous.get(), &costs.get(), penalties);
        path.set(next);
        next.as_flattened().iter().copied().fold(u32::MAX, min_u8x4)
    }

    pub(super) fn step_in_place<const PAIRS: usize>(
        previous: &Cell<Path<PAIRS>>,
        path: &Cell<Path<PAIRS>>,
        penalties: [u32; 3],
    ) -> u32 {
        step(previous, path, path, penalties)
    }

    pub(super) fn descend<const PAIRS: usize>(
        path: &mut Path<PAIRS>,
        costs: &Cell<Path<PAIRS>>,
        penalties: [u32; 3],
    ) {
        *path = next(path, &costs.get(), penalties);
    }

    fn next<const PAIRS: usize>(
        previous: &Path<PAIRS>,
        costs: &Path<PAIRS>,
        [least, p1, p2]: [u32; 3],
    ) -> Path<PAIRS> {
        let ceiling = add_saturating_u8x4(least, p2);
        let bytes: &[u8] = must_cast_slice(previous.as_slice());
        let moved = |start: usize| bytes.get(start..)?.first_chunk().map(load);
        from_fn(|pair| {
            from_fn(|word| {
                let (start, same) = (8 * pair + 4 * word, previous[pair][word]);
                let below = moved(start.wrapping_sub(1)).unwrap_or(same << 8 | 0xff);
                let above = moved(start + 1).unwrap_or(same >> 8 | 0xff << 24);
                let neighbours = add_saturating_u8x4(min_u8x4(below, above), p1);
                let less = sub_saturating_u8x4(ceiling, min_u8x4(same, neighbours));
                add_saturating_u8x4(costs[pair][word], p2.wrapping_sub(less))
            })
        })
    }
}
