//! The kernels of the preset that this firmware is for, with those of the stereo unit (`rtl/stereo_unit.sv`).

use core::sync::atomic::{Ordering, compiler_fence};

use vgstereo_core::forward_kernels;
use vgstereo_core::kernel::Kernels;
use vgstereo_kernels::{Port, Rv32, StereoUnit};

use crate::board::BoardKernels;
use crate::registers::Register;

/// The unit's registers.
#[derive(Clone, Copy)]
struct Registers(());

/// Address of the unit's registers, and their bytes.
const FIRST: usize = 0x8400_0000;
const SIZE: usize = 0x2000;

/// The register at this offset from the unit's first.
#[inline(always)]
fn register(offset: usize) -> Register {
    let offset = offset & (SIZE - 4);
    // SAFETY: this is the address that `rtl/soc.sv` gives the unit, which writes no memory. It has a word at
    // each place of this range.
    unsafe { Register::at(FIRST + offset) }
}

impl Port for Registers {
    #[inline(always)]
    fn read(self, offset: usize) -> u32 {
        register(offset).read()
    }

    #[inline(always)]
    fn read_words(self, offset: usize, count: usize) -> impl Iterator<Item = u32> {
        // The offset is brought into the range once, not for each word.
        let first = offset & (SIZE - 4);
        let count = count.min((SIZE - first) / 4);
        (0..count).map(move |index| {
            // SAFETY: as in `register`, with an offset less than `SIZE`, a multiple of 4.
            unsafe { Register::at(FIRST + first + 4 * index) }.read()
        })
    }

    #[inline(always)]
    fn write(self, offset: usize, value: u32) {
        register(offset).write(value);
    }

    #[inline(always)]
    fn address(self, bytes: &[u8]) -> u32 {
        // The cache writes through, so that what the compiler has stored is in memory.
        compiler_fence(Ordering::SeqCst);
        bytes.as_ptr().expose_provenance() as u32
    }
}

/// [`StereoUnit`], and [`Rv32`] for what that has not.
#[derive(Clone, Copy)]
pub(crate) struct UnitKernels(StereoUnit<Registers>);

impl UnitKernels {
    pub(crate) fn new() -> Self {
        Self(StereoUnit::new(Registers(())))
    }
}

impl Kernels for UnitKernels {
    const FUSES_SELECTION: bool = true;

    forward_kernels!(set => &set.0; convert_row, smooth_row, pack_cells, cost_run, rivals_row, attenuate_row, penalty_row, aggregate_row,
        median9_row);
    // `lite` uses no others, and calls neither paths nor selection alone.
    forward_kernels!(set => &Rv32; luma_row, channel_row, check_row);
    forward_kernels!(set => &set.0; aggregate_paths, select_row, resample_row, mask_block, recall_row, arms_row,
        weighted_median_row);
}

impl BoardKernels for UnitKernels {
    fn fit(&self, width: usize, disparities: usize) -> bool {
        self.0.fits(width, disparities)
    }
}
