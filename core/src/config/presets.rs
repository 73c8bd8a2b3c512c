//! The presets as types, for programs that have no other: see [`Only`](crate::Only).

use super::{Parameters, Preset};
use crate::kernel::{DrawnSynapses, Scope, Scoped};

/// Writes the type of a preset, with its synapses if they are stored.
macro_rules! types {
    ($($preset:ident: $offsets:expr),+ $(,)?) => {
        $(
            #[doc = concat!("[`Preset::", stringify!($preset), "`], for any disparities, and for lines with and without")]
            #[doc = "colour, rectified before or on their way to the matcher."]
            #[derive(Debug, Clone, Copy)]
            pub struct $preset;

            impl Scoped for $preset {
                const SCOPE: Scope = scope(&Preset::$preset.parameters(), $offsets);
            }
        )+
    };
}

types! {
    PaperRaw: None,
    Paper: None,
    Lite: Some(&LITE_OFFSETS),
    Micro: Some(&MICRO_OFFSETS),
    Balanced: None,
    Quality: None,
}

const fn scope(parameters: &Parameters, offsets: Option<&'static [[i8; 2]]>) -> Scope {
    let drawn = match offsets {
        Some(offsets) => Some(DrawnSynapses {
            law: parameters.synapse_law(),
            offsets,
        }),
        None => None,
    };
    Scope {
        drawn,
        ..parameters.scope()
    }
}

/// The synapses of [`Preset::Lite`].
const LITE_OFFSETS: [[i8; 2]; 32] = [
    [-4, 0],
    [0, 0],
    [1, 1],
    [1, 0],
    [-1, 3],
    [0, 3],
    [-1, 0],
    [-1, -1],
    [0, 1],
    [1, 2],
    [-1, 0],
    [1, 0],
    [1, -3],
    [5, -3],
    [4, 0],
    [3, 0],
    [0, 0],
    [-1, 2],
    [0, 0],
    [0, -1],
    [2, 0],
    [1, 0],
    [-2, 1],
    [-2, -2],
    [1, -1],
    [1, 0],
    [1, -2],
    [0, -1],
    [0, 1],
    [0, 1],
    [-1, -1],
    [1, 0],
];

/// The synapses of [`Preset::Micro`].
const MICRO_OFFSETS: [[i8; 2]; 48] = [
    [-5, 0],
    [2, 1],
    [0, 1],
    [1, 1],
    [2, 1],
    [2, 0],
    [-4, -1],
    [0, 3],
    [-1, 0],
    [-2, -1],
    [1, 1],
    [-1, -3],
    [1, 3],
    [-1, 0],
    [2, 0],
    [7, -3],
    [-3, 1],
    [3, 3],
    [1, 3],
    [0, -2],
    [-6, -1],
    [-3, 3],
    [-3, -2],
    [-5, 2],
    [0, 2],
    [1, 0],
    [-1, 0],
    [1, 0],
    [0, 0],
    [-1, 2],
    [1, -2],
    [0, 0],
    [0, -1],
    [1, 0],
    [1, 0],
    [-1, 1],
    [-1, -1],
    [1, -1],
    [1, 0],
    [1, -2],
    [0, -1],
    [0, 1],
    [0, 1],
    [-1, -1],
    [1, 0],
    [1, 1],
    [1, -1],
    [0, 0],
];
