//! Choice of a kernel set at run time.

use vgstereo_core::kernel::{Kernels, Portable};
use vgstereo_core::kernel_methods;

/// Defines [`NativeKernels`] over the listed sets, slowest first. Each is given by its name, its
/// type, whose `detect` returns a value if the processor can run it, and the targets that have it.
macro_rules! native_sets {
    ($($name:literal: $Set:ident($Kernels:path) if $target:meta;)+) => {
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        enum Set {
            Portable,
            $(#[cfg($target)] $Set($Kernels),)+
        }

        impl NativeKernels {
            /// The sets that this processor can run, slowest first; the first is the reference.
            pub fn available() -> impl DoubleEndedIterator<Item = Self> + use<> {
                let sets = [
                    Some(Set::Portable),
                    $(#[cfg($target)] <$Kernels>::detect().map(Set::$Set),)+
                ];
                sets.into_iter().flatten().map(Self)
            }

            /// Name of the set, in lower case.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self.0 {
                    Set::Portable => "portable",
                    $(#[cfg($target)] Set::$Set(_) => $name,)+
                }
            }
        }

        impl Kernels for NativeKernels {
            // One fused set on this target suffices for `true`: the reference is as fast either
            // way.
            const FUSES_SELECTION: bool = any(&[
                Portable::FUSES_SELECTION,
                $(#[cfg($target)] <$Kernels as Kernels>::FUSES_SELECTION,)+
            ]);

            kernel_methods!([dispatch] { $($Set if $target;)+ });
        }
    };
}

const fn any(flags: &[bool]) -> bool {
    match flags {
        [] => false,
        [first, rest @ ..] => *first || any(rest),
    }
}

/// Writes a method that calls the kernel of the chosen set.
macro_rules! dispatch {
    ({ $($Set:ident if $target:meta;)+ } $kernel:ident ($($parameters:tt)+) $arguments:tt) => {
        // Not inlined: a call per row is cheap, and a profile tells kernels apart.
        fn $kernel(&self, $($parameters)+) {
            match self.0 {
                Set::Portable => Portable.$kernel $arguments,
                $(#[cfg($target)] Set::$Set(set) => set.$kernel $arguments,)+
            }
        }
    };
}

/// A kernel set that this processor can run.
///
/// The field is private, so that a value exists only for a set that was detected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NativeKernels(Set);

impl NativeKernels {
    /// Returns the fastest set that this processor can run.
    #[must_use]
    pub fn fastest() -> Self {
        Self::available().next_back().unwrap_or(Self(Set::Portable))
    }
}

native_sets! {
    "neon": Neon(crate::aarch64::Neon) if all(target_arch = "aarch64", target_feature = "neon");
    "avx2": Avx2(crate::x86_64::Avx2) if all(target_arch = "x86_64", feature = "std");
    "avx512": Avx512(crate::x86_64::Avx512) if all(target_arch = "x86_64", feature = "std");
}
