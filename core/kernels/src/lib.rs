//! Faster kernel sets for vgstereo: the inner loops of `vgstereo-core`, each set for one
//! instruction set.
//!
//! Every set implements [`Kernels`](vgstereo_core::kernel::Kernels) and equals the reference,
//! [`Portable`](vgstereo_core::kernel::Portable), bit for bit. [`Armv7em`], [`Rv32`], [`Rv32Bytes`] and [`Rv32Xpulp`] are
//! for microcontrollers; the last three are not there where neither a RISC-V processor nor an operating system is. `Helium`
//! is there where the compiler's flags name a processor with these instructions. [`NativeKernels`] is for programs that
//! learn only at run time which instructions the processor has.
//!
//! Each folder holds the kernels of one instruction set; its files are named as those of
//! `vgstereo_core::kernel`. Its `mod.rs` lists which kernels are the set's own and which it
//! forwards to another set.
#![no_std]
#![deny(unsafe_code)]
#![warn(unreachable_pub, clippy::undocumented_unsafe_blocks)]

#[cfg(any(test, feature = "cases"))]
extern crate alloc;
#[cfg(any(test, feature = "std"))]
extern crate std;

#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
pub mod aarch64;
mod armv7em;
#[cfg(feature = "cases")]
#[doc(hidden)]
pub mod cases;
#[cfg(helium)]
#[allow(unsafe_code)]
mod helium;
mod native;
#[cfg(rv32)]
mod rv32;
#[cfg(rv32_bytes)]
mod rv32_bytes;
#[cfg(rv32_xpulp)]
mod rv32_xpulp;
mod stereo_unit;
#[cfg(all(target_arch = "x86_64", feature = "std"))]
pub mod x86_64;
// Some are used only by kernels of `armv7em`, and there only on the processor that has them.
#[cfg_attr(not(xpulp), allow(dead_code))]
#[allow(unsafe_code)]
mod xpulp;

pub use armv7em::Armv7em;
#[cfg(helium)]
pub use helium::Helium;
pub use native::NativeKernels;
#[cfg(rv32)]
pub use rv32::Rv32;
#[cfg(rv32_bytes)]
pub use rv32_bytes::Rv32Bytes;
#[cfg(all(rv32_bytes, feature = "cases"))]
#[doc(hidden)]
pub use rv32_bytes::byte_instruction;
#[cfg(rv32_xpulp)]
pub use rv32_xpulp::Rv32Xpulp;
pub use stereo_unit::{Port, StereoUnit};
