//! Winner-take-all over a run of distances: the nearest, its ties, and the runners-up.

use super::hamming::{LANES, NO_DISTANCE};

/// Result of a winner-take-all search over a run of distances.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Nearest {
    /// Smallest distance; [`NO_DISTANCE`] if no element has one.
    pub distance: i16,
    /// Index of the first element at that distance.
    pub first: usize,
    /// Number of elements at that distance.
    pub ties: usize,
}

/// Finds the nearest of `distances`, whose length is a multiple of [`LANES`] and at most `i16::MAX`.
#[inline(always)]
#[must_use]
pub fn nearest(distances: &[i16]) -> Nearest {
    // Reductions over the run, each of which becomes vector code.
    let distance = distances.iter().fold(NO_DISTANCE, |a, &b| a.min(b));
    let mut ties = 0_i16;
    let mut first = i16::MAX;
    for (&other, index) in distances.iter().zip(0_i16..) {
        ties += i16::from(other == distance);
        first = first.min(if other == distance { index } else { i16::MAX });
    }
    Nearest {
        distance,
        // Neither is negative.
        first: first as usize,
        ties: ties as usize,
    }
}

/// Index of the element that is tie number `chosen` (from 0) at `distance`.
#[inline(always)]
#[must_use]
pub fn nth_at(distances: &[i16], distance: i16, chosen: usize) -> Option<usize> {
    let mut equal = (0..).zip(distances).filter(|&(_, &d)| d == distance);
    equal.nth(chosen).map(|(index, _)| index)
}

/// Calls `place` with the index of each of the `count` nearest elements, in ascending order of
/// distance and then of index; fewer if fewer have a distance.
#[inline(always)]
pub fn best(distances: &[i16], count: usize, mut place: impl FnMut(usize, usize)) {
    // A key holds the distance above the index, so that keys are in the order of preference.
    const INDEX_BITS: u32 = 16;
    let key = |distance: i16, index: i32| i32::from(distance) << INDEX_BITS | index;
    let mut last = -1;
    for rank in 0..count {
        let mut least = [i32::MAX; LANES];
        for (block, start) in distances
            .as_chunks::<LANES>()
            .0
            .iter()
            .zip((0_i32..).step_by(LANES))
        {
            for ((least, &distance), lane) in least.iter_mut().zip(block).zip(0_i32..) {
                let key = key(distance, start + lane);
                *least = (*least).min(if key > last { key } else { i32::MAX });
            }
        }
        last = least.iter().fold(i32::MAX, |a, &b| a.min(b));
        if last >= key(NO_DISTANCE, 0) {
            break;
        }
        place(rank, (last & ((1 << INDEX_BITS) - 1)) as usize);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec::Vec;

    /// Compared with sorting, on random runs with many ties and some elements without a distance.
    #[test]
    fn selection_equals_a_stable_sort() {
        for seed in 0..200 {
            let mut random = Pcg32::seed_from_u64(seed);
            let length = LANES * (1 + random.next_u32() as usize % 6);
            let distances: Vec<i16> = (0..length)
                .map(|_| match random.next_u32() % 8 {
                    7 => NO_DISTANCE,
                    distance => distance as i16 + 3,
                })
                .collect();
            let mut order: Vec<usize> = (0..length)
                .filter(|&i| distances[i] != NO_DISTANCE)
                .collect();
            order.sort_by_key(|&i| distances[i]);

            let mut found = Vec::new();
            best(&distances, 5, |rank, index| {
                assert_eq!(rank, found.len());
                found.push(index);
            });
            assert_eq!(found, order[..order.len().min(5)], "seed {seed}");

            let Some(&first) = order.first() else {
                continue;
            };
            let least = distances[first];
            let equal: Vec<usize> = (0..length).filter(|&i| distances[i] == least).collect();
            let expected = Nearest {
                distance: least,
                first,
                ties: equal.len(),
            };
            assert_eq!(nearest(&distances), expected, "seed {seed}");
            for (chosen, &index) in equal.iter().enumerate() {
                assert_eq!(nth_at(&distances, least, chosen), Some(index));
            }
            assert_eq!(nth_at(&distances, least, equal.len()), None);
        }
    }

    #[test]
    fn nothing_is_nearest_when_nothing_has_a_distance() {
        assert_eq!(nearest(&[NO_DISTANCE; LANES]).distance, NO_DISTANCE);
        best(&[NO_DISTANCE; LANES], 3, |_, _| panic!("no candidate"));
    }
}
