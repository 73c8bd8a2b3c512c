//! The plan of the SGM method: the lines and bytes that each part needs.

use super::masks::SgmMasks;
use super::refine::SgmRefiner;
use super::rivals::Rivals;
use crate::config::{Config, SgmParameters};
use crate::disparity::Reference;
use crate::kernel::{cost_stride, path_scratch_bytes};
use crate::pattern::{PatternRow, Sampler};
use crate::rows::{Order, Part, Parts, ViewSize, words};

/// Sizes and depths of the SGM branch, derived once from a configuration.
#[derive(Debug, Clone, Copy)]
pub struct SgmPlan {
    /// Columns, px.
    pub(super) width: usize,
    /// Bytes from the costs of one pixel to those of the next.
    pub(super) stride: usize,
    /// Stored positions before the first pixel of the other view, for negative disparities.
    pub(super) front: usize,
    /// Number of stored positions that any disparity of any pixel reaches.
    pub(super) positions: usize,
    /// Stored position of the lowest disparity of the last pixel.
    pub(super) last_position: usize,
    /// Shape of the reference view.
    pub(super) reference: ViewSize,
    /// Shape of the other view.
    pub(super) other: ViewSize,
    /// Bytes of one of the two rows of levels of the other view, all channels.
    pub(super) level_bytes: usize,
    /// Bytes of the path costs from the right, which share their memory with the inputs of the
    /// matching costs.
    pub(super) right_path_bytes: usize,
}

impl SgmPlan {
    /// The plan for a valid configuration with these parameters.
    #[must_use]
    pub const fn new(config: &Config, sgm: &SgmParameters) -> Self {
        let parameters = &config.parameters;
        let support = parameters.support;
        let synapses = parameters.synapses as usize;
        let width = config.width as usize;
        let stride = cost_stride(config.disparities.count as usize);
        let minimum = config.disparities.minimum_px as isize;
        let front = if minimum < 0 {
            minimum.unsigned_abs()
        } else {
            0
        };
        let behind = if minimum > 0 {
            minimum.unsigned_abs()
        } else {
            0
        };
        let positions = front + width + behind + stride;

        let moving_lines = sgm.moving_lines() as usize;
        let moving_latency = sgm.moving_latency_lines() as usize;
        let ahead = Self::lines_ahead(config, sgm);
        let window = Sampler::window_lines(support.y_px) + moving_latency;
        // The penalties of the path from above need the line above a row.
        let matching_lines = max(window, ahead as usize + 2);
        let refinement_lines = Self::refinement_depth(config, sgm);
        let lines = max(matching_lines, refinement_lines);
        let median_padding = match &sgm.weighted_median {
            Some(median) => median.reach_x_px as usize,
            None => 0,
        };
        let padding = max(support.x_px as usize, median_padding);
        let has_colour = sgm.colour && config.colour;
        let smoothing_step = if support.x_px > 0 && support.y_px > 0 {
            sgm.smoothing_step
        } else {
            // Smoothing needs a line below and pixels beside a pixel in the support.
            0
        };
        let reference = ViewSize {
            width,
            // If there is colour, the refinement uses that.
            grey_lines: if has_colour { matching_lines } else { lines },
            grey_padding: if has_colour {
                support.x_px as usize
            } else {
                padding
            },
            colour_lines: if has_colour { lines } else { 0 },
            colour_padding: padding,
            smoothed_lines: if smoothing_step > 0 { window } else { 0 },
            smoothed_padding: support.x_px as usize,
            smoothing_step,
            moving_lines: 0,
            smoothing_latency_lines: moving_latency,
            // As colour of the other view.
            valid_lines: ahead as usize + 1,
        };
        let other = ViewSize {
            // Pixels wait in their line for as many more.
            grey_lines: max(window, moving_lines + 1),
            grey_padding: support.x_px as usize,
            // The lines from the newest down to the row.
            colour_lines: if has_colour {
                max(ahead as usize, moving_lines) + 1
            } else {
                0
            },
            colour_padding: 0,
            moving_lines,
            ..reference
        };
        let level_bytes = if sgm.difference_weight_q4 > 0 {
            reference.channels() * positions
        } else {
            0
        };
        let cost_input_bytes = 2 * level_bytes
            + PatternRow::bytes(width, synapses)
            + PatternRow::bytes(positions, synapses)
            + SgmMasks::scratch_bytes(config, sgm);
        Self {
            width,
            stride,
            front,
            positions,
            last_position: front.saturating_add_signed(minimum),
            reference,
            other,
            level_bytes,
            right_path_bytes: max(width * stride, cost_input_bytes),
        }
    }

    /// Number of lines that must come after a line before its row is matched: those that patterns sample, and
    /// those that pixels wait for to be moved.
    pub(crate) const fn lines_ahead(config: &Config, sgm: &SgmParameters) -> u32 {
        config.parameters.support.y_px as u32 + sgm.moving_latency_lines() as u32
    }

    /// Number of lines of the reference view, from the newest, that the refinement reads.
    const fn refinement_depth(config: &Config, sgm: &SgmParameters) -> usize {
        // Number of lines from the newest to the row that enters the stage.
        let mut delay = Self::lines_ahead(config, sgm) as usize;
        let mut depth = 0;
        let stages = SgmRefiner::stages(config, sgm);
        let mut rest = stages.as_slice();
        while let Some((stage, after)) = rest.split_first() {
            if stage.look_back_lines > 0 {
                depth = max(depth, delay + stage.look_back_lines as usize + 1);
            }
            delay += stage.latency_lines as usize;
            rest = after;
        }
        // Below a region, lines wait until they are due, and the first must still be there when the
        // last is.
        max(depth, delay + 1)
    }

    /// Shape of a view that has only the channels of the reference view that the refinement and the
    /// masks use, for a refinement that runs apart from its matcher.
    #[must_use]
    pub const fn refinement_view(&self) -> ViewSize {
        ViewSize {
            grey_lines: if self.reference.colour_lines > 0 {
                0
            } else {
                self.reference.grey_lines
            },
            smoothed_lines: 0,
            valid_lines: 0,
            ..self.reference
        }
    }

    /// Orders in which the reference view and the other are stored: rising disparities must be
    /// rising positions, so that the views run against each other.
    #[must_use]
    pub const fn orders(reference: Reference) -> [Order; 2] {
        match reference {
            Reference::Left => [Order::Columns, Order::Mirrored],
            Reference::Right => [Order::Mirrored, Order::Columns],
        }
    }

    /// The parts of the matcher. With `W` columns, `D` disparities rounded up to 16, `n`
    /// synapses, support `(X, Y)`, `c` channels and `P = W + D` and the magnitude of the lowest
    /// disparity, they take, each rounded up to words; a row is matched when `A` lines below it have come, `Y`
    /// and one for each line but the first that pixels are moved by:
    ///
    /// | part | bytes |
    /// |---|---|
    /// | synapses | `4 n`: offsets, and the cost of a cell by the number of unmasked ones |
    /// | views | grey: `2 (Y + A + 1) (W + 2 X)`, and as much again where lines are smoothed; in colour three channels besides, of the reference view as deep as the last stage looks back and `A + 1` lines of the other; `W` per channel and grey for each line that pixels are moved by; `8 (A + 1)` for what the cameras saw of each line |
    /// | masks, unless every cell counts | `8 n` |
    /// | costs and paths | `2 W D + 5 D + 2 W + 6` |
    /// | paths from the right, and before them patterns, levels of the other view and cells of the masks | the larger of `W D` and `(W + P + 32) n / 8 + 2 c P + 32 n`, without `2 c P` where levels do not count and without `32 n` where every cell does |
    /// | winners and checks | `13 W + 4 D` |
    /// | rivals, unless left out | `W / 4` |
    pub(crate) const fn parts(&self, config: &Config, sgm: &SgmParameters) -> Parts {
        let ahead = Self::lines_ahead(config, sgm);
        let above = config.parameters.support.y_px as u32;
        let (width, stride) = (self.width, self.stride);
        let synapses = Sampler::words(config.parameters.synapses)
            + words(config.parameters.synapses as usize + 1, size_of::<u16>());
        let costs = 2 * words(width * stride, 1)
            + 2 * words(width, 1)
            + words(path_scratch_bytes(stride), 1)
            + words(stride, size_of::<i16>());
        let winners = words(width + stride, size_of::<u32>())
            + 4 * words(width, size_of::<i16>())
            + words(width, 1);
        let rivals = match sgm.rivals {
            Some(_) => Rivals::words(width),
            None => 0,
        };
        Parts::NONE
            .and(Part::memory("synapses", synapses))
            .and(Part::memory(
                "views",
                self.reference.words() + self.other.words(),
            ))
            .and(Part::memory("masks", SgmMasks::words(config, sgm)))
            .and(Part {
                name: "patterns, then paths from the right",
                words: words(self.right_path_bytes, 1),
                look_back_lines: ahead + above,
                latency_lines: ahead,
            })
            .and(Part {
                name: "costs and paths",
                words: costs,
                look_back_lines: ahead + 1,
                latency_lines: 0,
            })
            .and(Part::memory("winners and checks", winners))
            .and(Part::memory("rivals", rivals))
    }
}

const fn max(a: usize, b: usize) -> usize {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Method, Preset};
    use crate::disparity::DisparityRange;
    use std::vec::Vec;

    /// Every SGM preset, alone and with each optional stage left out, in colour and in grey, at
    /// odd widths and with negative disparities.
    fn for_each_configuration(mut test: impl FnMut(&Config, &SgmParameters)) {
        let changes: [fn(&mut SgmParameters); 7] = [
            |_| {},
            |sgm| sgm.speckle = None,
            |sgm| sgm.vote = None,
            |sgm| sgm.weighted_median = None,
            |sgm| (sgm.speckle, sgm.vote, sgm.weighted_median) = (None, None, None),
            |sgm| (sgm.line_offset_max_lines, sgm.difference_weight_q4) = (0, 0),
            |sgm| sgm.line_offset_max_lines = 3,
        ];
        let ranges = [(0, 1), (0, 48), (-7, 20), (5, 33)];
        for preset in Preset::ALL {
            let Method::Sgm(sgm) = preset.parameters().method else {
                continue;
            };
            for (change, colour) in changes.iter().flat_map(|f| [(f, false), (f, true)]) {
                let mut sgm = sgm;
                change(&mut sgm);
                for (width, (minimum_px, count)) in [41, 64, 321].into_iter().zip(ranges) {
                    let mut parameters = preset.parameters();
                    parameters.method = Method::Sgm(sgm);
                    let disparities = DisparityRange { minimum_px, count };
                    let config = Config {
                        colour,
                        ..Config::new(parameters, width, disparities)
                    };
                    config.validate().unwrap();
                    test(&config, &sgm);
                }
            }
        }
    }

    /// Lines above a row that patterns sample, and lines below it that come before it is matched: where pixels are
    /// moved by three lines, two more.
    fn above_and_ahead(config: &Config, sgm: &SgmParameters) -> [u32; 2] {
        let above = u32::from(config.parameters.support.y_px);
        [
            above,
            above + u32::from(sgm.line_offset_max_lines.saturating_sub(1)),
        ]
    }

    /// The table in the documentation of [`SgmPlan::parts`], where it states bytes alone.
    #[test]
    fn parts_take_the_bytes_of_the_table() {
        for_each_configuration(|config, sgm| {
            let parts = SgmPlan::new(config, sgm).parts(config, sgm);
            let rounded = |bytes: &[usize]| bytes.iter().map(|b| b.div_ceil(4)).sum::<usize>();
            let w = usize::from(config.width);
            let d = usize::from(config.disparities.count).next_multiple_of(16);
            let n = usize::from(config.parameters.synapses);
            let of = |name: &str| {
                let mut parts = parts.as_slice().iter();
                parts.find(|part| part.name == name).unwrap().words
            };
            // 4 n: two bytes of an offset per synapse, and the cost by the count from 0 to n.
            assert_eq!(of("synapses"), rounded(&[2 * n, 2 * (n + 1)]));
            let costs = [w * d, w * d, w, w, 3 * d + 6, 2 * d];
            assert_eq!(of("costs and paths"), rounded(&costs));
            let winners = [4 * (w + d), 2 * w, 2 * w, 2 * w, 2 * w, w];
            assert_eq!(of("winners and checks"), rounded(&winners));
            let lines = |name: &str| {
                let mut parts = parts.as_slice().iter();
                let part = parts.find(|part| part.name == name).unwrap();
                (part.look_back_lines, part.latency_lines)
            };
            let [above, ahead] = above_and_ahead(config, sgm);
            // Patterns reach as far above their row as below it; the path from above comes from
            // the line above.
            let patterns = lines("patterns, then paths from the right");
            assert_eq!(patterns, (ahead + above, ahead));
            assert_eq!(lines("costs and paths"), (ahead + 1, 0));
        });
    }

    /// Each stage reads lines above the row that it takes, which is late by the stages before it.
    #[test]
    fn the_reference_view_is_as_deep_as_its_readers_look_back() {
        for_each_configuration(|config, sgm| {
            let plan = SgmPlan::new(config, sgm);
            let [above, ahead] = above_and_ahead(config, sgm);
            let stages = SgmRefiner::stages(config, sgm);
            let stages: Vec<Part> = stages.as_slice().to_vec();
            let late =
                |stages: &[Part]| ahead + stages.iter().map(|s| s.latency_lines).sum::<u32>();
            let readers = stages
                .iter()
                .enumerate()
                .filter(|(_, s)| s.look_back_lines > 0);
            let refinement = readers
                .map(|(index, stage)| late(&stages[..index]) + stage.look_back_lines + 1)
                .chain([late(&stages) + 1])
                .max()
                .unwrap();
            let depth = SgmPlan::refinement_depth(config, sgm);
            assert_eq!(depth, refinement as usize);
            let matching = (ahead + above + 1).max(ahead + 2);
            let reference = plan.reference;
            let kept = [reference.grey_lines, reference.colour_lines];
            let both = refinement.max(matching) as usize;
            let expected = if sgm.colour && config.colour {
                [matching as usize, both]
            } else {
                [both, 0]
            };
            assert_eq!(kept, expected);
            // A refinement that runs apart keeps the channels that it reads, and no others.
            let apart = plan.refinement_view();
            let expected = if sgm.colour && config.colour {
                [0, both, 0]
            } else {
                [both, 0, 0]
            };
            let kept = [apart.grey_lines, apart.colour_lines, apart.smoothed_lines];
            assert_eq!(kept, expected);
        });
    }
}
