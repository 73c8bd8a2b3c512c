//! SGM path costs of up to 64 disparities, four to a register.

use core::cell::Cell;

use bytemuck::try_cast_slice_mut;
use vgstereo_core::kernel::AggregateRow;

use super::others;
use super::path::{Path, descend, least_in, step};
use super::simd::splat_u8;

/// Largest number of disparities, rounded up to a multiple of 16.
pub(super) const MAX_STRIDE: usize = 64;

/// Equals [`aggregate_paths`](vgstereo_core::kernel::aggregate_paths) bit for bit.
pub(super) fn aggregate_paths(row: &mut AggregateRow<'_>) {
    let aggregated = match row.stride {
        16 => aggregate::<2>(row),
        32 => aggregate::<4>(row),
        48 => aggregate::<6>(row),
        MAX_STRIDE => aggregate::<8>(row),
        _ => None,
    };
    if aggregated.is_none() {
        others::aggregate_paths(row);
    }
}

/// Aggregates a row of `8 * PAIRS` disparities; returns `None` if the rows are not aligned to
/// words.
#[inline(never)]
fn aggregate<const PAIRS: usize>(row: &mut AggregateRow<'_>) -> Option<()> {
    // Of both, a pixel and its neighbour are used at a time.
    let costs = Cell::from_mut(pixels_mut::<PAIRS>(row.costs)?).as_slice_of_cells();
    let from_right = Cell::from_mut(pixels_mut::<PAIRS>(row.from_right)?).as_slice_of_cells();
    let from_above = pixels_mut::<PAIRS>(row.from_above)?;
    let p1 = splat_u8(row.p1);
    let p2_along = row.p2_along.get(1..)?;

    // From the right. The penalty of a pixel is that between it and the one on its right.
    let (last, rest) = costs.split_last()?;
    let paths = from_right.get(..costs.len())?;
    paths.last()?.set(last.get());
    let mut least = least_in(&last.get());
    let pixels = rest.iter().zip(paths.array_windows()).zip(p2_along);
    for ((costs, [path, previous]), &p2) in pixels.rev() {
        least = step(previous, Some(costs), path, [least, p1, splat_u8(p2)]);
    }

    let rows = costs.iter().zip(from_above).zip(row.p2_down);
    for ((costs, from_above), &p2) in rows {
        if row.is_first {
            *from_above = costs.get();
        } else {
            descend(from_above, costs, [p1, splat_u8(p2)]);
        }
    }

    // From the left; the path costs replace the matching costs.
    let mut least = least_in(&costs.first()?.get());
    for ([previous, path], &p2) in costs.array_windows().zip(p2_along) {
        least = step(previous, None, path, [least, p1, splat_u8(p2)]);
    }
    Some(())
}

fn pixels_mut<const PAIRS: usize>(row: &mut [u8]) -> Option<&mut [Path<PAIRS>]> {
    Some(try_cast_slice_mut(row).ok()?.as_chunks_mut().0)
}
