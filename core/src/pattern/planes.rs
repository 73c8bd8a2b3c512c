//! The patterns of a row of neurons, as byte planes.
//!
//! Paper, Section III: synapse `r` forms a Minchinton cell with synapse `r + 1`, the last with
//! the first; the cell is 1 when the sample of `r` is greater than that of its partner, else 0.
//! The |W| bits are the neuron's input pattern.

use super::synapse::Synapses;
use crate::kernel::{CELLS_PER_BYTE, Kernels, LANES, Planes};
use crate::rows::{Arena, OutOfMemory, Strip, StripWindow};

/// The patterns of one row of neurons, in byte planes: see [`Planes`].
///
/// Neighbouring positions are neighbouring bytes, so a vector register of any width holds one
/// byte of as many patterns as it has lanes. Each plane ends in [`LANES`] bytes that a kernel may
/// read, but that mean nothing.
#[derive(Debug)]
pub struct PatternRow<'m> {
    planes: &'m mut [u8],
    stride: usize,
    count: usize,
}

impl<'m> PatternRow<'m> {
    /// Bytes for `width` patterns of `synapses` cells.
    #[must_use]
    pub const fn bytes(width: usize, synapses: usize) -> usize {
        (width + LANES) * (synapses / CELLS_PER_BYTE)
    }

    /// Patterns of `synapses` cells for `width` neurons.
    ///
    /// # Errors
    /// [`OutOfMemory`] when the arena has less than [`PatternRow::bytes`] left.
    pub fn new(width: usize, synapses: usize, arena: &mut Arena<'m>) -> Result<Self, OutOfMemory> {
        let bytes = arena.take(Self::bytes(width, synapses))?;
        Ok(Self::over(bytes, width, synapses))
    }

    /// Patterns in `bytes`, at least [`PatternRow::bytes`] of them, whatever they hold.
    #[must_use]
    pub fn over(bytes: &'m mut [u8], width: usize, synapses: usize) -> Self {
        let used = Self::bytes(width, synapses).min(bytes.len());
        Self {
            planes: bytes.split_at_mut(used).0,
            stride: width + LANES,
            count: synapses / CELLS_PER_BYTE,
        }
    }

    /// Forms the patterns of `count` neurons of line `line`, from stored position `first` of the
    /// strips on, and packs them at positions 0 to `count - 1`. The first half of the synapses
    /// samples the first strip, the second half the second.
    ///
    /// Positions count in the order in which the strips store their pixels.
    pub fn observe(
        &mut self,
        strips: [&Strip<'_>; 2],
        synapses: &Synapses<'_>,
        line: u32,
        first: usize,
        count: usize,
        kernels: &impl Kernels,
    ) {
        let [near, far] = strips.map(|strip| strip.window(line));
        let half = synapses.len() / 2;
        let near_bytes = half / CELLS_PER_BYTE * self.stride;
        let (near_planes, far_planes) = self
            .planes
            .split_at_mut_checked(near_bytes)
            .unwrap_or_default();
        let pack = |window, half_synapses, planes, after| {
            let half = Half {
                window,
                synapses: half_synapses,
                first,
                count,
            };
            half.pack(planes, self.stride, after, kernels)
        };
        // The last synapse's partner is the first.
        let start = synapses.iter().next();
        let start = start.map_or(&[][..], |offset| near.samples(offset, first, count));
        let middle = pack(far, synapses.group(1, half), far_planes, start);
        pack(near, synapses.group(0, half), near_planes, middle);
    }

    /// Moves the first `count` patterns so that they begin at position `front`, and fills the
    /// positions before them with the first pattern and those after them, up to `positions`, with
    /// the last.
    pub fn extend(&mut self, count: usize, front: usize, positions: usize) {
        if count == 0 || front + count > positions || positions + LANES > self.stride {
            return;
        }
        let last = count - 1;
        for plane in self.planes.chunks_exact_mut(self.stride.max(1)) {
            let (Some(&first_byte), Some(&last_byte)) = (plane.first(), plane.get(last)) else {
                return;
            };
            // From the end, because the runs overlap. If no disparity is negative, the two runs are
            // the same.
            for x in (0..count).rev().take_while(|_| front > 0) {
                let byte = plane.get(x).copied();
                if let (Some(to), Some(byte)) = (plane.get_mut(front + x), byte) {
                    *to = byte;
                }
            }
            if let Some(before) = plane.get_mut(..front) {
                before.fill(first_byte);
            }
            if let Some(behind) = plane.get_mut(front + count..positions) {
                behind.fill(last_byte);
            }
        }
    }

    /// The planes, as kernels take them.
    #[must_use]
    pub fn planes(&self) -> Planes<'_> {
        Planes {
            bytes: self.planes,
            stride: self.stride,
            count: self.count,
        }
    }
}

/// Half of the synapses of a row of neurons.
struct Half<'a> {
    /// The lines that these synapses sample.
    window: StripWindow<'a>,
    synapses: Synapses<'a>,
    /// Stored position of the first neuron.
    first: usize,
    /// Number of neurons.
    count: usize,
}

impl<'a> Half<'a> {
    /// Packs the cells of these synapses to planes of `stride` bytes. `after` are the samples of the synapse after the
    /// last; returns those of the first.
    // In one place for both halves, as it is large.
    #[inline(never)]
    fn pack(
        &self,
        planes: &mut [u8],
        stride: usize,
        after: &'a [u8],
        kernels: &impl Kernels,
    ) -> &'a [u8] {
        let mut after = after;
        let planes = planes.chunks_exact_mut(stride.max(1));
        // Nine samples make eight cells; the ninth is the first of the next byte, which is packed before.
        for (byte, plane) in planes.enumerate().rev() {
            let mut group = [after; CELLS_PER_BYTE + 1];
            let offsets = self.synapses.group(byte, CELLS_PER_BYTE);
            for (samples, offset) in group.iter_mut().zip(offsets.iter()) {
                *samples = self.window.samples(offset, self.first, self.count);
            }
            after = group[0];
            if let Some(plane) = plane.get_mut(..self.count) {
                kernels.pack_cells(&group, plane);
            }
        }
        after
    }
}
