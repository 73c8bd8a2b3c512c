//! The plan: memory, latency and the lines that each part keeps, from a configuration.
//!
//! Each part of the pipeline states its demand, and the plan adds them up. All of it is `const`, so
//! that a board can size its memory, and refuse a configuration, when its program is built.

use crate::config::{Config, Method, Parameters};
use crate::disparity::DisparityRange;
use crate::recall::{RecallMatcher, RecallRefiner};
use crate::rows::{Part, Parts};
use crate::sgm::{SgmPlan, SgmRefiner};

/// Memory, latency and lines kept of a matcher of one configuration, part by part.
///
/// ```
/// use vgstereo_core::{Config, DisparityRange, Plan, Preset};
///
/// const CONFIG: Config = Config::new(Preset::Lite.parameters(), 320, DisparityRange::up_to(47));
/// const PLAN: Plan = Plan::new(&CONFIG);
///
/// assert!(PLAN.bytes() < 72 * 1024);
/// assert_eq!(PLAN.latency_lines(), 7);
/// let (costs, _) = PLAN.matching().iter().map(|part| (part.words, part.name)).max().unwrap();
/// assert!(4 * costs >= 2 * 320 * 48);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    matching: Parts,
    refinement: Parts,
}

impl Plan {
    /// The plan for `config`, which must be valid: see [`Config::validate`].
    #[must_use]
    pub const fn new(config: &Config) -> Self {
        match &config.parameters.method {
            Method::Recall(recall) => Self {
                matching: RecallMatcher::parts(config, recall),
                refinement: RecallRefiner::parts(config, recall),
            },
            Method::Sgm(sgm) => Self {
                matching: SgmPlan::new(config, sgm).parts(config, sgm),
                refinement: SgmRefiner::parts(config, sgm),
            },
        }
    }

    /// The parts that match a row, in the order in which a line passes them.
    #[must_use]
    pub const fn matching(&self) -> &[Part] {
        self.matching.as_slice()
    }

    /// The stages of the refinement, in the order in which a row passes them.
    #[must_use]
    pub const fn refinement(&self) -> &[Part] {
        self.refinement.as_slice()
    }

    /// Working memory of the matcher, words of 32 bits.
    #[must_use]
    pub const fn words(&self) -> usize {
        self.matching.words() + self.refinement.words()
    }

    /// Working memory of the matcher, bytes.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.words() * size_of::<u32>()
    }

    /// Lines between a pair of lines going in and its disparities coming out: pair
    /// `y + latency_lines` completes line `y`.
    #[must_use]
    pub const fn latency_lines(&self) -> u32 {
        self.matching.latency_lines() + self.refinement.latency_lines()
    }
}

impl Config {
    /// Words of 32 bits that [`Matcher::new`](crate::Matcher::new) takes; the configuration must
    /// be valid. [`Plan`] has them part by part.
    #[must_use]
    pub const fn memory_words(&self) -> usize {
        Plan::new(self).words()
    }
}

impl Parameters {
    /// Lines between a pair of lines going in and its disparities coming out, whatever the width:
    /// pair `y + latency_lines` completes line `y`.
    #[must_use]
    pub const fn latency_lines(&self) -> u32 {
        Plan::new(&Config::new(*self, 1, DisparityRange::up_to(0))).latency_lines()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;
    use crate::kernel::Portable;
    use crate::matcher::Matcher;

    #[test]
    fn a_plan_adds_up_its_parts() {
        for preset in Preset::ALL {
            for colour in [false, true] {
                let config = Config {
                    colour,
                    ..Config::new(preset.parameters(), 47, DisparityRange::up_to(20))
                };
                let plan = Plan::new(&config);
                let parts = || plan.matching().iter().chain(plan.refinement());
                let words: usize = parts().map(|part| part.words).sum();
                let latency_lines: u32 = parts().map(|part| part.latency_lines).sum();
                let demands = (plan.words(), plan.bytes(), plan.latency_lines());
                assert_eq!(demands, (words, 4 * words, latency_lines));
                assert_eq!(preset.parameters().latency_lines(), latency_lines);
                // And it is what a matcher takes, and how late it is.
                let mut memory = std::vec![0; words];
                assert!(Matcher::new(&config, Portable, &mut memory[1..]).is_err());
                let grey = Config {
                    colour: false,
                    ..config
                };
                let mut matcher = Matcher::new(&grey, Portable, &mut memory).unwrap();
                let line = [7; 47];
                for y in 0..=latency_lines {
                    let found = matcher.push(&line, &line).unwrap();
                    assert_eq!(found.is_some(), y == latency_lines, "{preset}, line {y}");
                }
            }
        }
    }
}
