//! Arms of crosses, of sixteen pixels at once.
//!
//! The line is copied to scratch, with room at both ends for what the longest arms reach: what stands there does
//! not matter, as no arm is longer than the way to the end of the line. A predicate has the pixels whose arms still
//! go on.

use vgstereo_core::kernel::{ArmsRow, Kernels, MAX_CHANNELS};

use super::{LANES, vector_asm};
use crate::armv7em::Armv7em;

/// Equals [`vgstereo_core::kernel::arms_row`] bit for bit.
pub(super) fn arms_row(row: &ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]) {
    let width = arms.len();
    let padded = width + 2 * usize::from(row.reach);
    let mut levels = row.levels.iter().take(row.channels);
    let is_whole = width >= LANES
        && [1, MAX_CHANNELS].contains(&row.channels)
        && levels.all(|levels| levels.len() >= width)
        && scratch.len() >= row.channels * padded;
    if !is_whole {
        Armv7em.arms_row(row, scratch, arms);
        return;
    }
    for (levels, copy) in row
        .levels
        .iter()
        .zip(scratch.chunks_exact_mut(padded.max(1)))
        .take(row.channels)
    {
        let copy = copy.iter_mut().skip(row.reach.into());
        for (copy, &level) in copy.zip(levels.iter().take(width)) {
            *copy = level;
        }
    }
    let Some(lines) = scratch.get(..row.channels * padded) else {
        return;
    };
    let reach = usize::from(row.reach);
    // The last block overlaps the one before it, so that nothing remains.
    for x in (0..width).step_by(LANES) {
        let x = x.min(width - LANES);
        let Some(arms) = arms.get_mut(x..).and_then(<[i16]>::first_chunk_mut) else {
            return;
        };
        measure(row, lines, x + reach, arms);
        if x < reach || x + LANES + reach > width {
            for (arm, (to_first, to_last)) in arms.iter_mut().zip((x..).zip((0..width - x).rev())) {
                let [left, right] = arm.to_le_bytes();
                let left = usize::from(left).min(to_first) as u8;
                let right = usize::from(right).min(to_last) as u8;
                *arm = i16::from_le_bytes([left, right]);
            }
        }
    }
}

/// Writes the arms of the pixels from position `at` of the lines on, one line for each channel, as if the lines went on.
#[inline(always)]
fn measure(row: &ArmsRow<'_>, lines: &[u8], at: usize, arms: &mut [i16; LANES]) {
    let reach = usize::from(row.reach);
    let length = lines.len() / row.channels.max(1);
    debug_assert!(at >= reach && at + LANES + reach <= length);
    let near = reach / 2;
    let centre = lines.as_ptr().wrapping_add(at);
    // q4 has the lengths of the arms that go on while the predicate holds.
    macro_rules! arm {
        ($step:literal, $difference:ident) => {
            concat!(
                "add {level}, {centre}, #",
                $step,
                "\n",
                "vmov.i8 q4, #0\n",
                "mov {t}, #65535\n",
                "vmsr p0, {t}\n",
                "vdup.8 q3, {near_step}\n",
                "wls lr, {near}, 3f\n",
                "2:\n",
                $difference!($step),
                "vpstt\n",
                "vcmpt.u8 cs, q3, q5\n",
                "vaddt.i8 q4, q4, {one}\n",
                "le lr, 2b\n",
                "3:\n",
                "vdup.8 q3, {far_step}\n",
                "wls lr, {far}, 3f\n",
                "2:\n",
                $difference!($step),
                "vpstt\n",
                "vcmpt.u8 cs, q3, q5\n",
                "vaddt.i8 q4, q4, {one}\n",
                "le lr, 2b\n",
                "3:\n",
            )
        };
    }
    macro_rules! grey {
        ($step:literal) => {
            concat!(
                "vldrb.u8 q5, [{level}], #",
                $step,
                "\n",
                "vabd.u8 q5, q5, q0\n"
            )
        };
    }
    macro_rules! colour {
        ($step:literal) => {
            concat!(
                "add {t}, {level}, {length}\n",
                "vldrb.u8 q6, [{t}]\n",
                "add {t}, {t}, {length}\n",
                "vldrb.u8 q7, [{t}]\n",
                "vldrb.u8 q5, [{level}], #",
                $step,
                "\n",
                "vabd.u8 q5, q5, q0\n",
                "vabd.u8 q6, q6, q1\n",
                "vmax.u8 q5, q5, q6\n",
                "vabd.u8 q7, q7, q2\n",
                "vmax.u8 q5, q5, q7\n",
            )
        };
    }
    macro_rules! both_arms {
        ($difference:ident, [$($load:literal),*], $($operands:tt)*) => {
            vector_asm!(
                "vmrs {predicate}, p0",
                "vldrb.u8 q0, [{centre}]",
                $($load,)*
                arm!("-1", $difference),
                "vstrb.8 q4, [{arms}]",
                arm!("1", $difference),
                "vorr q5, q4, q4",
                "vldrb.u8 q4, [{arms}]",
                "vst20.8 {{q4, q5}}, [{arms}]",
                "vst21.8 {{q4, q5}}, [{arms}]",
                "vmsr p0, {predicate}";
                $($operands)*
                predicate = out(reg) _,
                centre = in(reg) centre,
                level = out(reg) _,
                t = out(reg) _,
                near = in(reg) near,
                far = in(reg) reach - near,
                near_step = in(reg) u32::from(row.near_step),
                far_step = in(reg) u32::from(row.far_step),
                one = in(reg) 1,
                arms = in(reg) arms.as_mut_ptr(),
            )
        };
    }
    // SAFETY: as asserted, each line goes on by the reach at both ends of the pixels; there is a vector of arms for those to
    // the left, and then two for both.
    unsafe {
        if row.channels == 1 {
            both_arms!(grey, [],);
        } else {
            both_arms!(
                colour,
                [
                    "add {t}, {centre}, {length}",
                    "vldrb.u8 q1, [{t}]",
                    "add {t}, {t}, {length}",
                    "vldrb.u8 q2, [{t}]"
                ],
                length = in(reg) length,
            );
        }
    }
}
