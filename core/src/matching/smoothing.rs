//! Smoothing: half of the samples are taken where noise is averaged away.
//!
//! Where texture is faint, noise decides the cells. A level becomes the binomial mean of its
//! neighbourhood of 3 x 3, in which a neighbour that is more than a step away counts as the
//! level itself, so that edges stay (the sigma filter of Lee 1983, with fixed weights). Fine
//! texture that noise would not have drowned goes as well: only the samples of the first
//! sigma, the larger one, see it like that, the others see lines as they came.

use crate::config::Config;
use crate::kernel::Kernels;
use crate::memory::{Arena, OutOfMemory};
use crate::neighbours::neighbours;
use crate::strip::{Order, Strip};

/// The two views' grey once more, smoothed. The newest line stands as it came until the one
/// below it comes.
#[derive(Debug)]
pub(super) struct SmoothedStrips<'m> {
    pub(super) reference: Strip<'m>,
    pub(super) other: Strip<'m>,
    step_max: u8,
}

impl<'m> SmoothedStrips<'m> {
    /// Words of memory: two strips of the support.
    pub(super) const fn memory_words(config: &Config) -> usize {
        let support = config.parameters.support;
        let (width, padding) = (config.width as usize, support.x_px as usize);
        2 * Strip::memory_words(width, padding, Strip::depth(support))
    }

    /// Empty strips; steps of up to `step_max` levels are smoothed.
    pub(super) fn new(
        config: &Config,
        step_max: u8,
        orders: [Order; 2],
        arena: &mut Arena<'m>,
    ) -> Result<Self, OutOfMemory> {
        let support = config.parameters.support;
        let (width, padding) = (usize::from(config.width), usize::from(support.x_px));
        let mut strip = |order| Strip::new(width, padding, Strip::depth(support), order, arena);
        let [order, other_order] = orders;
        Ok(Self {
            reference: strip(order)?,
            other: strip(other_order)?,
            step_max,
        })
    }

    /// Forgets the frame.
    pub(super) fn clear(&mut self) {
        self.reference.clear();
        self.other.clear();
    }

    /// Takes the newest line of each view, and smooths the one above it. A line that was moved
    /// since is smoothed as it stands now.
    pub(super) fn follow(
        &mut self,
        reference: &Strip<'_>,
        other: &Strip<'_>,
        kernels: &impl Kernels,
    ) {
        let followers = [(&mut self.reference, reference), (&mut self.other, other)];
        for (smoothed, strip) in followers {
            let Some(newest) = strip.lines().checked_sub(1) else {
                continue;
            };
            if let Some(line) = newest.checked_sub(1) {
                // The padding of a strip is at least a pixel where lines are smoothed.
                let around = [line.saturating_sub(1), line, newest].map(|line| strip.padded(line));
                smoothed.store(line, |levels| {
                    kernels.smooth_row(around, self.step_max, levels);
                });
            }
            smoothed.store(newest, |levels| {
                let came = strip.row(newest);
                if let Some(levels) = levels.get_mut(..came.len()) {
                    levels.copy_from_slice(came);
                }
            });
        }
    }
}

/// Smooths each pixel of `smoothed`; the rows above, of and below it have a pixel more at both
/// ends. Inlined so that a caller may compile it for its own instruction set.
///
/// The mean is formed by halves of sums, rounded down, as registers of bytes do: of the
/// corners by columns and of the edges by line and column, then of the level and its corners,
/// and of that and the edges.
#[inline(always)]
pub fn smooth_row(rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]) {
    let width = smoothed.len();
    let Some([[a, b, c], [d, e, f], [g, h, i]]) = neighbours(rows, width) else {
        return;
    };
    // Equal lengths, proven once: no check is left in the loop.
    let (a, b, c) = (&a[..width], &b[..width], &c[..width]);
    let (d, e, f) = (&d[..width], &e[..width], &f[..width]);
    let (g, h, i) = (&g[..width], &h[..width], &i[..width]);
    for x in 0..width {
        let own = e[x];
        let near = |level: u8| {
            let step = level.saturating_sub(own) | own.saturating_sub(level);
            if step <= step_max { level } else { own }
        };
        let corners = midpoint(
            midpoint(near(a[x]), near(c[x])),
            midpoint(near(g[x]), near(i[x])),
        );
        let edges = midpoint(
            midpoint(near(b[x]), near(h[x])),
            midpoint(near(d[x]), near(f[x])),
        );
        smoothed[x] = midpoint(edges, midpoint(own, corners));
    }
}

/// Half of the sum, in a form that stays 8 bits wide in vector code.
#[inline(always)]
const fn midpoint(a: u8, b: u8) -> u8 {
    (a & b) + ((a ^ b) >> 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smoothed(rows: [[u8; 5]; 3], step_max: u8) -> [u8; 3] {
        let mut smoothed = [0; 3];
        smooth_row(rows.each_ref().map(|row| &row[..]), step_max, &mut smoothed);
        smoothed
    }

    #[test]
    fn noise_goes_and_edges_stay() {
        // A ramp and a flat line stay; a single level is a quarter of itself afterwards.
        assert_eq!(smoothed([[8, 10, 12, 14, 16]; 3], 4), [10, 12, 14]);
        let flat = [20; 5];
        assert_eq!(
            smoothed([flat, [20, 20, 24, 20, 20], flat], 4),
            [20, 21, 20]
        );
        // Of a step of more than is smoothed, both sides stay.
        assert_eq!(smoothed([[20, 20, 20, 90, 90]; 3], 4), [20, 20, 90]);
        // At its largest, levels of both ends are in the mean; at 0, none but the own.
        assert_eq!(smoothed([[0, 0, 255, 0, 0]; 3], u8::MAX), [63, 127, 63]);
        assert_eq!(
            smoothed([flat, [20, 20, 24, 20, 20], flat], 0),
            [20, 24, 20]
        );
    }
}
