//! Oracle of the paper's method on whole images: the shortest code that is evidently right.

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::disparity::px_to_q4;
use vgstereo_core::kernel::TieBreak;
use vgstereo_core::pattern::{OffsetLaw, StoredOffset, Synapses};
use vgstereo_core::rows::Offset;
use vgstereo_core::{Config, INVALID, Method, Parameters, RecallParameters, Reference};

use crate::Pair;

/// Returns the disparities of the whole reference view, 1/16 px. The region of `config` must be the
/// whole view.
///
/// # Panics
/// If the method is not the paper's.
#[must_use]
pub fn match_whole(pair: &Pair, config: &Config) -> Vec<i16> {
    let parameters = &config.parameters;
    let Method::Recall(recall) = &parameters.method else {
        panic!("the oracle knows the paper's method only");
    };
    let stored = offsets(parameters);
    let candidates = candidates(pair, config, recall, Synapses::from_stored(&stored));
    let mut map: Vec<i16> = candidates.iter().map(|list| list[0]).collect();
    vote(&mut map, &candidates, pair.width, recall.vote_passes);
    let map = median(&map, pair.width, i32::from(recall.median_reach_px));
    let own = match config.reference {
        Reference::Left => 0,
        Reference::Right => 1,
    };
    let pixels = map.into_iter().enumerate();
    let seen = |i: usize| pair.sees(own, i % pair.width, i / pair.width);
    let disparity = |(i, px)| if seen(i) { px_to_q4(px) } else { INVALID };
    pixels.map(disparity).collect()
}

/// Returns the offsets that a matcher draws with one generator: the first half with the first
/// sigma, then the second half with the second.
#[must_use]
pub fn offsets(parameters: &Parameters) -> Vec<StoredOffset> {
    let count = usize::from(parameters.synapses);
    let mut generator = Pcg32::seed_from_u64(parameters.seed);
    let mut offsets = Vec::new();
    for (drawn, law) in [count / 2, count - count / 2]
        .into_iter()
        .zip(OffsetLaw::halves(parameters))
    {
        let mut stored = vec![[0; 2]; drawn];
        Synapses::draw(&mut stored, law, &mut generator).unwrap();
        offsets.extend(stored);
    }
    offsets
}

/// Returns `recall.candidates` disparities for each pixel, px: the recalled one, then the others in
/// ascending order of distance and disparity, then `INVALID` if there are too few.
fn candidates(
    pair: &Pair,
    config: &Config,
    recall: &RecallParameters,
    synapses: Synapses<'_>,
) -> Vec<Vec<i16>> {
    let (reference, other, [own_view, other_view]) = match config.reference {
        Reference::Left => (&pair.left, &pair.right, [0, 1]),
        Reference::Right => (&pair.right, &pair.left, [1, 0]),
    };
    let pattern = |pixels: &[u8], x: i32, y: i32| -> Vec<bool> {
        let sample = |offset: Offset| {
            let column = (x + i32::from(offset.dx)).clamp(0, pair.width as i32 - 1);
            let line = (y + i32::from(offset.dy)).clamp(0, pair.height as i32 - 1);
            pixels[line as usize * pair.width + column as usize]
        };
        let samples: Vec<u8> = synapses.iter().map(sample).collect();
        let n = samples.len();
        (0..n).map(|r| samples[r] > samples[(r + 1) % n]).collect()
    };
    let mut lists = Vec::new();
    for y in 0..pair.height as i32 {
        let memory: Vec<_> = (0..pair.width as i32)
            .map(|x| pattern(other, x, y))
            .collect();
        for x in 0..pair.width as i32 {
            let input = pattern(reference, x, y);
            let mut recalled: Vec<(usize, i32)> = Vec::new();
            for d in config.disparities.range_px() {
                let column = match config.reference {
                    Reference::Left => x - d,
                    Reference::Right => x + d,
                };
                if let Some(column) = usize::try_from(column).ok()
                    && let Some(stored) = memory.get(column)
                    && pair.sees(other_view, column, y as usize)
                {
                    let distance = input.iter().zip(stored).filter(|(a, b)| a != b).count();
                    recalled.push((distance, d));
                }
            }
            recalled.sort_unstable();
            let mut list: Vec<i16> = recalled.iter().map(|&(_, d)| d as i16).collect();
            list.resize(usize::from(recall.candidates).max(list.len()), INVALID);
            if let TieBreak::Random { seed } = recall.ties {
                let ties = recalled.iter().filter(|r| r.0 == recalled[0].0).count();
                // The tie of column x is broken by draw number x of the line's own generator.
                let mut generator = Pcg32::seed_from_u64(seed.wrapping_add(y as u64));
                let draw = (0..=x).map(|_| generator.next_u32()).last().unwrap();
                if ties > 0 {
                    list[0] = list[((u64::from(draw) * ties as u64) >> 32) as usize];
                }
            }
            list.truncate(recall.candidates.into());
            if !pair.sees(own_view, x as usize, y as usize) {
                list.fill(INVALID);
            }
            lists.push(list);
        }
    }
    lists
}

/// Performs `passes` passes of the vote over the whole frame, each in place from the top left.
fn vote(map: &mut [i16], candidates: &[Vec<i16>], width: usize, passes: u8) {
    for _ in 0..passes {
        for i in 0..map.len() {
            let mut neighbours = Vec::new();
            if i % width > 0 {
                neighbours.push(map[i - 1]);
            }
            if i % width + 1 < width {
                neighbours.push(map[i + 1]);
            }
            if i >= width {
                neighbours.push(map[i - width]);
            }
            if i + width < map.len() {
                neighbours.push(map[i + width]);
            }
            let votes = |c: i16| neighbours.iter().filter(|&&n| n == c).count();
            let mut most = 1;
            for &candidate in candidates[i].iter().filter(|&&c| c != INVALID) {
                if votes(candidate) > most {
                    most = votes(candidate);
                    map[i] = candidate;
                }
            }
        }
    }
}

/// Returns the lower median of the valid pixels in each window, clipped to the image.
fn median(map: &[i16], width: usize, reach: i32) -> Vec<i16> {
    let (columns, lines) = (width as i32, (map.len() / width) as i32);
    let mut output = map.to_vec();
    for y in 0..lines {
        for x in 0..columns {
            let mut window = Vec::new();
            for v in (y - reach).max(0)..=(y + reach).min(lines - 1) {
                for u in (x - reach).max(0)..=(x + reach).min(columns - 1) {
                    window.push(map[(v * columns + u) as usize]);
                }
            }
            window.retain(|&d| d != INVALID);
            window.sort_unstable();
            let centre = (y * columns + x) as usize;
            if map[centre] != INVALID {
                output[centre] = window[(window.len() - 1) / 2];
            }
        }
    }
    output
}
