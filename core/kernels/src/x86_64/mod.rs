//! Kernels for x86-64 with AVX2, whose registers have 32 bytes, and with AVX-512, whose registers
//! have 64.
//!
//! Both sets share the loops of the kernels that they have in vector registers: a file in this
//! folder is a macro, or holds what both need, and the folder of each set has the operations on its
//! registers. All other kernels are the references, compiled for the set's instructions.
#![allow(unsafe_code)]

/// Writes methods of an implementation of [`Kernels`](vgstereo_core::kernel::Kernels) for a set
/// whose values exist only if its `$features` were detected. The methods of `own` kernels call the
/// function given; those of `reference` kernels compile core's function of that name for the
/// features, which works because it is always inlined.
macro_rules! compiled_for {
    ($features:literal, own { $($kernel:ident => $function:path),+ $(,)? }) => {
        $(vgstereo_core::kernel_methods!([compile] { $features, $function }: $kernel);)+
    };
    ($features:literal, reference { $($kernel:ident),+ $(,)? }) => {
        $(vgstereo_core::kernel_methods!(
            [compile] { $features, vgstereo_core::kernel::$kernel }: $kernel
        );)+
    };
}

macro_rules! compile {
    ({ $features:literal, $function:path } $kernel:ident ($($parameters:tt)+) $arguments:tt) => {
        #[inline]
        fn $kernel(&self, $($parameters)+) {
            #[target_feature(enable = $features)]
            fn compiled($($parameters)+) {
                $function $arguments;
            }
            // SAFETY: a value of this set exists only where its features were detected.
            unsafe { compiled $arguments };
        }
    };
}

mod aggregate;
mod avx2;
mod avx512;
mod cost;
mod mask;
mod unpack;
mod weighted_median;

pub use avx2::Avx2;
pub use avx512::Avx512;
