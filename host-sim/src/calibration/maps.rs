//! Maps: the rectification of a pair as the bytes that the core reads.

use anyhow::{Context, Result, ensure};
use crc::{CRC_32_ISO_HDLC, Crc};
use glam::DVec2;
use vgstereo_core::geometry::{Interpolation, Rectification};

use super::rectified::RectifiedPair;

/// The largest error of a map that is put up with for fewer knots, px.
pub const ERROR_MAX_PX: f64 = 0.1;
/// Knots are in this part of a pixel.
const KNOTS_PER_PX: f64 = 64.0;
const CHECKSUM: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// The maps of a pair.
#[derive(Debug, Clone)]
pub struct Maps {
    /// What [`Rectification::from_bytes`] reads.
    pub bytes: Vec<u8>,
    /// Pixels between knots.
    pub step_px: u16,
    /// Largest distance, over all valid pixels, between the place that the maps give and the exact one, px.
    pub error_px: f64,
    /// Share of the pixels of the left and the right view that are valid.
    pub valid: [f64; 2],
}

/// A view as it is exactly: where its pixels lie, row-major, and which columns of each line are valid.
struct Exact {
    places: Vec<DVec2>,
    intervals: Vec<[u16; 2]>,
}

/// Knots of a view: displacements from the rectified to the raw pixel, 1/64 px, row-major.
struct Grid {
    shift: u32,
    columns: usize,
    knots: Vec<[i16; 2]>,
}

impl Maps {
    /// Makes the maps with the fewest knots whose largest error is at most [`ERROR_MAX_PX`], or those of the
    /// smallest error if there are none. `unit_mm` is the length of the baseline's unit, if it is known.
    ///
    /// # Errors
    /// Fails with the reason when a pixel lies more than 512 px from where it was seen, when a side or a
    /// number is out of the format's range, or when no pixel is valid.
    pub fn new(
        pair: &RectifiedPair,
        unit_mm: Option<f64>,
        interpolation: Interpolation,
    ) -> Result<Self> {
        for side in pair.raw_size.into_iter().chain(pair.size) {
            ensure!(side <= 4096, "views of {side} px; 4096 px are possible");
        }
        let views = [0, 1].map(|view| Exact::new(pair, view));
        let valid = [0, 1].map(|view: usize| views[view].valid_share());
        ensure!(
            valid.iter().all(|&share| share > 0.0),
            "no pixel of the rectified views is seen by both cameras"
        );
        let mut finest = None;
        for shift in (2..=6).rev() {
            let [left, right] = &views;
            let grids = [
                Grid::new(pair, 0, left, shift)?,
                Grid::new(pair, 1, right, shift)?,
            ];
            let error_px = grids
                .iter()
                .zip(&views)
                .map(|(grid, view)| grid.error_px(view, pair.size[0]))
                .fold(0.0, f64::max);
            finest = Some((grids, error_px));
            if error_px <= ERROR_MAX_PX {
                break;
            }
        }
        let (grids, error_px) = finest.context("no step")?;
        let bytes = bytes(pair, unit_mm, interpolation, &grids, &views)?;
        Rectification::from_bytes(&bytes)?;
        Ok(Self {
            bytes,
            step_px: 1 << grids[0].shift,
            error_px,
            valid,
        })
    }

    /// The rectification that the bytes hold.
    ///
    /// # Errors
    /// Fails when the bytes were changed since.
    pub fn rectification(&self) -> Result<Rectification<'_>> {
        Ok(Rectification::from_bytes(&self.bytes)?)
    }
}

impl Exact {
    fn new(pair: &RectifiedPair, view: usize) -> Self {
        let [width, height] = pair.size;
        let mut places = Vec::with_capacity(usize::from(width) * usize::from(height));
        let mut intervals = Vec::with_capacity(height.into());
        for y in 0..height {
            let (mut longest, mut start) = ([0, 0], 0);
            for x in 0..width {
                let (place, is_seen) = pair.raw_position(view, DVec2::new(x.into(), y.into()));
                places.push(place);
                if !is_seen {
                    start = x + 1;
                } else if x + 1 - start > longest[1] - longest[0] {
                    longest = [start, x + 1];
                }
            }
            intervals.push(longest);
        }
        Self { places, intervals }
    }

    fn valid_share(&self) -> f64 {
        let valid: usize = self
            .intervals
            .iter()
            .map(|&[start, end]| usize::from(end - start))
            .sum();
        valid as f64 / self.places.len() as f64
    }

    /// Valid pixels, column and line, with their places.
    fn pixels(&self, width: u16) -> impl Iterator<Item = ([u16; 2], DVec2)> {
        let lines = (0..).zip(&self.intervals);
        lines.flat_map(move |(y, &[start, end])| {
            (start..end).map(move |x| {
                let at = usize::from(y) * usize::from(width) + usize::from(x);
                ([x, y], self.places[at])
            })
        })
    }
}

impl Grid {
    fn new(pair: &RectifiedPair, view: usize, exact: &Exact, shift: u32) -> Result<Self> {
        let knots_along = |px: u16| usize::from(px).div_ceil(1 << shift) + 1;
        let (columns, rows) = (knots_along(pair.size[0]), knots_along(pair.size[1]));
        // A knot that no valid pixel is interpolated from may have any value.
        let mut is_used = vec![false; columns * rows];
        for (y, &[start, end]) in exact.intervals.iter().enumerate() {
            if start < end {
                let row = y >> shift;
                for column in usize::from(start) >> shift..=(usize::from(end - 1) >> shift) + 1 {
                    is_used[row * columns + column] = true;
                    is_used[(row + 1) * columns + column] = true;
                }
            }
        }
        let mut knots = Vec::with_capacity(columns * rows);
        for (index, is_used) in is_used.into_iter().enumerate() {
            let at = DVec2::new(
                ((index % columns) << shift) as f64,
                ((index / columns) << shift) as f64,
            );
            let (place, _) = pair.raw_position(view, at);
            let displacement = ((place - at) * KNOTS_PER_PX).round();
            let range = f64::from(i16::MIN)..=f64::from(i16::MAX);
            let [dx, dy] = displacement.to_array();
            ensure!(
                !is_used || (range.contains(&dx) && range.contains(&dy)),
                "pixel {:.0}, {:.0} of the {} view lies {:.0} px from where the camera saw it, and maps \
                 reach 512 px: the cameras are turned too far, or --size is wrong",
                at.x,
                at.y,
                ["left", "right"][view],
                (place - at).length()
            );
            // The conversion clamps.
            knots.push([dx as i16, dy as i16]);
        }
        Ok(Self {
            shift,
            columns,
            knots,
        })
    }

    /// The knots before and behind a pixel, interpolated to its line, in the unit of the core's
    /// `ViewMap::knot`.
    fn knots_around(&self, [x, y]: [u16; 2]) -> [[i32; 2]; 2] {
        let (step, unit) = (1 << self.shift, 64 << self.shift);
        let (column, row) = (usize::from(x) >> self.shift, usize::from(y) >> self.shift);
        let below = i32::from(y) & (step - 1);
        [column, column + 1].map(|column| {
            let upper = self.knots[row * self.columns + column];
            let lower = self.knots[(row + 1) * self.columns + column];
            let mixed = |axis: usize| {
                i32::from(upper[axis]) * (step - below) + i32::from(lower[axis]) * below
            };
            [
                ((column as i32) << self.shift) * unit + mixed(0),
                i32::from(y) * unit + mixed(1),
            ]
        })
    }

    fn error_px(&self, exact: &Exact, width: u16) -> f64 {
        let step = f64::from(1 << self.shift);
        let unit = KNOTS_PER_PX * step;
        exact
            .pixels(width)
            .map(|(at, place)| {
                let [start, end] = self
                    .knots_around(at)
                    .map(|[x, y]| DVec2::new(x.into(), y.into()));
                let share = f64::from(at[0] & ((1 << self.shift) - 1)) / step;
                (start.lerp(end, share) / unit - place).length()
            })
            .fold(0.0, f64::max)
    }
}

fn bytes(
    pair: &RectifiedPair,
    unit_mm: Option<f64>,
    interpolation: Interpolation,
    grids: &[Grid; 2],
    views: &[Exact; 2],
) -> Result<Vec<u8>> {
    let fixed = |value: f64, what: &str| -> Result<i32> {
        let rounded = (value * 256.0).round();
        ensure!(
            rounded.abs() < f64::from(i32::MAX),
            "{what} is {value:.0}, which is out of range"
        );
        Ok(rounded as i32)
    };
    let numerator_q8 = match unit_mm {
        Some(unit_mm) => {
            let product = pair.focal_px * pair.baseline * unit_mm;
            let q8 = fixed(product, "the focal length times the baseline, in px mm,")?;
            ensure!(
                q8 > 0,
                "the baseline is {} mm: --unit is wrong",
                pair.baseline * unit_mm
            );
            q8
        }
        None => 0,
    };
    let mut bytes = b"VGRF\x01\0".to_vec();
    let interpolation = match interpolation {
        Interpolation::Bilinear => 0,
        Interpolation::Cubic => 1,
    };
    bytes.extend([grids[0].shift as u8, interpolation]);
    for number in [pair.raw_size, pair.size].concat() {
        bytes.extend(number.to_le_bytes());
    }
    // The lines to keep, which follow from the rest.
    let lines_at = bytes.len();
    bytes.extend([0; 4]);
    let [left, _] = pair.principal_px;
    for number in [
        numerator_q8,
        fixed(pair.doffs_px(), "the offset of the principal points")?,
        fixed(pair.focal_px, "the focal length")?,
        fixed(left.x, "the principal point")?,
        fixed(left.y, "the principal point")?,
    ] {
        bytes.extend(number.to_le_bytes());
    }
    for (grid, view) in grids.iter().zip(views) {
        bytes.extend(grid.knots.iter().flatten().flat_map(|n| n.to_le_bytes()));
        bytes.extend(
            view.intervals
                .iter()
                .flatten()
                .flat_map(|n| n.to_le_bytes()),
        );
    }
    let [left, right] = Rectification::needed_lines_of(&sealed(bytes.clone()))?;
    let lines = [left.to_le_bytes(), right.to_le_bytes()].concat();
    bytes[lines_at..lines_at + lines.len()].copy_from_slice(&lines);
    Ok(sealed(bytes))
}

/// Bytes with their checksum behind them.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let checksum = CHECKSUM.checksum(&bytes);
    bytes.extend(checksum.to_le_bytes());
    bytes
}
