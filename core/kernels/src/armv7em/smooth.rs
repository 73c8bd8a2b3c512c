//! Smoothing between edges, four pixels at once.

use vgstereo_core::kernel;

use super::simd::splat_u8;

/// Pixels per word.
const LANES: usize = 4;

/// Equals [`kernel::smooth_row`] bit for bit.
#[inline(never)]
pub(super) fn smooth_row(rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
    let done = smoothed.len() / LANES * LANES;
    if smooth(rows, step_max, smoothed).is_some() {
        let rest = smoothed.get_mut(done..).unwrap_or_default();
        let rows = rows.map(|row| row.get(done..).unwrap_or_default());
        kernel::smooth_row(rows, step_max, rest);
    } else {
        kernel::smooth_row(rows, step_max, smoothed);
    }
}

#[inline(always)]
fn smooth(rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) -> Option<()> {
    let width = smoothed.len();
    let mut windows = [&[][..]; 3];
    for (windows, row) in windows.iter_mut().zip(rows) {
        // Rows that are too short for the last pixel leave the whole output unchanged.
        *windows = row.get(..width + 2)?;
    }
    quads::smooth(windows, splat_u8(step_max), smoothed);
    Some(())
}

/// The loop over words as instructions, for which the compiler does not find the registers.
#[cfg(dsp_extension)]
#[allow(unsafe_code)]
mod quads {
    use core::arch::asm;

    use super::LANES;

    /// Puts the pixels' own levels in place of those of register `$other` that differ by more than the step.
    macro_rules! near {
        ($other:literal) => {
            concat!(
                // The difference of a level below `low` wraps round to more than `range`.
                "usub8 {far}, {",
                $other,
                "}, {low}\n",
                "usub8 {far}, {range}, {far}\n",
                "sel {",
                $other,
                "}, {",
                $other,
                "}, {level}"
            )
        };
    }

    /// Smooths whole words, if the rows have two pixels more than these.
    #[inline(always)]
    pub(super) fn smooth(windows: [&[u8]; 3], step: u32, smoothed: &mut [u8]) {
        let whole = smoothed.len() / LANES * LANES;
        if whole == 0 || windows.iter().any(|row| row.len() < whole + 2) {
            return;
        }
        let [above, own, below] = windows.map(<[u8]>::as_ptr);
        let smoothed = smoothed.as_mut_ptr();
        let end = smoothed.wrapping_add(whole);
        // SAFETY: the addresses are within the rows and the output. The stack is as it was.
        unsafe {
            asm!(
                "push {{{a}}}",
                "2:",
                "ldr {level}, [{own}, #1]",
                "uqsub8 {low}, {level}, {step}",
                "uqadd8 {range}, {level}, {step}",
                "usub8 {range}, {range}, {low}",
                "ldr {a}, [{above}, #1]",
                near!("a"),
                "ldr {b}, [{below}, #1]",
                near!("b"),
                "uhadd8 {edges}, {a}, {b}",
                "ldr {a}, [{own}, #2]",
                near!("a"),
                "ldr {b}, [{own}], #4",
                near!("b"),
                "uhadd8 {a}, {a}, {b}",
                "uhadd8 {edges}, {edges}, {a}",
                "ldr {a}, [{above}, #2]",
                near!("a"),
                "ldr {b}, [{below}, #2]",
                near!("b"),
                "uhadd8 {corners}, {a}, {b}",
                "ldr {a}, [{above}], #4",
                near!("a"),
                "ldr {b}, [{below}], #4",
                near!("b"),
                "uhadd8 {a}, {a}, {b}",
                "uhadd8 {corners}, {corners}, {a}",
                "uhadd8 {corners}, {level}, {corners}",
                "uhadd8 {edges}, {edges}, {corners}",
                "str {edges}, [{smoothed}], #4",
                "ldr {a}, [sp]",
                "cmp {smoothed}, {a}",
                "bne 2b",
                "add sp, #4",
                above = inout(reg) above => _, own = inout(reg) own => _,
                below = inout(reg) below => _, smoothed = inout(reg) smoothed => _,
                a = inout(reg) end => _, b = out(reg) _, edges = out(reg) _, corners = out(reg) _,
                far = out(reg) _, level = out(reg) _, low = out(reg) _, range = out(reg) _,
                step = in(reg) step,
            );
        }
    }
}

/// The same in plain code, to which the assembly is held.
#[cfg(not(dsp_extension))]
mod quads {
    use super::LANES;
    use crate::armv7em::simd::{
        add_saturating_u8x4, halve_sum_u8x4, load, select_ge_u8x4, store, sub_saturating_u8x4,
        sub_wrapping_u8x4,
    };

    #[inline(always)]
    pub(super) fn smooth(windows: [&[u8]; 3], step: u32, smoothed: &mut [u8]) {
        let outputs = smoothed.as_chunks_mut::<LANES>().0;
        let [above, own, below] = windows.map(|row| row.windows(LANES + 2).step_by(LANES));
        let pixels = outputs.iter_mut().zip(above).zip(own).zip(below);
        for (((output, above), own), below) in pixels {
            let [above, own, below] = [above, own, below].map(columns);
            let level = own[1];
            let low = sub_saturating_u8x4(level, step);
            // The difference of a level below `low` wraps round to more than `range`.
            let range = sub_wrapping_u8x4(add_saturating_u8x4(level, step), low);
            let near =
                |other: u32| select_ge_u8x4(range, sub_wrapping_u8x4(other, low), other, level);
            let corners = halve_sum_u8x4(
                halve_sum_u8x4(near(above[0]), near(below[0])),
                halve_sum_u8x4(near(above[2]), near(below[2])),
            );
            let edges = halve_sum_u8x4(
                halve_sum_u8x4(near(above[1]), near(below[1])),
                halve_sum_u8x4(near(own[0]), near(own[2])),
            );
            let smoothed = halve_sum_u8x4(edges, halve_sum_u8x4(level, corners));
            store(smoothed, output);
        }
    }

    /// Loads four pixels from each of the first three positions of a window.
    #[inline(always)]
    fn columns(window: &[u8]) -> [u32; 3] {
        core::array::from_fn(|column| {
            let quad = window.get(column..).and_then(|rest| rest.first_chunk());
            quad.map_or(0, load)
        })
    }
}
