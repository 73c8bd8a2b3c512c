//! The frames of a recording as input of what matches pairs or judges disparities, one at a time.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use image::{DynamicImage, GrayImage, RgbImage};
use serde::Serialize;
use vgstereo_core::INVALID;
use vgstereo_core::geometry::RectifiedCamera;

use super::attended::Attended;
use super::board::{Board, Frame, Pictures};
use super::client::Memory;
use super::pixels::{Pixels, unpacked};
use super::recording::Damage;
use super::source::Source;
use crate::escapes::shown;

/// The data of a frame that can be judged, in words.
pub const JUDGED: &str = "disparities or a pair of views";
/// Note to a user: disparities that were filled in cannot be told from those found.
pub const DENSE: &str =
    "disparities that the board has filled in count as found: it sent no confidences";

/// Frames and bytes that a recording lacks; part of the JSON of commands.
#[derive(Debug, Clone, Serialize)]
pub struct Lacking {
    /// Number of frames that were left out: lines are missing, or nothing could be made of them.
    left_out: u64,
    /// Up to where it is whole, if not to its end.
    damage: Option<String>,
}

/// The frames of a recording, or of a file of bytes of the link.
#[derive(Debug)]
pub struct Frames<'m> {
    attended: Attended<'m>,
    name: String,
    names: Names,
    left_out: u64,
}

/// Names of frames: their numbers. A board that begins anew counts anew, and its frames are named for that
/// too, so that no two have one name.
#[derive(Debug, Default)]
struct Names {
    last: Option<u32>,
    restarts: u32,
}

impl Names {
    fn next(&mut self, frame: u32) -> String {
        if self.last.replace(frame).is_some_and(|last| frame <= last) {
            self.restarts += 1;
        }
        match self.restarts {
            0 => format!("{frame:06}"),
            restarts => format!("{frame:06}_{}", restarts + 1),
        }
    }
}

/// The disparities that a board has found, of the whole view, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// The disparities, 1/16 px.
    pub disparities_q4: Vec<i16>,
    /// Their confidences, 0 where a disparity was filled in or there is none, if the board has sent them.
    pub confidences: Option<Vec<u8>>,
    /// Width and height of the view, px.
    pub size: [u32; 2],
}

/// A pair of views that a board has sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pair {
    /// The left view.
    pub left: RgbImage,
    /// The right view, of the same size.
    pub right: RgbImage,
    /// Whether the board has rectified them; otherwise they are as the camera gave them.
    pub is_rectified: bool,
}

impl<'m> Frames<'m> {
    /// Opens a file.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason.
    pub fn open(path: &Path, memory: &'m mut Memory) -> Result<Self> {
        let source = Source::File {
            path: path.to_owned(),
            is_fast: true,
        };
        Ok(Self {
            attended: Attended::open(&source, memory)?,
            name: shown(path),
            names: Names::default(),
            left_out: 0,
        })
    }

    /// What `take` makes of the next frame of which no line is missing and of what its board has told, and
    /// the frame's name, which is its number; `None` after the last. Frames of which it makes nothing are left out.
    ///
    /// # Errors
    /// Fails when the file cannot be read. Where `take` fails, its error names the file and the frame.
    pub fn next_of<T>(
        &mut self,
        take: impl Fn(&Frame, &Board) -> Result<Option<T>>,
    ) -> Result<Option<(String, Result<T>)>> {
        while let Some(frame) = self.attended.frame()? {
            if frame.is_whole() {
                let name = self.names.next(frame.begun.frame);
                let taken = take(&frame, &self.attended.board).transpose();
                if let Some(taken) = taken {
                    let taken = taken.with_context(|| self.place_of(&name));
                    return Ok(Some((name, taken)));
                }
            }
            self.left_out += 1;
        }
        Ok(None)
    }

    /// The file and the frame of this name, as errors name them.
    #[must_use]
    pub fn place_of(&self, frame: &str) -> String {
        format!("{}: frame {frame}", self.name)
    }

    /// The camera that the board has told.
    #[must_use]
    pub fn camera(&self) -> Option<RectifiedCamera> {
        self.attended.board.rectified_camera()
    }

    /// The largest disparity that the board has said that it searches, px.
    #[must_use]
    pub fn d_max_px(&self) -> Option<i64> {
        let field = |name| {
            self.attended
                .board
                .hello
                .as_ref()?
                .fields
                .get(name)?
                .as_i64()
        };
        Some(field("disparity_min_px")? + field("disparity_count")? - 1)
    }

    /// Checks that a pair is rectified, is to be by a calibration, or is what the board itself matches.
    /// `option` is what gives a calibration.
    ///
    /// # Errors
    /// Fails when the pair is raw, the board has said that it rectifies, and there is no calibration.
    pub fn ensure_rectifiable(&self, pair: &Pair, is_calibrated: bool, option: &str) -> Result<()> {
        let hello = self.attended.board.hello.as_ref();
        let told = hello.and_then(|hello| hello.fields.get("rectifies")?.as_bool());
        ensure!(
            pair.is_rectified || is_calibrated || !told.unwrap_or(false),
            "the pair is raw, and the board rectifies: {option} does that here"
        );
        Ok(())
    }

    /// Where the recording is no longer whole, once it was read up to there.
    fn damage(&self) -> Option<&Damage> {
        self.attended.client().damage()
    }

    /// Frames and bytes that the recording lacks, complete once it was read.
    #[must_use]
    pub fn lacking(&self) -> Lacking {
        Lacking {
            left_out: self.left_out,
            damage: self.damage().map(ToString::to_string),
        }
    }

    /// What the recording lacks, once it was read, a line each. `needed` is what frames without it were left
    /// out for.
    #[must_use]
    pub fn lacks(&self, needed: &str) -> Vec<String> {
        let damage = self.damage();
        let damage = damage.map(|damage| format!("{} is damaged: {damage}", self.name));
        let left_out = (self.left_out > 0).then(|| {
            format!(
                "{}: frames left out: {}, as lines are missing or they are without {needed}",
                self.name, self.left_out
            )
        });
        damage.into_iter().chain(left_out).collect()
    }

    /// The error of a recording that has none of the frames that are looked for.
    #[must_use]
    pub fn none(&self, needed: &str) -> anyhow::Error {
        let lacks = self.lacks(needed);
        let lacks: String = lacks.iter().map(|lack| format!("; {lack}")).collect();
        anyhow::anyhow!(
            "{}: as a recording, it has no whole frame with {needed}{lacks}",
            self.name
        )
    }
}

impl Found {
    /// The disparities that were found rather than filled in, if confidences tell it, and otherwise all.
    #[must_use]
    pub fn sparse_q4(&self) -> Vec<i16> {
        let mut disparities_q4 = self.disparities_q4.clone();
        let confidences = self.confidences.iter().flatten();
        for (disparity_q4, confidence) in disparities_q4.iter_mut().zip(confidences) {
            if *confidence == 0 {
                *disparity_q4 = INVALID;
            }
        }
        disparities_q4
    }
}

/// The disparities of a frame, if it has them.
///
/// # Errors
/// Fails when the board has not told the size of its view, or they lie outside of that.
pub fn found(frame: &Frame, board: &Board) -> Result<Option<Found>> {
    let Some(plane) = &frame.disparities else {
        return Ok(None);
    };
    let hello = board.hello.as_ref();
    let hello = hello.context("the board has not introduced itself before")?;
    let size = [hello.matched.width_px.into(), hello.matched.height_lines];
    let disparities_q4 = plane.in_view(size, INVALID);
    let confidences = frame.confidences.as_ref();
    Ok(Some(Found {
        disparities_q4: disparities_q4.context("its disparities lie outside of the view")?,
        confidences: confidences.and_then(|plane| plane.in_view(size, 0)),
        size,
    }))
}

/// The pair of views of a frame, if it has one: the rectified one if it has both.
///
/// # Errors
/// Fails when the views have no columns.
pub fn pair(frame: &Frame) -> Result<Option<Pair>> {
    let pictures = frame.rectified.as_ref().or(frame.raw.as_ref());
    pictures
        .map(|pictures| pair_of(pictures, frame.rectified.is_some()))
        .transpose()
}

fn pair_of(pictures: &Pictures, is_rectified: bool) -> Result<Pair> {
    let [left, right] = unpacked(pictures);
    Ok(Pair {
        left: image(left)?,
        right: image(right)?,
        is_rectified,
    })
}

/// A view as a picture, as a file of it is read.
fn image(pixels: Pixels) -> Result<RgbImage> {
    let height = u32::try_from(pixels.grey.height())?;
    let width = u32::try_from(pixels.grey.width)?;
    ensure!(width > 0, "the views have no columns");
    let image = match pixels.colour {
        Some(colour) => RgbImage::from_raw(width, height, colour.values),
        None => GrayImage::from_raw(width, height, pixels.grey.values)
            .map(|grey| DynamicImage::from(grey).into_rgb8()),
    };
    image.context("the views are not made of whole lines")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_frames_have_one_name_though_a_board_begins_anew() {
        let mut names = Names::default();
        let frames = [0, 1, 7, u32::MAX, 0, 7, 7, 8];
        let names = frames.map(|frame| names.next(frame));
        let expected = [
            "000000",
            "000001",
            "000007",
            "4294967295",
            "000000_2",
            "000007_2",
            "000007_3",
            "000008_3",
        ];
        assert_eq!(names, expected);
    }
}
