//! Oracle of the SGM method on whole images: plain loops, one stage after another.
//!
//! It follows the definitions in the documentation of the stages, and uses whole-frame arrays,
//! signed integers and sorting instead of the rings, narrow lanes and bisection of the streaming
//! stages. It shares only the drawing of the offsets and the colour conversion with the core.

use std::collections::HashSet;

use vgstereo_core::config::{RivalParameters, SpeckleParameters, Voters};
use vgstereo_core::kernel::{channel_row, luma_row};
use vgstereo_core::pattern::StoredOffset;
use vgstereo_core::{Config, INVALID, LineOffsets, Method, Output, Reference, SgmParameters};

use super::recall::offsets;
use crate::Pair;

/// A view as separate planes: grey, and the channels that the stages compare.
#[derive(Clone)]
struct View {
    width: i32,
    height: i32,
    grey: Vec<i32>,
    channels: Vec<Vec<i32>>,
    /// Whether the camera saw each pixel.
    seen: Vec<bool>,
}

impl View {
    fn index(&self, x: i32, y: i32) -> usize {
        (y.clamp(0, self.height - 1) * self.width + x.clamp(0, self.width - 1)) as usize
    }

    fn grey(&self, x: i32, y: i32) -> i32 {
        self.grey[self.index(x, y)]
    }

    /// Difference of two pixels, summed over the channels.
    fn difference(&self, a: usize, b: usize) -> i32 {
        let channels = self.channels.iter();
        channels.map(|c| (c[a] - c[b]).abs()).sum()
    }

    fn largest_difference(&self, a: usize, b: usize) -> i32 {
        let channels = self.channels.iter();
        channels.map(|c| (c[a] - c[b]).abs()).max().unwrap()
    }
}

/// Returns the disparities of the whole reference view, 1/16 px, and their confidences.
#[must_use]
pub fn match_whole(pair: &Pair, config: &Config) -> (Vec<i16>, Vec<u8>) {
    let (map_q4, confidences, _) = match_and_learn(pair, config);
    (map_q4, confidences)
}

/// Returns the disparities, their confidences, and the offsets of lines that the frame taught.
#[must_use]
pub fn match_and_learn(pair: &Pair, config: &Config) -> (Vec<i16>, Vec<u8>, LineOffsets) {
    let Method::Sgm(a) = config.parameters.method else {
        panic!("this is the oracle of SGM");
    };
    // To match to the right view, match the mirrored views to the left one.
    let mirrored = config.reference == Reference::Right;
    let (mut reference, mut other) = match config.reference {
        Reference::Left => (view(pair, 0, &a), view(pair, 1, &a)),
        Reference::Right => (view(pair, 1, &a), view(pair, 0, &a)),
    };
    let mut offsets = offsets(&config.parameters);
    if mirrored {
        mirror(&mut reference);
        mirror(&mut other);
        for [dx, _] in &mut offsets {
            *dx = -*dx;
        }
    }
    let begun = from_right_to_left(config.line_offsets, pair.width, !mirrored);
    let (found, mut confidences, learned) = find(&reference, &other, &offsets, begun, config, &a);
    let mut map = found;
    if let Some(parameters) = a.speckle {
        map = without_speckles(&map, &reference, &parameters);
        for (confidence, &found) in confidences.iter_mut().zip(&map) {
            if found == i32::from(INVALID) {
                *confidence = 0;
            }
        }
    }
    if let Some(parameters) = a.vote {
        let first = first_known(&map, &reference);
        for y in 0..reference.height {
            for x in first[y as usize]..reference.width {
                let i = reference.index(x, y);
                if map[i] < 0 {
                    map[i] = vote(&reference, &map, x, y, config, &parameters).unwrap_or(map[i]);
                }
            }
        }
    }
    border(
        &mut map,
        &reference,
        (i32::from(config.disparities.count) - 1) * 16,
    );
    for found in &mut map {
        if *found < 0 && *found != i32::from(INVALID) {
            *found = !*found;
        }
    }
    fill(&mut map, &reference);
    map = median(&map, &reference);
    if let Some(parameters) = a.weighted_median {
        let window = (
            i32::from(parameters.reach_x_px),
            i32::from(parameters.reach_y_px),
        );
        map = weighted_median(&map, &reference, window, i32::from(parameters.colour_reach));
        map = median(&map, &reference);
    }
    let minimum_q4 = i32::from(config.disparities.minimum_px) * 16;
    let mut map_q4: Vec<i16> = map
        .iter()
        .zip(&reference.seen)
        .map(|(&q4, seen)| {
            if q4 == i32::from(INVALID) || !seen {
                INVALID
            } else {
                (q4 + minimum_q4) as i16
            }
        })
        .collect();
    for (i, (confidence, q4)) in confidences.iter_mut().zip(&mut map_q4).enumerate() {
        // The match, to the nearest pixel, where halves count to the left.
        let (x, y) = (i as i32 % reference.width, i as i32 / reference.width);
        let match_x = (f64::from(x) - f64::from(*q4) / 16.0 - 0.5).ceil() as i32;
        let is_seen =
            (0..reference.width).contains(&match_x) && other.seen[other.index(match_x, y)];
        if *q4 == INVALID || !is_seen {
            *confidence = 0;
        }
        if *confidence == 0 && config.output == Output::Sparse {
            *q4 = INVALID;
        }
    }
    if mirrored {
        for line in map_q4.chunks_mut(pair.width) {
            line.reverse();
        }
        for line in confidences.chunks_mut(pair.width) {
            line.reverse();
        }
    }
    let learned = from_right_to_left(learned, pair.width, !mirrored);
    (map_q4, confidences, learned)
}

/// Offsets of columns that are counted from the other side, if they are; the middle column is the same but for
/// even widths.
fn from_right_to_left(offsets: LineOffsets, width: usize, turns: bool) -> LineOffsets {
    if !turns {
        return offsets;
    }
    let middle = width as i32 / 2;
    LineOffsets {
        shift_q24: offsets.shift_q24 + (width as i32 - 1 - 2 * middle) * offsets.tilt_q24,
        tilt_q24: -offsets.tilt_q24,
        ..offsets
    }
}

fn view(pair: &Pair, camera: usize, a: &SgmParameters) -> View {
    let pixels = [&pair.left, &pair.right][camera];
    let count = pair.width * pair.height;
    let (mut grey, mut row) = (vec![0; count], vec![0; count]);
    luma_row(pair.format, pixels, &mut grey);
    let plane = |row: &[u8]| {
        row.iter()
            .map(|&level| i32::from(level))
            .collect::<Vec<i32>>()
    };
    let channels = if a.colour && !pair.format.is_grey() {
        let channels = (0..3).map(|channel| {
            channel_row(pair.format, pixels, channel, &mut row);
            plane(&row)
        });
        channels.collect()
    } else {
        vec![plane(&grey)]
    };
    View {
        width: pair.width as i32,
        height: pair.height as i32,
        grey: plane(&grey),
        channels,
        seen: (0..count)
            .map(|i| pair.sees(camera, i % pair.width, i / pair.width))
            .collect(),
    }
}

fn mirror(view: &mut View) {
    for plane in view.channels.iter_mut().chain([&mut view.grey]) {
        for line in plane.chunks_mut(view.width as usize) {
            line.reverse();
        }
    }
    for line in view.seen.chunks_mut(view.width as usize) {
        line.reverse();
    }
}

/// Exposure of the other view relative to the reference view, as learned so far.
struct Exposure {
    gain: [i64; 3],
    offset: [i64; 3],
    /// Whether gain and offset have been learned.
    converts: bool,
    dead_zone: i32,
    /// Number of matches with slow and with fast fading.
    matches: [i64; 2],
    /// Sums over matches for each channel, with slow fading: levels of the reference view, of the
    /// other view, squares of both, residuals; then, with fast fading, levels of the reference view
    /// and of the other view.
    sums: [[i64; 7]; 3],
}

impl Exposure {
    fn convert(&self, channel: usize, raw: i32) -> i32 {
        let converted = self.gain[channel] * i64::from(raw) + self.offset[channel];
        ((converted + 2048) >> 12).clamp(0, 255) as i32
    }

    /// Learns from a line's matches. For each match and channel, `matches` holds the levels of both
    /// views.
    fn learn(&mut self, matches: &[Vec<(i32, i32)>], channels: usize) {
        let inside = |level: i32| (1..255).contains(&level);
        let told: Vec<&Vec<(i32, i32)>> = matches
            .iter()
            .filter(|levels| levels.iter().all(|&(own, raw)| inside(own) && inside(raw)))
            .collect();
        for (matches, fading) in self.matches.iter_mut().zip([16, 4]) {
            *matches += told.len() as i64 - *matches / fading;
        }
        for channel in 0..channels {
            let mut line = [0; 7];
            for levels in &told {
                let (own, raw) = levels[channel];
                let residual = (own - self.convert(channel, raw)).abs();
                let values = [own, raw, own * own, raw * raw, residual, own, raw];
                for (sum, value) in line.iter_mut().zip(values) {
                    *sum += i64::from(value);
                }
            }
            let fading = [16, 16, 16, 16, 16, 4, 4];
            for ((sum, line), fading) in self.sums[channel].iter_mut().zip(line).zip(fading) {
                *sum += line - *sum / fading;
            }
        }
        let [n, recent] = self.matches;
        if recent < 64 {
            self.dead_zone = 255;
            return;
        }
        for channel in 0..channels {
            let [
                own,
                raw,
                own_squares,
                raw_squares,
                _,
                recent_own,
                recent_raw,
            ] = self.sums[channel];
            let deviation =
                |sum: i64, squares: i64| ((n * squares - sum * sum).max(0) + 4 * n * n).isqrt();
            let gain = (deviation(own, own_squares) << 12) / deviation(raw, raw_squares);
            self.gain[channel] = gain.clamp(1024, 16384);
            self.offset[channel] =
                ((recent_own << 12) - self.gain[channel] * recent_raw).div_euclid(recent);
        }
        if self.converts {
            let residuals: i64 = self.sums[..channels].iter().map(|sums| sums[4]).sum();
            let mean_q4 = residuals * 16 / (n * channels as i64);
            self.dead_zone = ((mean_q4 * 20) >> 8).min(255) as i32;
        } else {
            // The residuals so far are those of unconverted levels: start anew.
            self.converts = true;
            self.matches = [0; 2];
            self.sums = [[0; 7]; 3];
        }
    }
}

/// Solves three linear equations by elimination.
fn solve(mut equations: [[f64; 4]; 3]) -> [f64; 3] {
    for pivot in 0..3 {
        let row = equations[pivot].map(|term| term / equations[pivot][pivot]);
        equations[pivot] = row;
        for other in (0..3).filter(|&other| other != pivot) {
            let factor = equations[other][pivot];
            for (term, known) in equations[other].iter_mut().zip(row) {
                *term -= factor * known;
            }
        }
    }
    equations.map(|equation| equation[3])
}

/// A row that taught an offset, with what its lines were moved by.
struct TaughtRow {
    line: i32,
    moved: [i64; 2],
    sums: [i64; 5],
}

/// Vertical offset of the pixels of the other view, as learned so far: in the middle of the line, and its
/// increment from pixel to pixel from right to left, 1/2^24 of a line; positive if they lie too low. They add to
/// what the frame began with.
struct Alignment {
    begun: LineOffsets,
    lines_max: u8,
    width: i32,
    shift: i64,
    tilt: i64,
    /// Rows that taught the frame.
    taught: Vec<TaughtRow>,
    /// Number of rows still to be left out, because lines around them were moved by another offset.
    settling: i32,
    /// Sums of g g, g g x, g g x x, g d and g d x, with the gradient g and the difference d.
    sums: [i64; 5],
}

impl Alignment {
    fn new(begun: LineOffsets, lines_max: u8, width: i32) -> Self {
        Self {
            begun,
            lines_max,
            width,
            shift: 0,
            tilt: 0,
            taught: Vec::new(),
            settling: 0,
            sums: [0; 5],
        }
    }

    /// Shift and tilt in the middle of line `y`.
    fn in_force(&self, y: i32) -> [i64; 2] {
        let begun =
            i64::from(self.begun.shift_q24) + i64::from(self.begun.stretch_q24) * i64::from(y);
        let [shift_max, tilt_max] = self.largest();
        [
            (begun + self.shift).clamp(-shift_max, shift_max),
            (i64::from(self.begun.tilt_q24) + self.tilt).clamp(-tilt_max, tilt_max),
        ]
    }

    fn largest(&self) -> [i64; 2] {
        // Together with the largest shift less than 16 lines.
        let tilt_max = (8 << 24) / (i64::from(self.width) / 2 + 8);
        [i64::from(self.lines_max) << 24, tilt_max]
    }

    /// The plane of offsets that the frame showed.
    fn learned(&self) -> LineOffsets {
        const LINE: f64 = 16_777_216.0;
        let Some(last) = self.taught.last() else {
            return self.begun;
        };
        let lines = last.line + 1;
        // Weight, x, y and offset: the normal equations are sums of products of the last three and of one.
        let mut equations = [[0.0; 4]; 3];
        let mut add = |weight: f64, x: f64, xx: f64, y: f64, yy: f64, offset: [f64; 2]| {
            let [offset, offset_x] = offset;
            let rows = [
                [weight, x, weight * y, offset],
                [x, xx, x * y, offset_x],
                [weight * y, x * y, weight * yy, offset * y],
            ];
            for (equation, row) in equations.iter_mut().zip(rows) {
                for (sum, term) in equation.iter_mut().zip(row) {
                    *sum += term;
                }
            }
        };
        let (mut weights, mut heights) = (0.0, 0.0);
        for row in &self.taught {
            let [n, x, xx, p, px] = row.sums.map(|sum| sum as f64);
            let [shift, tilt] = row.moved.map(|q24| q24 as f64 / LINE);
            let y = f64::from(row.line);
            let shown = [
                2.0 * p + shift * n + tilt * x,
                2.0 * px + shift * x + tilt * xx,
            ];
            add(n, x, xx, y, y * y, shown);
            weights += n;
            heights += n * y;
        }
        let [shift, tilt, stretch] = [
            self.begun.shift_q24,
            self.begun.tilt_q24,
            self.begun.stretch_q24,
        ]
        .map(|q24| f64::from(q24) / LINE);
        let quarter_x = f64::from((self.width / 4).max(1));
        let quarter_y = f64::from((lines / 4).max(1));
        let middle = if weights > 0.0 {
            heights / weights
        } else {
            quarter_y
        };
        for [side_x, side_y] in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
            let (weight, x, y) = (15_000.0, side_x * quarter_x, middle + side_y * quarter_y);
            let offset = weight * (shift + tilt * x + stretch * y);
            add(
                weight,
                weight * x,
                weight * x * x,
                y,
                y * y,
                [offset, offset * x],
            );
        }
        let [shift, tilt, stretch] = solve(equations);
        let corner = |x: i32, y: i32| {
            let [x, y] = [x, y].map(f64::from);
            shift + tilt * x + stretch * y
                - (f64::from(self.begun.shift_q24)
                    + f64::from(self.begun.tilt_q24) * x
                    + f64::from(self.begun.stretch_q24) * y)
                    / LINE
        };
        let half = self.width / 2;
        let corners = [
            corner(-half, 0),
            corner(half, 0),
            corner(-half, lines),
            corner(half, lines),
        ];
        if corners.iter().all(|change| change.abs() < 24.0 / 256.0) {
            return self.begun;
        }
        let [shift_q24, tilt_q24, stretch_q24] =
            [shift, tilt, stretch].map(|lines| (lines * LINE) as i32);
        LineOffsets {
            shift_q24,
            tilt_q24,
            stretch_q24,
        }
    }

    /// Learns from a row's matches: the pixel in the reference view, the pixel in the other view,
    /// and the sub-pixel step of the match, 1/16 px.
    fn learn(
        &mut self,
        matches: &[(i32, i32, i32)],
        y: i32,
        [reference, other]: [&View; 2],
        exposure: &Exposure,
        support_y: u8,
    ) {
        if self.settling > 0 {
            self.settling -= 1;
            return;
        }
        let moved = self.in_force(y);
        let reach = self.largest()[0];
        // Running means of differences and of gradients, times 8.
        let mut means = [0; 2];
        let mut row = [0; 5];
        for &(x, match_x, beyond) in matches {
            // Only every fourth pixel is used.
            if x % 4 != 0 {
                continue;
            }
            // Neighbours in the order in which the other view is traversed, from right to left.
            let (before, after) = (match_x + 1, match_x - 1);
            if before >= other.width || after < 0 {
                continue;
            }
            let rising = other.grey(after, y) - other.grey(before, y);
            let level = other.grey(match_x, y) + ((rising * beyond) >> 5);
            let green = if reference.channels.len() == 3 { 1 } else { 0 };
            let difference = reference.grey(x, y) - exposure.convert(green, level.clamp(0, 255));
            let gradient = other.grey(match_x, y + 1) - other.grey(match_x, y - 1);
            if difference.abs() > 24 || gradient.abs() > 64 {
                continue;
            }
            let place = i64::from(other.width - 1 - match_x - other.width / 2);
            // Where pixels could not be moved by as much as was learned.
            if (moved[0] + moved[1] * place).abs() > reach {
                continue;
            }
            let [local_difference, local_gradient]: [i32; 2] = [0, 1].map(|i| {
                let value = [difference, gradient][i];
                means[i] += value - (means[i] >> 3);
                8 * value - means[i]
            });
            let square = i64::from((local_gradient * local_gradient) >> 6);
            let product = i64::from((local_gradient * local_difference) >> 6);
            let terms = [
                square,
                square * place,
                square * place * place,
                product,
                product * place,
            ];
            for (sum, term) in row.iter_mut().zip(terms) {
                *sum += term;
            }
        }
        self.taught.push(TaughtRow {
            line: y,
            moved,
            sums: row,
        });
        for (sum, row) in self.sums.iter_mut().zip(row) {
            *sum += row - sum.div_euclid(8);
        }
        if self.sums[0] < 30_000 {
            return;
        }
        // Regression of 2 d on g, with a weight on no change.
        let width = i64::from(other.width);
        let [n, x, xx, p, px] = self.sums;
        let [n, xx] = [n + 15_000, xx + 15_000 * (width / 4) * (width / 4)];
        let [n, x, xx, p, px] = [n, x, xx, 2 * p, 2 * px].map(|sum| sum as f64);
        let x_mean = x * (1.0 / n);
        let tilt = (px - p * x_mean) / (xx - x * x_mean);
        let shift = (p - x * tilt) * (1.0 / n);
        let [shift, tilt] = [shift, tilt].map(|lines| (lines * 16_777_216.0) as i64);
        let ends = [-1, 1].map(|side| (shift + side * tilt * (width / 2)).abs());
        if ends.iter().all(|&end| end < 24 << 16) {
            return;
        }
        let [shift_max, tilt_max] = self.largest();
        self.shift = (self.shift + shift).clamp(-shift_max, shift_max);
        self.tilt = (self.tilt + tilt).clamp(-tilt_max, tilt_max);
        self.settling = i32::from(support_y) + i32::from(self.lines_max) + 1;
        self.sums = [0; 5];
    }

    /// The offset of a pixel of line `y` of the other view, 1/16 of a line: that of the middle of its block of eight.
    fn offset_q4(&self, x: i32, y: i32) -> i32 {
        let block = (self.width - 1 - x).div_euclid(8);
        let from_middle = i64::from(8 * block + 4 - self.width / 2);
        let [shift, tilt] = self.in_force(y);
        let offset = (shift + tilt * from_middle + (1 << 19)).div_euclid(1 << 20);
        let most = 16 * i64::from(self.lines_max);
        offset.clamp(-most, most) as i32
    }

    /// Writes line `y` of the moved view as the strip has it when the line arrives, and the pixels of the
    /// lines above that lie between it and the line before.
    fn moved(&self, raw: &View, y: i32, view: &mut View) {
        let planes = raw.channels.iter().chain([&raw.grey]);
        let moved = view.channels.iter_mut().chain([&mut view.grey]);
        let width = raw.width;
        for (raw, moved) in planes.zip(moved) {
            let row = |y: i32| (y.max(0) * width) as usize;
            for x in 0..raw.len() / view.height as usize {
                moved[row(y) + x] = raw[row(y) + x];
                let offset = self.offset_q4(x as i32, y);
                // The line whose pixel lies after the line before and up to this one, if it lies too low;
                // else this line.
                let line = if offset > 0 {
                    y - (offset + 15) / 16
                } else {
                    y
                };
                if line < 0 {
                    continue;
                }
                let place = 16 * line + offset;
                let above = place.div_euclid(16);
                let share = place.rem_euclid(16);
                let mixed =
                    raw[row(above) + x] * (16 - share) + raw[row((above + 1).min(y)) + x] * share;
                moved[row(line) + x] = (mixed + 8) >> 4;
            }
        }
    }
}

/// Brightness of single lines of the other view, as learned so far. Values are of the reference view and
/// of the other view; levels are in units of 1/256.
#[derive(Default)]
struct LineGain {
    lines: u32,
    /// Running means of the means of lines, and running means of these.
    means: [i64; 2],
    means_again: [i64; 2],
    spreads: [i64; 2],
    above: [i64; 2],
    /// Mean steps of the ratio and of the difference, in units of 1/65536.
    steps: [i64; 2],
    squares: i64,
    products: i64,
}

/// `2 (a - b) / (a + b)`, in units of 1/65536, towards zero.
fn relative(a: i64, b: i64) -> i64 {
    if a + b == 0 {
        return 0;
    }
    ((2 * (a - b)) * 65536 / (a + b)).clamp(-131_072, 131_072)
}

impl LineGain {
    /// Converts line `y` of the other view.
    fn mend(
        &mut self,
        [reference, raw]: [&View; 2],
        y: i32,
        exposure_gain: i64,
        gain_max: u8,
        config: &Config,
        mended: &mut View,
    ) {
        if gain_max == 0 {
            return;
        }
        let Some((means, spreads)) = Self::measure(reference, raw, y, config) else {
            return;
        };
        self.lines += 1;
        if self.lines == 1 {
            (self.means, self.means_again, self.above) = (means, means, means);
            self.spreads = spreads;
            return;
        }
        let expected = [0, 1].map(|v| (2 * self.means[v] - self.means_again[v]).max(256));
        let ratio =
            |now: [i64; 2], before: [i64; 2]| relative(now[0] * before[1], now[1] * before[0]);
        let difference = |before: [i64; 2]| {
            let d = means[0] - before[0] - ((exposure_gain * (means[1] - before[1])) >> 12);
            relative(means[0], means[0] - d)
        };
        let deviations = [ratio(means, expected), difference(expected)];
        let steps = [ratio(means, self.above), difference(self.above)];
        self.above = means;
        let follow = |mean: i64, value: i64, parts: i64| mean + (value - mean).div_euclid(parts);
        for v in 0..2 {
            self.means[v] = follow(self.means[v], means[v], 128);
            self.means_again[v] = follow(self.means_again[v], self.means[v], 128);
            self.steps[v] = follow(self.steps[v], steps[v].abs(), 8);
        }
        let of_spreads = ratio(spreads, self.spreads);
        self.spreads = [0, 1].map(|v| follow(self.spreads[v], spreads[v], 128));
        let add = |sum: i64, product: i64| sum + product.div_euclid(256) - sum.div_euclid(32);
        self.squares = add(self.squares, deviations[0] * deviations[0]);
        self.products = add(self.products, deviations[0] * of_spreads);

        if self.steps[0].min(self.steps[1]) < 786
            || deviations[0].signum() * deviations[1].signum() < 0
        {
            return;
        }
        let least = deviations[0].abs().min(deviations[1].abs());
        let counted = if least >= 2 * 1311 {
            least
        } else {
            2 * (least - 1311).max(0)
        };
        let gain_max = i64::from(gain_max);
        let most = (gain_max * 131_072) / (512 + gain_max);
        let counted = counted.min(most) * deviations[0].signum();
        let ratio = 4096 * (131_072 + counted) / (131_072 - counted);
        let share = if self.squares == 0 {
            256
        } else {
            (256 * self.products / self.squares).clamp(0, 256)
        };
        let gain = 4096 + ((ratio - 4096) * share).div_euclid(256);
        let offset = ((ratio - gain) * means[1]).div_euclid(256);
        for x in 0..raw.width {
            let i = raw.index(x, y);
            let planes = mended.channels.iter_mut().chain([&mut mended.grey]);
            for plane in planes {
                if (1..255).contains(&plane[i]) {
                    let converted = (gain * i64::from(plane[i]) + offset + 2048).div_euclid(4096);
                    plane[i] = converted.clamp(0, 255) as i32;
                }
            }
        }
    }

    /// Means and spreads of both lines.
    fn measure(
        reference: &View,
        other: &View,
        y: i32,
        config: &Config,
    ) -> Option<([i64; 2], [i64; 2])> {
        let disparities = config.disparities;
        let shift = i32::from(disparities.minimum_px) + i32::from(disparities.count / 4);
        // From the end at which columns are left out.
        let seen_of = |view: &View, from: i32, until: i32| -> Vec<i32> {
            (from..until)
                .filter(|&x| view.seen[view.index(x, y)])
                .collect()
        };
        let width = reference.width;
        let own = seen_of(reference, shift.max(0), width + shift.min(0));
        let mut others = seen_of(other, (-shift).max(0), width - shift.max(0));
        others.reverse();
        let sample = |view: &View, columns: &[i32]| -> Vec<i64> {
            columns.iter().map(|&x| view.grey(x, y).into()).collect()
        };
        let unsorted = [sample(reference, &own), sample(other, &others)];
        let mut levels = unsorted.clone();
        for levels in &mut levels {
            levels.sort_unstable();
        }
        let counts = levels.each_ref().map(Vec::len);
        if counts.contains(&0) {
            return None;
        }
        let clipped = levels
            .each_ref()
            .map(|levels| levels.iter().filter(|&&level| level == 255).count());
        for v in 0..2 {
            let of_other = clipped[1 - v] * counts[v] / counts[1 - v];
            levels[v].truncate(counts[v] - clipped[v].max(of_other));
        }
        if levels.iter().any(|levels| levels.len() < 16) {
            return None;
        }
        let mean =
            |values: &[i64], unit: i64| values.iter().sum::<i64>() * unit / values.len() as i64;
        let means = levels.each_ref().map(|levels| mean(levels, 256));
        let spreads = [0, 1].map(|v| {
            let top = *levels[v].last().unwrap();
            let every_fourth = unsorted[v].iter().step_by(4).filter(|&&level| level <= top);
            let distances = every_fourth.map(|level| (level * 256 - means[v]).abs() / 16);
            let distances: Vec<i64> = distances.collect();
            distances.iter().sum::<i64>() * 16 / (distances.len() as i64).max(1)
        });
        Some((means.map(|m| m.max(256)), spreads.map(|s| s.max(256))))
    }
}

/// Takes line `y` as the strip has it when it arrives, and smooths the line `latency` lines above it.
fn smooth(view: &View, y: i32, latency: i32, step_max: i32, smoothed: &mut [i32]) {
    for x in 0..view.width {
        smoothed[view.index(x, y)] = view.grey(x, y);
        let line = y - latency;
        if line < 0 {
            continue;
        }
        let own = view.grey(x, line);
        let near = |dx: i32, dy: i32| {
            let level = view.grey(x + dx, line + dy);
            if (level - own).abs() <= step_max {
                level
            } else {
                own
            }
        };
        let half = |a: i32, b: i32| (a + b).div_euclid(2);
        let corners = half(
            half(near(-1, -1), near(-1, 1)),
            half(near(1, -1), near(1, 1)),
        );
        let edges = half(half(near(0, -1), near(0, 1)), half(near(-1, 0), near(1, 0)));
        smoothed[view.index(x, line)] = half(edges, half(own, corners));
    }
}

/// Matching costs, aggregation, selection and checks, line by line, because exposure and alignment
/// are learned on the way.
fn find(
    reference: &View,
    raw_other: &View,
    offsets: &[StoredOffset],
    begun: LineOffsets,
    config: &Config,
    a: &SgmParameters,
) -> (Vec<i32>, Vec<u8>, LineOffsets) {
    let (width, height) = (reference.width, reference.height);
    let (minimum, count) = (
        i32::from(config.disparities.minimum_px),
        usize::from(config.disparities.count),
    );
    let channels = reference.channels.len();
    let mut found = Vec::new();
    let mut confidences = Vec::new();
    let mut above: Vec<Vec<i32>> = Vec::new();
    let mut doubts = vec![false; width as usize];
    let mut exposure = Exposure {
        gain: [4096; 3],
        offset: [0; 3],
        converts: false,
        dead_zone: 255,
        matches: [0; 2],
        sums: [[0; 7]; 3],
    };
    let full_weight = i32::from(a.difference_weight_q4);
    // By how much more than usual matched levels differ, as far as that is known.
    let noise = |exposure: &Exposure| match exposure.dead_zone {
        255 => 0,
        zone => (zone - i32::from(a.usual_difference_max)).max(0),
    };
    let support_y = config.parameters.support.y_px;
    let lines_max = if full_weight > 0 {
        a.line_offset_max_lines
    } else {
        0
    };
    // Lines that pixels wait for, besides one.
    let waiting = i32::from(lines_max.max(1)) - 1;
    let mut alignment = Alignment::new(begun, lines_max, width);
    let mut line_gain = LineGain::default();
    let mut mended_other = raw_other.clone();
    let mut other = raw_other.clone();
    let support = config.parameters.support;
    let smooths = a.smoothing_step > 0 && support.x_px > 0 && support.y_px > 0;
    // Smoothed as far as lines have arrived.
    let mut smoothed = [reference, raw_other].map(|view| view.grey.clone());
    let mut lines_in = 0;
    // The first line is matched twice; the first time only to learn the exposure.
    for (y, rehearsal) in [(0, true)]
        .into_iter()
        .chain((0..height).map(|y| (y, false)))
    {
        while lines_in < height && lines_in <= y + i32::from(support_y) + waiting {
            line_gain.mend(
                [reference, raw_other],
                lines_in,
                exposure.gain[if channels == 3 { 1 } else { 0 }],
                a.line_gain_max_q8,
                config,
                &mut mended_other,
            );
            alignment.moved(&mended_other, lines_in, &mut other);
            if smooths {
                let step = (i32::from(a.smoothing_step) + 4 * noise(&exposure)).min(255);
                for (view, smoothed) in [reference, &other].into_iter().zip(&mut smoothed) {
                    smooth(view, lines_in, waiting + 1, step, smoothed);
                }
            } else {
                smoothed[1].clone_from(&other.grey);
            }
            lines_in += 1;
        }
        let other = &other;
        let dead_zone = exposure.dead_zone;
        let noise = noise(&exposure);
        // In halves, of which one is left.
        let weight = match noise {
            0 => full_weight,
            _ => ((full_weight * 8 / (8 + noise) + 4) / 8 * 8)
                .clamp(8, 248)
                .min(full_weight),
        };
        // The first half of the synapses samples the smoothed view.
        let cells = |view: &View, smoothed: &[i32], x: i32| -> Vec<bool> {
            let n = offsets.len();
            let sample = |r: usize| {
                let [dx, dy] = offsets[r].map(i32::from);
                let levels = if r < n / 2 { smoothed } else { &view.grey };
                levels[view.index(x + dx, y + dy)]
            };
            (0..n).map(|r| sample(r) > sample((r + 1) % n)).collect()
        };
        let stored: Vec<Vec<bool>> = (0..width).map(|x| cells(other, &smoothed[1], x)).collect();
        let mut costs: Vec<Vec<i32>> = Vec::new();
        for x in 0..width {
            let input = cells(reference, &smoothed[0], x);
            let mask = mask(reference, offsets, x, y, a);
            let kept = mask.iter().filter(|&&kept| kept).count() as i32;
            let cell_cost = (i32::from(a.hamming_scale) * 256 + kept / 2) / kept;
            let ones = (0..input.len()).filter(|&r| mask[r] && input[r]).count() as i32;
            let truncation = truncation(ones * cell_cost, a);
            let mut line = Vec::new();
            for j in 0..count as i32 {
                let match_x = (x - minimum - j).clamp(0, width - 1);
                let pattern = &stored[match_x as usize];
                let differing = (0..input.len())
                    .filter(|&r| mask[r] && input[r] != pattern[r])
                    .count() as i32;
                let mut cost = ((differing * cell_cost + 128) >> 8).min(truncation);
                if full_weight > 0 {
                    let mut difference = 0;
                    for channel in 0..channels {
                        let own = reference.channels[channel][reference.index(x, y)];
                        let raw = other.channels[channel][other.index(match_x, y)];
                        let level = exposure.convert(channel, raw);
                        let low = if raw == 0 {
                            0
                        } else {
                            (level - dead_zone).max(0)
                        };
                        let high = if raw == 255 {
                            255
                        } else {
                            (level + dead_zone).min(255)
                        };
                        difference += (own - high).max(low - own).max(0);
                    }
                    if channels == 3 {
                        difference = (difference * 85) >> 8;
                    }
                    cost += (difference.min(a.difference_truncation.into()) * weight) >> 4;
                }
                line.push(cost);
            }
            costs.push(line);
        }
        if let Some(rivals) = &a.rivals
            && y % i32::from(rivals.row_step.max(1)) == 0
        {
            doubts = rival_doubts(&costs, rivals);
        }
        if let Some(rivals) = &a.rivals {
            for (costs, _) in costs.iter_mut().zip(&doubts).filter(|(_, doubt)| **doubt) {
                costs
                    .iter_mut()
                    .for_each(|cost| *cost /= 1 << rivals.cost_shift);
            }
        }
        let penalty = |x: i32, from: (i32, i32)| {
            let step = (reference.grey(x, y) - reference.grey(from.0, from.1)).abs();
            let step = (step - 3 * noise / 2).max(0);
            let p2 = i32::from(a.p2) - ((i32::from(a.p2_adaptation_q4) * step) >> 4);
            let p2 = p2.max(a.p2_floor.into());
            // Along the line, the penalty is that of the pixel on the right.
            match &a.rivals {
                Some(rivals) if rivals.p2_min > 0 && doubts[x.max(from.0) as usize] => {
                    rivals.p2_min.max(a.p2).into()
                }
                _ => p2,
            }
        };
        let p1 = i32::from(a.p1);
        let mut left: Vec<Vec<i32>> = Vec::new();
        for x in 0..width {
            let path = match left.last() {
                Some(previous) => step(previous, &costs[x as usize], p1, penalty(x, (x - 1, y))),
                None => costs[x as usize].clone(),
            };
            left.push(path);
        }
        let mut right: Vec<Vec<i32>> = Vec::new();
        for x in (0..width).rev() {
            let path = match right.last() {
                Some(previous) => step(previous, &costs[x as usize], p1, penalty(x, (x + 1, y))),
                None => costs[x as usize].clone(),
            };
            right.push(path);
        }
        right.reverse();
        above = (0..width)
            .map(|x| match above.get(x as usize) {
                Some(previous) => step(previous, &costs[x as usize], p1, penalty(x, (x, y - 1))),
                None => costs[x as usize].clone(),
            })
            .collect();
        let sum =
            |x: i32, j: usize| left[x as usize][j] + right[x as usize][j] + above[x as usize][j];
        // Best disparity of a pixel of the other view, among all pixels of the reference view that
        // may match it.
        let best_of_other = |match_x: i32| -> Option<usize> {
            let meeting =
                (0..count).filter(|&j| (0..width).contains(&(match_x + minimum + j as i32)));
            meeting.min_by_key(|&j| (sum(match_x + minimum + j as i32, j), j))
        };
        let mut matches = Vec::new();
        let mut levels_of_matches = Vec::new();
        for x in 0..width {
            let best = (0..count).min_by_key(|&j| (sum(x, j), j)).unwrap();
            let second = (0..count)
                .filter(|&j| j.abs_diff(best) > 1)
                .map(|j| sum(x, j))
                .min();
            let margin = second.unwrap_or(i32::from(i16::MAX)) - sum(x, best);
            let mut refined = best as i32 * 16;
            if best > 0 && best + 1 < count {
                let (before, after) = (
                    sum(x, best - 1) - sum(x, best),
                    sum(x, best + 1) - sum(x, best),
                );
                refined += subpixel_step(before, after, a);
            }
            let match_x = x - minimum - best as i32;
            let inside = (0..width).contains(&match_x) && other.seen[other.index(match_x, y)];
            let agrees = inside
                && reference.seen[reference.index(x, y)]
                && best_of_other(match_x)
                    .is_some_and(|other| other.abs_diff(best) <= a.left_right_tolerance_px.into());
            let reach = i32::from(config.parameters.support.x_px);
            let grey_step = |u: i32| reference.grey(u + 1, y).abs_diff(reference.grey(u, y));
            let texture: u32 = (x - reach..x + reach).map(grey_step).sum();
            let clear = margin >= a.margin.into() && texture >= a.texture_min.into();
            found.push(match (agrees, clear) {
                (true, true) => refined,
                (true, false) => !refined,
                (false, _) => INVALID.into(),
            });
            confidences.push(if agrees && clear && !doubts[x as usize] {
                margin.clamp(1, 255) as u8
            } else {
                0
            });
            // Only every other pixel is used.
            if agrees && clear && x % 2 == 0 {
                let levels = |channel: usize| {
                    (
                        reference.channels[channel][reference.index(x, y)],
                        other.channels[channel][other.index(match_x, y)],
                    )
                };
                levels_of_matches.push((0..channels).map(levels).collect());
                matches.push((x, match_x, refined - best as i32 * 16));
            }
        }
        let is_inside = y > 0 && y + 1 < lines_in;
        if lines_max > 0 && is_inside && exposure.dead_zone < 255 {
            let views = [reference, other];
            alignment.learn(&matches, y, views, &exposure, support_y);
        }
        // Where levels do not count, their exposure is not learned.
        if full_weight > 0 {
            for _ in 0..=i32::from(rehearsal) {
                exposure.learn(&levels_of_matches, channels);
            }
        }
        if rehearsal {
            found.clear();
            confidences.clear();
            above.clear();
        }
    }
    (found, confidences, alignment.learned())
}

/// Which pixels of a row are in doubt because a second disparity fits about as well.
fn rival_doubts(costs: &[Vec<i32>], rivals: &RivalParameters) -> Vec<bool> {
    let (width, reach) = (costs.len() as i32, i32::from(rivals.reach_px));
    let marked: Vec<bool> = (0..width)
        .step_by(4)
        .map(|first| {
            let window: Vec<&Vec<i32>> = (first + 2 - reach..=first + 2 + reach)
                .filter(|x| (0..width).contains(x) && x % 2 == 0)
                .map(|x| &costs[x as usize])
                .collect();
            // Disparities are searched by fours.
            let sums: Vec<i32> = (0..costs[0].len() / 4 * 4)
                .map(|j| window.iter().map(|costs| costs[j]).sum())
                .collect();
            let Some(&least) = sums.iter().min() else {
                return false;
            };
            let best = sums.iter().position(|&sum| sum == least).unwrap();
            let limit = least * i32::from(rivals.ratio_q4) / 16 + i32::from(rivals.slack);
            let wall = limit + i32::from(rivals.rise) * window.len() as i32;
            (0..sums.len()).any(|rival| {
                let between = best.min(rival)..=best.max(rival);
                let is_apart = sums[between].iter().any(|&sum| sum >= wall);
                sums[rival] < limit && is_apart
            })
        })
        .collect();
    let blocks = marked.len() as i32;
    let is_marked = |block: i32| (0..blocks).contains(&block) && marked[block as usize];
    let run = |block: i32| {
        let below = (0..block).rev().take_while(|&block| is_marked(block));
        let above = (block..blocks).take_while(|&block| is_marked(block));
        below.count() + above.count()
    };
    let run_min = usize::from(rivals.run_min_px).div_ceil(4);
    let spread = i32::from(rivals.spread_px) / 4;
    let is_in_doubt = |x: i32| {
        let mut near = x / 4 - spread..=x / 4 + spread;
        near.any(|block| is_marked(block) && run(block) >= run_min)
    };
    (0..width).map(is_in_doubt).collect()
}

/// The largest cost of a pattern whose cells that are 1 cost this much together, 1/256.
fn truncation(cost_q8: i32, a: &SgmParameters) -> i32 {
    let truncation = i64::from(a.hamming_truncation);
    let enough = i64::from(a.hamming_scale) * i64::from(a.evidence_q8);
    if enough == 0 {
        return truncation as i32;
    }
    // The slope is rounded up to 1/256, and less than 256.
    let slope_q8 = ((truncation * 65536 + enough - 1) / enough).min(65535);
    truncation.min((i64::from(cost_q8) * slope_q8) >> 16) as i32
}

/// The step from the best disparity to the minimum of a parabola, or of two lines of one slope, 1/16 px.
fn subpixel_step(before: i32, after: i32, a: &SgmParameters) -> i32 {
    let larger = before.max(after);
    let part = i32::from(a.subpixel.relief).min(5 * larger / 16);
    let [before, after] = [before, after].map(|rise| f64::from((rise - part).max(0)));
    let divisor = if larger >= a.subpixel.lines_min.into() {
        before.max(after)
    } else {
        before + after
    };
    if divisor == 0.0 {
        return 0;
    }
    (8.0 * (before - after) / divisor).round() as i32
}

/// One step of the recursion of path costs (Hirschmueller 2008, equation 13).
fn step(previous: &[i32], costs: &[i32], p1: i32, p2: i32) -> Vec<i32> {
    let least = *previous.iter().min().unwrap();
    let at = |j: i32| {
        usize::try_from(j)
            .ok()
            .and_then(|j| previous.get(j))
            .copied()
    };
    (0..costs.len() as i32)
        .map(|j| {
            let neighbours = [j - 1, j + 1]
                .into_iter()
                .filter_map(at)
                .map(|cost| cost + p1);
            let onward = neighbours
                .chain([previous[j as usize], least + p2])
                .min()
                .unwrap();
            costs[j as usize] + onward - least
        })
        .collect()
}

fn mask(view: &View, offsets: &[StoredOffset], x: i32, y: i32, a: &SgmParameters) -> Vec<bool> {
    let n = offsets.len();
    if a.kept_cells_q8 >= 256 {
        return vec![true; n];
    }
    let centre = view.index(x, y);
    let unlike = |r: usize| {
        let [dx, dy] = offsets[r % n];
        view.difference(view.index(x + i32::from(dx), y + i32::from(dy)), centre)
            .min(255)
    };
    let cells: Vec<i32> = (0..n).map(|r| unlike(r).max(unlike(r + 1))).collect();
    let kept = (n * usize::from(a.kept_cells_q8)).div_ceil(256).max(1);
    let parts = if view.channels.len() == 1 { 3 } else { 1 };
    let floor = i32::from(a.mask_floor) / parts;
    let step = (i32::from(a.mask_step.get()) / parts).max(1);
    let enough = |&threshold: &i32| cells.iter().filter(|&&c| c <= threshold).count() >= kept;
    let higher = (0..9).map(|doublings| floor + (step << doublings));
    let threshold = [floor].into_iter().chain(higher).find(enough).unwrap();
    cells.iter().map(|&cell| cell <= threshold).collect()
}

/// Rejects every pixel whose region, followed no further than the lines of its window, is too
/// small.
fn without_speckles(map: &[i32], view: &View, parameters: &SpeckleParameters) -> Vec<i32> {
    let none = i32::from(INVALID);
    // A disparity in doubt is stored as its complement.
    let disparity = |i: usize| if map[i] < 0 { !map[i] } else { map[i] };
    let reach = i32::from(parameters.reach_y_px);
    let mut output = map.to_vec();
    for y in 0..view.height {
        let lines = (y - reach).max(0)..=(y + reach).min(view.height - 1);
        for x in 0..view.width {
            if map[view.index(x, y)] == none {
                continue;
            }
            let mut painted = HashSet::from([(x, y)]);
            let mut front = vec![(x, y)];
            while let Some((x, y)) = front.pop() {
                for (u, v) in [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)] {
                    let inside = (0..view.width).contains(&u) && lines.contains(&v);
                    if inside
                        && map[view.index(u, v)] != none
                        && disparity(view.index(u, v)).abs_diff(disparity(view.index(x, y)))
                            <= u32::from(parameters.step_q4)
                        && painted.insert((u, v))
                    {
                        front.push((u, v));
                    }
                }
            }
            if painted.len() < usize::from(parameters.size_min) {
                output[view.index(x, y)] = none;
            }
        }
    }
    output
}

fn first_known(map: &[i32], view: &View) -> Vec<i32> {
    let lines = map.chunks(view.width as usize);
    lines
        .map(|line| {
            line.iter()
                .position(|&found| found >= 0)
                .map_or(view.width, |x| x as i32)
        })
        .collect()
}

fn vote(
    view: &View,
    map: &[i32],
    x: i32,
    y: i32,
    config: &Config,
    parameters: &vgstereo_core::config::RegionVoteParameters,
) -> Option<i32> {
    // Length of the arm from (x, y) in steps of (dx, dy): the pixels of similar colour.
    let arm = |x: i32, y: i32, dx: i32, dy: i32, reach: u8| -> i32 {
        let mut length = 0;
        while length < i32::from(reach) {
            let (u, v) = (x + dx * (length + 1), y + dy * (length + 1));
            let near = length < i32::from(reach / 2);
            let step = if near {
                parameters.near_step
            } else {
                parameters.far_step
            };
            let inside = (0..view.width).contains(&u) && (0..view.height).contains(&v);
            if !inside
                || view.largest_difference(view.index(u, v), view.index(x, y)) > i32::from(step)
            {
                break;
            }
            length += 1;
        }
        length
    };
    let mut votes = vec![0; usize::from(config.disparities.count) + 1];
    let (up, down) = (
        arm(x, y, 0, -1, parameters.reach_y_px),
        arm(x, y, 0, 1, parameters.reach_y_px),
    );
    let every_line = parameters.voters == Voters::EveryLine;
    for v in (y - up..=y + down).filter(|v| every_line || (v - y) % 2 == 0) {
        let (left, right) = (
            arm(x, v, -1, 0, parameters.reach_x_px),
            arm(x, v, 1, 0, parameters.reach_x_px),
        );
        let (first, step) = match every_line {
            true if v % 2 == 1 && left + right >= 2 => (x - left + 2, 4),
            true => (x - left, 4),
            false => (x - left, 2),
        };
        for u in (first..=x + right).step_by(step) {
            let found = map[view.index(u, v)];
            if found >= 0 {
                votes[(found as usize + 8) / 16] += 1;
            }
        }
    }
    let total: u32 = votes.iter().sum();
    let most = *votes.iter().max().unwrap();
    let winner = votes.iter().position(|&count| count == most).unwrap();
    let wins = total > parameters.support_min.into()
        && most * 100 > total * u32::from(parameters.share_min_percent);
    wins.then_some(winner as i32 * 16)
}

fn border(map: &mut [i32], view: &View, largest: i32) {
    let (mut spread, mut covariance) = (0_i64, 0_i64);
    for line in map.chunks_mut(view.width as usize) {
        let Some(first) = line.iter().position(|&found| found >= 0) else {
            continue;
        };
        if first == 0 {
            continue;
        }
        let known: Vec<(i64, i64)> = (0_i64..32)
            .zip(&line[first..])
            .filter(|&(_, &found)| found >= 0)
            .map(|(x, &found)| (x, i64::from(found - line[first])))
            .collect();
        let steps = known.windows(2).map(|pair| (pair[1].1 - pair[0].1).abs());
        let surface = &known[..=steps.take_while(|&step| step <= 16).count()];
        let sum = |points: &[(i64, i64)], f: &dyn Fn(i64, i64) -> i64| {
            points.iter().map(|&(x, y)| f(x, y)).sum::<i64>()
        };
        let n = surface.len() as i64;
        if n >= 4 {
            let [sx, sy] = [sum(surface, &|x, _| x), sum(surface, &|_, y| y)];
            let row_spread = 4 * (n * sum(surface, &|x, _| x * x) - sx * sx) / n;
            let row_covariance = 4 * (n * sum(surface, &|x, y| x * y) - sx * sy) / n;
            spread += row_spread - spread.div_euclid(4);
            covariance += row_covariance - covariance.div_euclid(4);
        }
        let slope = (covariance * 256 / spread.max(1)).clamp(-384, 384);
        let nearest = &surface[..surface.len().min(8)];
        let middle = (sum(nearest, &|_, y| y) * 256 - slope * sum(nearest, &|x, _| x))
            / nearest.len() as i64;
        let at_first = i64::from(line[first]) * 256 + middle;
        for (x, pixel) in line[..first].iter_mut().enumerate() {
            let value = (at_first + slope * (x as i64 - first as i64) + 128) >> 8;
            *pixel = value.clamp(0, largest.into()) as i32;
        }
    }
}

fn fill(map: &mut [i32], view: &View) {
    for line in map.chunks_mut(view.width as usize) {
        let known = line.to_vec();
        for x in 0..known.len() {
            if known[x] < 0 {
                let left = known[..x].iter().rev().find(|&&found| found >= 0);
                let right = known[x..].iter().find(|&&found| found >= 0);
                line[x] = left
                    .into_iter()
                    .chain(right)
                    .min()
                    .copied()
                    .unwrap_or(INVALID.into());
            }
        }
    }
}

fn median(map: &[i32], view: &View) -> Vec<i32> {
    let mut output = Vec::new();
    for y in 0..view.height {
        for x in 0..view.width {
            let around = (y - 1..=y + 1).flat_map(|v| (x - 1..=x + 1).map(move |u| (u, v)));
            let mut values: Vec<i32> = around.map(|(u, v)| map[view.index(u, v)]).collect();
            values.sort_unstable();
            output.push(values[4]);
        }
    }
    output
}

fn weighted_median(
    map: &[i32],
    view: &View,
    (reach_x, reach_y): (i32, i32),
    colour_reach: i32,
) -> Vec<i32> {
    let mut output = Vec::new();
    let times = if view.channels.len() == 1 { 3 } else { 1 };
    for y in 0..view.height {
        for x in 0..view.width {
            let mut values = Vec::new();
            for v in (y - reach_y).max(0)..=(y + reach_y).min(view.height - 1) {
                for u in (x - reach_x).max(0)..=(x + reach_x).min(view.width - 1) {
                    // The taps are every other pixel of every other row.
                    if (u - x) % 2 != 0 || (v - y) % 2 != 0 {
                        continue;
                    }
                    let value = map[view.index(u, v)];
                    let unlike = view.difference(view.index(u, v), view.index(x, y)) * times;
                    let like = (colour_reach - unlike).max(0);
                    let place = (20 - (u - x).abs() - (v - y).abs()).max(1);
                    let weight = (((like * like) >> 4) * place) >> 4;
                    if value != i32::from(INVALID) {
                        values.push((value, weight));
                    }
                }
            }
            values.sort_unstable();
            let total: i32 = values.iter().map(|&(_, weight)| weight).sum();
            let mut below = 0;
            let median = values.iter().find(|&&(_, weight)| {
                below += weight;
                weight > 0 && 2 * below >= total
            });
            output.push(median.map_or(INVALID.into(), |&(value, _)| value));
        }
    }
    output
}
