//! Scopes: the configurations that a program is compiled for, as constants by which the compiler leaves out the rest.

use core::marker::PhantomData;

use super::{Kernels, forward_kernels};

/// Configurations that a matcher is compiled for: those that ask for nothing else.
///
/// A matcher takes it from its kernel set ([`Kernels::SCOPE`]) and refuses every other
/// configuration. As it is a constant, the compiler leaves out the code of what it excludes, the kernels included.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scope {
    /// Whether patterns may be recalled, as in the paper.
    pub recall: bool,
    /// Whether costs of patterns may be aggregated semi-globally (SGM).
    pub sgm: bool,
    /// The only number of synapses; `None` allows every number.
    pub synapses: Option<u16>,
    /// The only offsets of synapses, drawn before; `None` allows all, which are drawn when a matcher is built.
    pub drawn: Option<DrawnSynapses>,
    /// The only number of disparities; `None` allows every number.
    pub disparities: Option<u16>,
    /// Whether cells may be masked.
    pub masks: bool,
    /// Whether pixels may be filled by a vote of their region.
    pub region_vote: bool,
    /// Whether disparities may be filtered by a weighted median.
    pub weighted_median: bool,
    /// Whether SGM may use the colour of lines.
    pub colour: bool,
    /// Whether lines may be rectified on their way to the matcher.
    pub rectification: bool,
}

impl Scope {
    /// Every configuration.
    pub const ALL: Self = Self {
        recall: true,
        sgm: true,
        synapses: None,
        drawn: None,
        disparities: None,
        masks: true,
        region_vote: true,
        weighted_median: true,
        colour: true,
        rectification: true,
    };

    /// Number of channels in use of a view that has so many: the same, and without colour 1, which the compiler knows.
    #[must_use]
    pub const fn channels(&self, of_view: usize) -> usize {
        if self.colour { of_view } else { 1 }
    }

    /// Whether this scope has all that `other` has.
    #[must_use]
    pub const fn contains(&self, other: &Self) -> bool {
        let has_drawn = match (self.drawn, other.drawn) {
            (None, _) => true,
            (Some(own), Some(other)) => own.law.is(&other.law),
            (Some(_), None) => false,
        };
        has_drawn
            && allows(self.synapses, other.synapses)
            && allows(self.disparities, other.disparities)
            && (self.recall || !other.recall)
            && (self.sgm || !other.sgm)
            && (self.masks || !other.masks)
            && (self.region_vote || !other.region_vote)
            && (self.weighted_median || !other.weighted_median)
            && (self.colour || !other.colour)
            && (self.rectification || !other.rectification)
    }
}

/// What the offsets of a neuron's synapses are drawn from. Those of the same law are the same.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SynapseLaw {
    /// Standard deviations of both halves, px.
    pub sigmas_px: [f32; 2],
    /// Largest distance between the samples of a cell, px; 0 for any.
    pub cell_length_max_px: u8,
    /// Largest offsets along and across lines, px.
    pub support_px: [u8; 2],
    /// Seed of the generator.
    pub seed: u64,
}

impl SynapseLaw {
    /// Whether both are the same. `PartialEq` cannot be asked in a `const`.
    #[must_use]
    pub const fn is(&self, other: &Self) -> bool {
        self.seed == other.seed
            && self.cell_length_max_px == other.cell_length_max_px
            && self.support_px[0] == other.support_px[0]
            && self.support_px[1] == other.support_px[1]
            && self.sigmas_px[0] == other.sigmas_px[0]
            && self.sigmas_px[1] == other.sigmas_px[1]
    }
}

/// Offsets of synapses that were drawn before a program is built, which then needs no code to draw them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DrawnSynapses {
    /// What they were drawn from.
    pub law: SynapseLaw,
    /// The offsets, to the right and down, px.
    pub offsets: &'static [[i8; 2]],
}

/// Whether the only number that `own` allows is that of `other`.
const fn allows(own: Option<u16>, other: Option<u16>) -> bool {
    match (own, other) {
        (None, _) => true,
        (Some(own), Some(other)) => own == other,
        (Some(_), None) => false,
    }
}

/// A type that stands for a scope.
pub trait Scoped: Copy {
    /// The scope.
    const SCOPE: Scope;
}

/// A kernel set with which a matcher is compiled only for the configurations in the scope of `S`, such as those of
/// [`Lite`](crate::presets::Lite).
///
/// ```
/// use vgstereo_core::{Config, ConfigError, DisparityRange, Matcher, Only, Portable, Preset, presets};
///
/// let mut memory = vec![0; 64 * 1024];
/// let config = |preset: Preset| Config::new(preset.parameters(), 64, DisparityRange::up_to(15));
/// let kernels = Only::<_, presets::Lite>::new(Portable);
/// assert!(Matcher::new(&config(Preset::Lite), kernels, &mut memory).is_ok());
/// let refused = Matcher::new(&config(Preset::Micro), kernels, &mut memory);
/// assert_eq!(refused.unwrap_err(), ConfigError::Scope);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Only<K, S> {
    kernels: K,
    scope: PhantomData<S>,
}

impl<K, S> Only<K, S> {
    /// The kernels of `kernels`, in this scope.
    #[must_use]
    pub const fn new(kernels: K) -> Self {
        Self {
            kernels,
            scope: PhantomData,
        }
    }
}

impl<K: Kernels, S: Scoped> Kernels for Only<K, S> {
    const FUSES_SELECTION: bool = K::FUSES_SELECTION;
    const SCOPE: Scope = {
        assert!(
            K::SCOPE.contains(&S::SCOPE),
            "the set is not compiled for all of this scope"
        );
        S::SCOPE
    };

    forward_kernels!(set => &set.kernels; luma_row, channel_row, resample_row, convert_row, smooth_row, pack_cells,
        recall_row, mask_block, cost_run, penalty_row, aggregate_paths, select_row, aggregate_row, rivals_row, attenuate_row,
        check_row, arms_row, median9_row, weighted_median_row);
}
