//! A virtual laser scan: the nearest range in each direction around a camera, within a band of
//! heights.

use core::fmt;
use core::ops::{Range, RangeInclusive};

use super::camera::RectifiedCamera;
use crate::disparity::{DisparityLine, STEPS_PER_PX};
use crate::rows::{Arena, OutOfMemory, words};

/// Steps of 1/256 px in one of 1/16 px.
const Q8_PER_Q4: i64 = 256 / STEPS_PER_PX as i64;

/// Configuration of a [`LaserScan`]: the camera, the bearings, and which pixels count.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanConfig {
    /// The camera whose pixels have the disparities.
    pub camera: RectifiedCamera,
    /// The columns that have disparities, px; in a session, those of the region.
    pub columns: Range<u16>,
    /// Number of bearings, at equal angles over those columns; 1 to their number.
    pub bearings: u16,
    /// Pitch of the camera, rad, from -1.4 to 1.4: the angle of its optical axis below the horizon,
    /// negative above it. Ranges and heights are those of a level plane.
    pub pitch_rad: f32,
    /// Heights that count, relative to the camera, mm, above it positive.
    pub heights_mm: RangeInclusive<i16>,
    /// Ranges beyond this do not count, mm.
    pub range_max_mm: u16,
    /// Number of lines of a frame in which something must be seen at a bearing to count there, 1 to
    /// [`LINES_MAX`]. It keeps single wrong disparities out of the scan.
    pub lines_min: u8,
    /// Smallest confidence of a disparity that counts, at least 1: what was filled in does not.
    pub confidence_min: u8,
}

/// Largest [`ScanConfig::lines_min`].
pub const LINES_MAX: u8 = 8;

/// A scan cannot be made as configured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ScanError {
    /// The number of bearings is 0, or larger than that of the columns.
    Bearings,
    /// The camera's pitch is not from -1.4 to 1.4 rad.
    Pitch,
    /// No line, or more than [`LINES_MAX`], or no confidence is asked for.
    Support,
    /// The lent memory is too small.
    Memory(OutOfMemory),
}

impl fmt::Display for ScanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bearings => f.write_str("a scan has from 1 bearing to one for each column"),
            Self::Pitch => f.write_str("the camera's pitch is not from -1.4 to 1.4 rad"),
            Self::Support => write!(
                f,
                "what a scan shows must be seen in 1 to {LINES_MAX} lines, with a confidence from 1 on"
            ),
            Self::Memory(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for ScanError {}

impl From<OutOfMemory> for ScanError {
    fn from(error: OutOfMemory) -> Self {
        Self::Memory(error)
    }
}

/// The nearest confident range at each of a number of bearings, taken from lines of disparities as
/// they pass: what a scanning laser at the camera's place would measure, with the fields of ROS's
/// `sensor_msgs/LaserScan`.
///
/// A bearing takes a range from each line: that of the nearest depth among its columns, if its
/// height is in the band. Of these ranges the `lines_min`-th smallest is the bearing's. Range and
/// bearing are measured in the level plane; bearings are 0 straight ahead and positive to the left.
#[derive(Debug)]
pub struct LaserScan<'m> {
    camera: RectifiedCamera,
    heights_mm: RangeInclusive<i16>,
    range_max_mm: u16,
    confidence_min: u8,
    /// Cosine and sine of the pitch, 2^-16.
    cos_q16: i64,
    sin_q16: i64,
    /// The rightmost and the leftmost edge of the scan, rad.
    edges_rad: [f32; 2],
    /// Tangents of the angles, positive to the right, between the bearings and at both ends, from
    /// left to right, 2^-16.
    tangents_q16: &'m mut [i32],
    /// Reciprocal cosine of each bearing, from left to right, 2^-16.
    secants_q16: &'m mut [u32],
    /// For each bearing, from left to right, the smallest ranges, ascending, mm; [`FAR_MM`] for none.
    nearest_mm: &'m mut [u16],
    lines_min: usize,
    is_finished: bool,
}

/// The laser scan of a frame: a range in mm for each bearing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scan<'a> {
    /// The range at each bearing, mm, in ascending order of bearings, that is from right to left; 0
    /// where nothing was seen.
    pub ranges_mm: &'a [u16],
    /// The first bearing, the rightmost, rad: `angle_min` of ROS.
    pub bearing_min_rad: f32,
    /// The angle between bearings, rad: `angle_increment` of ROS.
    pub bearing_step_rad: f32,
    /// Ranges beyond this did not count, mm: `range_max` of ROS.
    pub range_max_mm: u16,
}

/// Stands for no range while a frame is taken.
const FAR_MM: u16 = u16::MAX;
/// Largest magnitude of the pitch, rad.
const PITCH_MAX_RAD: f32 = 1.4;

impl<'m> LaserScan<'m> {
    /// Words of lent memory: 8 + 2 `lines_min` bytes for each bearing, and 4.
    #[must_use]
    pub const fn words(bearings: u16, lines_min: u8) -> usize {
        let bearings = bearings as usize;
        2 * bearings + 1 + words(bearings * lines_min as usize, size_of::<u16>())
    }

    /// A scan that has seen nothing. It takes [`LaserScan::words`] of lent memory. Angles are
    /// computed here, in floating point that is the same on every target; lines are not.
    ///
    /// # Errors
    /// [`ScanError`] when a number of the configuration is out of its range or the memory is too
    /// small.
    pub fn new(config: &ScanConfig, memory: &'m mut [u32]) -> Result<Self, ScanError> {
        let columns = config.columns.clone();
        if config.bearings == 0 || config.bearings > columns.end.saturating_sub(columns.start) {
            return Err(ScanError::Bearings);
        }
        // Not a number is not in the range either.
        if !(-PITCH_MAX_RAD..=PITCH_MAX_RAD).contains(&config.pitch_rad) {
            return Err(ScanError::Pitch);
        }
        let lines = 1..=LINES_MAX;
        if !lines.contains(&config.lines_min) || config.confidence_min == 0 {
            return Err(ScanError::Support);
        }
        let bearings = usize::from(config.bearings);
        let lines_min = usize::from(config.lines_min);
        let mut arena = Arena::new(memory);
        let camera = config.camera;
        let (sin, cos) = (libm::sinf(config.pitch_rad), libm::cosf(config.pitch_rad));
        let [cx_q8, _] = camera.principal_q8();
        let forward_px = camera.focal_q8() as f32 / 256.0 * cos;
        // The outer sides of the first and the last pixel.
        let edge_rad = |column: u16| {
            let right_px = f32::from(column) - 0.5 - cx_q8 as f32 / 256.0;
            libm::atanf(right_px / forward_px)
        };
        let (left_rad, right_rad) = (edge_rad(columns.start), edge_rad(columns.end));
        let scan = Self {
            camera,
            heights_mm: config.heights_mm.clone(),
            range_max_mm: config.range_max_mm.min(FAR_MM - 1),
            confidence_min: config.confidence_min,
            cos_q16: q16(cos),
            sin_q16: q16(sin),
            edges_rad: [-right_rad, -left_rad],
            tangents_q16: arena.take(bearings + 1)?,
            secants_q16: arena.take(bearings)?,
            nearest_mm: arena.take(bearings * lines_min)?,
            lines_min,
            is_finished: false,
        };
        let step_rad = scan.bearing_step_rad();
        for (index, tangent_q16) in scan.tangents_q16.iter_mut().enumerate() {
            // Angles are within a right angle of the axis, and the cast saturates.
            *tangent_q16 = q16(libm::tanf(left_rad + index as f32 * step_rad)) as i32;
        }
        for (index, secant_q16) in scan.secants_q16.iter_mut().enumerate() {
            let angle_rad = left_rad + (index as f32 + 0.5) * step_rad;
            *secant_q16 = q16(1.0 / libm::cosf(angle_rad)) as u32;
        }
        scan.nearest_mm.fill(FAR_MM);
        Ok(scan)
    }

    /// Forgets what it has seen, for the next frame.
    pub fn reset(&mut self) {
        self.nearest_mm.fill(FAR_MM);
        self.is_finished = false;
    }

    /// Takes a line of disparities. Lines may come in any order, each once a frame. One comparison a
    /// pixel, and a division a bearing.
    pub fn push(&mut self, line: &DisparityLine<'_>) {
        if self.is_finished {
            self.reset();
        }
        let camera = &self.camera;
        let [cx_q8, cy_q8] = camera.principal_q8().map(i64::from);
        let focal_q8 = divisor(camera.focal_q8());
        // No view has more lines.
        let down_q8 = i64::from(line.line.min(u16::MAX.into())) * 256 - cy_q8;
        // The ray of the line's middle: how far forward and up it leads in the level frame for each
        // focal length along the optical axis.
        let forward_q8 = (focal_q8 * self.cos_q16 - down_q8 * self.sin_q16) >> 16;
        let up_q8 = -((down_q8 * self.cos_q16 + focal_q8 * self.sin_q16) >> 16);
        let Some(counted_q4) = self.counted_q4(up_q8).filter(|_| forward_q8 > 0) else {
            return;
        };
        // 256 times baseline times forward: divided by a disparity, it is the distance ahead.
        let numerator = i64::from(camera.depth().numerator_q8()) * forward_q8 / focal_q8;
        let numerator = numerator.unsigned_abs();
        let offset_q8 = i64::from(camera.depth().offset_q8());
        let first = i64::from(line.column);
        let column = |tangent_q16: i32| {
            let edge_q8 = cx_q8 + ((forward_q8 * i64::from(tangent_q16)) >> 16);
            // The first pixel whose middle is not left of the edge.
            usize::try_from(((edge_q8 + 255) >> 8) - first).unwrap_or(0)
        };
        let mut edges = self.tangents_q16.iter().map(|&tangent| column(tangent));
        let mut from = edges.next().unwrap_or(0);
        let bearings = self.nearest_mm.chunks_exact_mut(self.lines_min.max(1));
        for ((nearest_mm, to), &secant_q16) in bearings.zip(edges).zip(self.secants_q16.iter()) {
            let to = to.min(line.disparities_q4.len());
            let pixels = (
                line.disparities_q4.get(from..to),
                line.confidences.get(from..to),
            );
            from = to;
            let (Some(disparities_q4), Some(confidences)) = pixels else {
                continue;
            };
            let mut largest_q4 = i16::MIN;
            for (&disparity_q4, &confidence) in disparities_q4.iter().zip(confidences) {
                let counts =
                    confidence >= self.confidence_min && counted_q4.contains(&disparity_q4);
                if counts && disparity_q4 > largest_q4 {
                    largest_q4 = disparity_q4;
                }
            }
            let disparity_q8 = i64::from(largest_q4) * Q8_PER_Q4 + offset_q8;
            if largest_q4 == i16::MIN || disparity_q8 <= 0 {
                continue;
            }
            let disparity_q8 = disparity_q8.unsigned_abs();
            let ahead = numerator.saturating_mul(secant_q16.into()) >> 16;
            let range_mm = (ahead + disparity_q8 / 2) / disparity_q8;
            match u16::try_from(range_mm) {
                Ok(range_mm) if range_mm <= self.range_max_mm => keep(nearest_mm, range_mm),
                _ => {}
            }
        }
    }

    /// The disparities, 1/16 px, of points in the band of heights on a ray that rises by `up_q8` for
    /// each focal length; `None` if it does not meet the band.
    fn counted_q4(&self, up_q8: i64) -> Option<RangeInclusive<i16>> {
        let depth = self.camera.depth();
        let focal_q8 = divisor(self.camera.focal_q8());
        // 256 times baseline times up: divided by a disparity, it is the height.
        let rise = i64::from(depth.numerator_q8()) * up_q8 / focal_q8;
        let [low, high] = [self.heights_mm.start(), self.heights_mm.end()].map(|&h| i64::from(h));
        // A ray that rises passes the band's upper bound furthest away; one that falls, the lower.
        let (nearer, further) = if rise >= 0 {
            (low, high)
        } else {
            (-high, -low)
        };
        let rise = rise.abs();
        // height = rise / disparity, from `nearer` to `further`.
        let least_q8 = match further {
            ..0 => return None,
            0 if rise > 0 => return None,
            0 => 1,
            further => ((rise + further - 1) / further).max(1),
        };
        let most_q8 = match nearer {
            ..=0 => i64::MAX,
            nearer => rise / nearer,
        };
        let offset_q8 = i64::from(depth.offset_q8());
        let bound = |q8: i64| {
            let q4 = q8.saturating_sub(offset_q8).div_euclid(Q8_PER_Q4);
            // The least is that of no disparity.
            q4.min(i16::MAX.into()).max(i64::from(i16::MIN) + 1) as i16
        };
        Some(bound(least_q8.saturating_add(Q8_PER_Q4 - 1))..=bound(most_q8))
    }

    /// Ends a frame: what was seen at each bearing. The next line begins another frame.
    pub fn finish(&mut self) -> Scan<'_> {
        let bearings = self.secants_q16.len();
        if !self.is_finished {
            // The last range of each bearing moves to the front.
            for bearing in 0..bearings {
                let last = bearing * self.lines_min + self.lines_min - 1;
                let range_mm = self.nearest_mm.get(last).copied();
                let range_mm = range_mm.filter(|&range_mm| range_mm < FAR_MM);
                if let Some(kept_mm) = self.nearest_mm.get_mut(bearing) {
                    *kept_mm = range_mm.unwrap_or(0);
                }
            }
            if let Some(ranges_mm) = self.nearest_mm.get_mut(..bearings) {
                ranges_mm.reverse();
            }
            self.is_finished = true;
        }
        let [right_rad, _] = self.edges_rad;
        Scan {
            ranges_mm: self.nearest_mm.get(..bearings).unwrap_or_default(),
            bearing_min_rad: right_rad + self.bearing_step_rad() / 2.0,
            bearing_step_rad: self.bearing_step_rad(),
            range_max_mm: self.range_max_mm,
        }
    }

    /// The angle between bearings, rad.
    fn bearing_step_rad(&self) -> f32 {
        let [right_rad, left_rad] = self.edges_rad;
        (left_rad - right_rad) / self.secants_q16.len() as f32
    }
}

/// A number in steps of 2^-16, rounded to nearest; the cast saturates.
fn q16(value: f32) -> i64 {
    libm::roundf(value * 65_536.0) as i64
}

/// The number to divide by, at least 1, which the compiler then knows: no panic is left.
fn divisor(number: u32) -> i64 {
    i64::from(number.max(1))
}

/// Puts a range among the smallest ones, which are ascending, and drops the largest.
fn keep(nearest_mm: &mut [u16], range_mm: u16) {
    let mut range_mm = range_mm;
    for kept_mm in nearest_mm {
        if range_mm < *kept_mm {
            core::mem::swap(kept_mm, &mut range_mm);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disparity::INVALID;
    use crate::geometry::Depth;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;
    use std::vec;
    use std::vec::Vec;

    /// A frame of disparities from `column` on, row-major.
    struct Frame {
        width: usize,
        column: u16,
        disparities_q4: Vec<i16>,
        confidences: Vec<u8>,
    }

    impl Frame {
        fn lines(&self) -> impl Iterator<Item = DisparityLine<'_>> {
            let rows = self.disparities_q4.chunks(self.width);
            let rows = rows.zip(self.confidences.chunks(self.width)).enumerate();
            rows.map(|(line, (disparities_q4, confidences))| DisparityLine {
                line: line as u32,
                column: self.column,
                disparities_q4,
                confidences,
            })
        }
    }

    fn ranges_mm(config: &ScanConfig, frame: &Frame) -> Vec<u16> {
        let mut memory = vec![0; LaserScan::words(config.bearings, config.lines_min)];
        let mut scan = LaserScan::new(config, &mut memory).unwrap();
        // What was seen before is forgotten, whether it was a frame or not.
        scan.push(&frame.lines().next().unwrap());
        if frame.width.is_multiple_of(2) {
            scan.reset();
        } else {
            scan.finish();
        }
        frame.lines().for_each(|line| scan.push(&line));
        let ranges_mm = scan.finish().ranges_mm.to_vec();
        assert_eq!(scan.finish().ranges_mm, ranges_mm);
        ranges_mm
    }

    /// The `lines_min`-th smallest range at each bearing, by points in space and angles between
    /// them. Pixels within `slack` of an edge of a bearing, px, or of a height, of its size, count
    /// only if `all` is set.
    fn ranges_of_points(config: &ScanConfig, frame: &Frame, slack: f64, all: bool) -> Vec<f64> {
        let camera = config.camera;
        let focal = f64::from(camera.focal_q8()) / 256.0;
        let [cx, cy] = camera.principal_q8().map(|q8| f64::from(q8) / 256.0);
        let depth = camera.depth();
        let (sin, cos) = f64::from(config.pitch_rad).sin_cos();
        let edge = |column: u16| ((f64::from(column) - 0.5 - cx) / (focal * cos)).atan();
        let (left, right) = (edge(config.columns.start), edge(config.columns.end));
        let count = usize::from(config.bearings);
        let step = (right - left) / count as f64;
        let mut nearest = vec![Vec::new(); count];
        for line in frame.lines() {
            let mut of_line = vec![f64::INFINITY; count];
            for (x, (&disparity_q4, &confidence)) in
                line.disparities_q4.iter().zip(line.confidences).enumerate()
            {
                let px = f64::from(disparity_q4) / 16.0 + f64::from(depth.offset_q8()) / 256.0;
                if disparity_q4 == INVALID || confidence < config.confidence_min || px <= 0.0 {
                    continue;
                }
                let z = f64::from(depth.numerator_q8()) / 256.0 / px;
                let x_px = x as f64 + f64::from(line.column);
                let y = (f64::from(line.line) - cy) / focal;
                let ahead = z * (cos - y * sin);
                let height = -z * (y * cos + sin);
                let tilt = f64::from(u8::from(all)) * 2.0 - 1.0;
                let height_slack = tilt * slack * (height.abs() + z / focal);
                let band =
                    [config.heights_mm.start(), config.heights_mm.end()].map(|&h| f64::from(h));
                if ahead <= 0.0
                    || height < band[0] - height_slack
                    || height > band[1] + height_slack
                {
                    continue;
                }
                // The place among the bearings, exactly and by half a pixel's slack to both sides.
                let place =
                    |x_px: f64| (((x_px - cx) / (focal * (cos - y * sin))).atan() - left) / step;
                let (low, high) = (place(x_px - slack), place(x_px + slack));
                for bearing in [low.floor(), high.floor()] {
                    let is_sure = low.floor() == high.floor();
                    if bearing < 0.0 || bearing >= count as f64 || !(all || is_sure) {
                        continue;
                    }
                    let middle = left + (bearing + 0.5) * step;
                    let range = ahead / middle.cos();
                    let of_bearing = &mut of_line[bearing as usize];
                    *of_bearing = of_bearing.min(range);
                }
            }
            for (nearest, range) in nearest.iter_mut().zip(of_line) {
                if range <= f64::from(config.range_max_mm) + slack * 50.0 * f64::from(u8::from(all))
                {
                    nearest.push(range);
                }
            }
        }
        let last = usize::from(config.lines_min) - 1;
        let of_bearing = |mut ranges: Vec<f64>| {
            ranges.sort_by(f64::total_cmp);
            ranges.get(last).copied().unwrap_or(f64::INFINITY)
        };
        nearest.into_iter().rev().map(of_bearing).collect()
    }

    #[test]
    fn ranges_are_those_of_the_points_in_space() {
        let mut found = 0;
        for seed in 0..200 {
            let mut random = Pcg32::seed_from_u64(seed);
            let mut below = |limit: u32| random.next_u32() % limit;
            let width = 1 + below(90) as usize;
            let height = 1 + below(40);
            let column = below(12) as u16;
            let focal_px = 20 + below(120);
            let depth = Depth::new(
                focal_px * (20 + below(200)) * 256,
                below(1024).cast_signed() - 512,
            );
            let principal_q8 = [
                ((width as u32 * 128) + below(2048)).cast_signed() - 1024,
                (height * 128 + below(1024)).cast_signed() - 512,
            ];
            let camera = RectifiedCamera::new(depth.unwrap(), focal_px * 256, principal_q8);
            let low = below(2000) as i16 - 1500;
            let config = ScanConfig {
                camera: camera.unwrap(),
                columns: column..column + width as u16,
                bearings: 1 + below(width as u32) as u16,
                pitch_rad: if seed % 3 == 0 {
                    0.0
                } else {
                    (below(2000) as f32 - 1000.0) / 1400.0
                },
                heights_mm: low..=low + below(3000) as i16,
                range_max_mm: 1000 + below(40_000) as u16,
                lines_min: 1 + below(3) as u8,
                confidence_min: 1 + below(100) as u8,
            };
            let pixels = width * height as usize;
            let frame = Frame {
                width,
                column,
                disparities_q4: (0..pixels)
                    .map(|_| {
                        if below(5) == 0 {
                            INVALID
                        } else {
                            below(700).cast_signed() as i16 - 20
                        }
                    })
                    .collect(),
                confidences: (0..pixels).map(|_| below(256) as u8).collect(),
            };
            let ranges = ranges_mm(&config, &frame);
            let slack = 0.02;
            let sure = ranges_of_points(&config, &frame, slack, false);
            let possible = ranges_of_points(&config, &frame, slack, true);
            for (bearing, &range_mm) in ranges.iter().enumerate() {
                let (most, least) = (sure[bearing], possible[bearing]);
                let range = if range_mm == 0 {
                    f64::INFINITY
                } else {
                    range_mm.into()
                };
                assert!(
                    range >= least * 0.999 - 1.0 && range <= most * 1.001 + 1.0,
                    "seed {seed}, bearing {bearing}: {range} is not from {least} to {most}"
                );
                found += usize::from(range_mm > 0 && most - least < 2.0);
            }
        }
        assert!(found > 1000, "{found} ranges are known to 2 mm");
    }

    /// 100 px, 60 mm, no tilt: 6 m at a disparity of 1 px.
    fn level() -> ScanConfig {
        let depth = Depth::new(100 * 60 * 256, 0).unwrap();
        ScanConfig {
            camera: RectifiedCamera::new(depth, 100 * 256, [20 * 256, 256]).unwrap(),
            columns: 0..41,
            bearings: 41,
            pitch_rad: 0.0,
            heights_mm: -100..=100,
            range_max_mm: 10_000,
            lines_min: 2,
            confidence_min: 1,
        }
    }

    #[test]
    fn bearings_ascend_to_the_left_and_one_line_is_not_enough() {
        let mut frame = Frame {
            width: 41,
            column: 0,
            disparities_q4: vec![INVALID; 3 * 41],
            confidences: vec![255; 3 * 41],
        };
        // Right of the middle 2 m away in two lines, left of it 1 m away in one.
        for (x, y, px) in [(30, 0, 3), (30, 1, 3), (10, 1, 6)] {
            frame.disparities_q4[y * 41 + x] = px * STEPS_PER_PX;
        }
        let config = level();
        let ranges = ranges_mm(&config, &frame);
        let seen: Vec<usize> = (0..41).filter(|&bearing| ranges[bearing] > 0).collect();
        assert_eq!(seen, [10]);
        // 10 px to the side of 100: the range is longer than the depth.
        assert!(
            (f32::from(ranges[10]) - 2000.0 * 1.01_f32.sqrt()).abs() < 2.0,
            "{ranges:?}"
        );
        let mut memory = vec![0; LaserScan::words(41, 2)];
        let mut scan = LaserScan::new(&config, &mut memory).unwrap();
        let scan = scan.finish();
        let bearing = scan.bearing_min_rad + 10.0 * scan.bearing_step_rad;
        assert!((bearing + 0.1_f32.atan()).abs() < 0.3 * scan.bearing_step_rad);
        // Filled in, it does not count.
        frame.confidences[30] = 0;
        assert!(ranges_mm(&config, &frame).iter().all(|&range| range == 0));
    }

    #[test]
    fn what_a_scan_cannot_be_is_refused() {
        let mut memory = [0; 1000];
        let mut refused = |change: fn(&mut ScanConfig)| {
            let mut config = level();
            change(&mut config);
            LaserScan::new(&config, &mut memory).err()
        };
        assert_eq!(refused(|_| {}), None);
        assert_eq!(
            refused(|config| config.bearings = 0),
            Some(ScanError::Bearings)
        );
        assert_eq!(
            refused(|config| config.bearings = 42),
            Some(ScanError::Bearings)
        );
        assert_eq!(
            refused(|config| config.columns.start = config.columns.end + 1),
            Some(ScanError::Bearings)
        );
        assert_eq!(
            refused(|config| config.pitch_rad = f32::NAN),
            Some(ScanError::Pitch)
        );
        assert_eq!(
            refused(|config| config.pitch_rad = 1.5),
            Some(ScanError::Pitch)
        );
        assert_eq!(
            refused(|config| config.lines_min = 0),
            Some(ScanError::Support)
        );
        assert_eq!(
            refused(|config| config.lines_min = 9),
            Some(ScanError::Support)
        );
        assert_eq!(
            refused(|config| config.confidence_min = 0),
            Some(ScanError::Support)
        );
        let words = LaserScan::words(41, 2);
        assert_eq!(words * 4, 41 * (8 + 2 * 2) + 4);
        let mut short = vec![0; words - 1];
        let error = LaserScan::new(&level(), &mut short).err();
        assert_eq!(error, Some(ScanError::Memory(OutOfMemory)));
    }

    #[test]
    fn lines_and_bands_out_of_every_range_do_no_harm() {
        for pitch_rad in [-1.4, 0.0, 1.4] {
            for heights_mm in [i16::MIN..=i16::MAX, i16::MIN..=i16::MIN, 0..=0, 7..=7] {
                let depth = Depth::new(u32::MAX >> 1, -(1 << 20)).unwrap();
                let config = ScanConfig {
                    camera: RectifiedCamera::new(depth, 1 << 12, [1 << 24, -(1 << 24)]).unwrap(),
                    pitch_rad,
                    heights_mm,
                    range_max_mm: u16::MAX,
                    ..level()
                };
                let mut memory = vec![0; LaserScan::words(41, 2)];
                let mut scan = LaserScan::new(&config, &mut memory).unwrap();
                for line in [0, 1, u32::MAX] {
                    for disparity_q4 in [INVALID, 0, i16::MAX] {
                        scan.push(&DisparityLine {
                            line,
                            column: u16::MAX,
                            disparities_q4: &[disparity_q4; 50],
                            confidences: &[255; 40],
                        });
                    }
                }
                assert!(
                    scan.finish()
                        .ranges_mm
                        .iter()
                        .all(|&range_mm| range_mm < u16::MAX)
                );
            }
        }
    }
}
