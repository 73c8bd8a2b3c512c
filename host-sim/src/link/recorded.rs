//! The frames of a recording as input of what matches pairs or judges disparities, one at a time.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use vgstereo_core::INVALID;
use vgstereo_core::geometry::RectifiedCamera;
use vgstereo_firmware::camera::PixelFormat;

use super::attended::Attended;
use super::board::{Frame, Pictures};
use super::client::Memory;
use super::pixels::unpacked;
use super::recording::Damage;
use super::source::Source;
use crate::escapes::shown;
use crate::views::Views;

/// The frames of a recording, or of a file of bytes of the link.
#[derive(Debug)]
pub struct Frames<'m> {
    board: Attended<'m>,
    name: String,
    left_out: u64,
}

/// What a frame has that can be matched or judged: the first of these that it has.
#[derive(Debug, Clone)]
pub enum Seen {
    /// The disparities that the board found, 1/16 px, of the whole view, row-major; none where they were
    /// filled in, if confidences tell it.
    Disparities {
        /// The disparities.
        disparities_q4: Vec<i16>,
        /// Width of the view, px.
        width: usize,
        /// Whether confidences told which were found.
        is_sparse: bool,
    },
    /// A rectified pair of views.
    Rectified(Views),
    /// A pair of views as the camera gave it.
    Raw(Views),
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
            board: Attended::open(&source, memory)?,
            name: shown(path),
            left_out: 0,
        })
    }

    /// What the next frame has of which no line is missing; `None` after the last.
    ///
    /// # Errors
    /// Fails with one line that names the file and the frame when its views are too large.
    pub fn next_seen(&mut self) -> Result<Option<(u32, Seen)>> {
        while let Some(frame) = self.board.frame()? {
            let number = frame.begun.frame;
            let seen = self.seen(&frame);
            match seen.with_context(|| format!("{}: frame {number}", self.name))? {
                Some(seen) => return Ok(Some((number, seen))),
                None => self.left_out += 1,
            }
        }
        Ok(None)
    }

    /// The camera that the board has told.
    #[must_use]
    pub fn camera(&self) -> Option<RectifiedCamera> {
        self.board.board.rectified_camera()
    }

    /// Whether the board has said that it rectifies: its raw pairs are not what was matched.
    #[must_use]
    pub fn is_rectified_by_board(&self) -> bool {
        let hello = self.board.board.hello.as_ref();
        let told = hello.and_then(|hello| hello.fields.get("rectifies")?.as_bool());
        told.unwrap_or(false)
    }

    /// Number of frames that were left out: lines are missing, or they have neither views nor disparities.
    #[must_use]
    pub fn left_out(&self) -> u64 {
        self.left_out
    }

    /// Where the recording is no longer whole, once it was read up to there.
    #[must_use]
    pub fn damage(&self) -> Option<&Damage> {
        self.board.client().damage()
    }

    fn seen(&self, frame: &Frame) -> Result<Option<Seen>> {
        if !frame.is_whole() {
            return Ok(None);
        }
        if frame.disparities.is_some() {
            return self.disparities(frame).map(Some);
        }
        if let Some(pictures) = &frame.rectified {
            return views(pictures).map(Seen::Rectified).map(Some);
        }
        let raw = frame.raw.as_ref().map(views).transpose()?;
        Ok(raw.map(Seen::Raw))
    }

    fn disparities(&self, frame: &Frame) -> Result<Seen> {
        let hello = self.board.board.hello.as_ref();
        let hello = hello.context("the board has not introduced itself before")?;
        let size = [hello.matched.width_px.into(), hello.matched.height_lines];
        let found = frame.disparities.as_ref();
        let mut disparities_q4 = found
            .and_then(|plane| plane.in_view(size, INVALID))
            .context("its disparities lie outside of the view")?;
        let confidences = frame.confidences.as_ref();
        let confidences = confidences.and_then(|plane| plane.in_view(size, 0));
        for (disparity_q4, confidence) in
            disparities_q4.iter_mut().zip(confidences.iter().flatten())
        {
            if *confidence == 0 {
                *disparity_q4 = INVALID;
            }
        }
        Ok(Seen::Disparities {
            disparities_q4,
            width: hello.matched.width_px.into(),
            is_sparse: confidences.is_some(),
        })
    }
}

/// The views of a pair that a board has sent.
///
/// # Errors
/// Fails when they are too wide.
pub fn views(pictures: &Pictures) -> Result<Views> {
    let [left, right] = unpacked(pictures);
    let width = u16::try_from(left.grey.width)?;
    ensure!(width > 0, "the views have no columns");
    Ok(match (left.colour, right.colour) {
        (Some(left), Some(right)) => Views {
            left: left.values,
            right: right.values,
            width,
            format: PixelFormat::Rgb888,
            grey: None,
            valid_columns: Default::default(),
        },
        _ => Views {
            left: left.grey.values,
            right: right.grey.values,
            width,
            format: PixelFormat::Grey8,
            grey: None,
            valid_columns: Default::default(),
        },
    })
}
