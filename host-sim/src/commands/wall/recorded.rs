//! What is judged of a recording: the disparities that the board has found, or its pairs, matched here.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use vgstereo_core::geometry::{Rectification, RectifiedCamera};
use vgstereo_core::{Config, Parameters, Reference};
use vgstereo_kernels::NativeKernels;

use super::{Judged, Wall};
use crate::arguments::name_of;
use crate::cameras::Cameras;
use crate::escapes::shown;
use crate::images::is_image;
use crate::link::board::{Board, Frame};
use crate::link::client::Memory;
use crate::link::recorded::{DENSE, Found, Frames, JUDGED, Pair, found, pair};
use crate::rectify::rectified;
use crate::terminal::progress_bar;
use crate::views::views_of;
use vgstereo_frame::match_frame;

/// What a frame has that is judged.
enum Seen {
    Found(Found),
    Pair(Pair),
}

impl Seen {
    /// What of a frame is judged: its disparities, or else its pair.
    fn of(frame: &Frame, board: &Board) -> Result<Option<Self>> {
        if let Some(found) = found(frame, board)? {
            return Ok(Some(Self::Found(found)));
        }
        Ok(pair(frame)?.map(Self::Pair))
    }

    fn kind(&self) -> Kind {
        match self {
            Self::Found(_) => Kind::Found,
            Self::Pair(pair) if pair.is_rectified => Kind::Rectified,
            Self::Pair(_) => Kind::Raw,
        }
    }
}

/// What the frames of a recording have. All that are judged have the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Found,
    Rectified,
    Raw,
}

/// The frames that are judged.
struct Gathered {
    frames: Vec<Vec<i16>>,
    size: [usize; 2],
    kind: Kind,
    /// Whether filled in disparities could not be told from those found.
    is_dense: bool,
}

impl Wall {
    /// Takes the disparities of a recording, or matches its pairs.
    pub(super) fn recorded(&self, path: &Path) -> Result<Judged> {
        ensure!(
            path.is_file(),
            "{}: there is no such file: give pairs of images, or one recording",
            shown(path)
        );
        ensure!(!is_image(path), "{}: one image is no pair", shown(path));
        let mut memory = Memory::default();
        let mut recorded = Frames::open(path, &mut memory)?;
        let cameras = self.cameras.read(None)?;
        let rectification = cameras.rectification.as_deref();
        let rectification = rectification.map(Rectification::from_bytes).transpose()?;
        let parameters = self.overrides.apply(self.preset)?;
        let gathered = self.gather(&mut recorded, rectification.as_ref(), parameters, path)?;
        let camera = self.camera_of(&recorded, rectification.as_ref(), &cameras, gathered.size)?;
        let count = match gathered.frames.len() {
            1 => "1 frame".to_owned(),
            count => format!("{count} frames"),
        };
        let name = name_of(&parameters, self.preset);
        let what = match gathered.kind {
            Kind::Found => format!("the board's disparities, {count}"),
            Kind::Rectified => format!("{name}, rectified pairs, {count}"),
            Kind::Raw => format!("{name}, raw pairs, {count}"),
        };
        let mut notes = recorded.lacks(JUDGED);
        if gathered.is_dense {
            notes.insert(0, DENSE.to_owned());
        }
        Ok(Judged {
            what,
            frames: gathered.frames,
            size: gathered.size,
            camera,
            notes: notes.iter().map(|note| format!("{note}\n")).collect(),
        })
    }

    /// The camera that the options tell, or else the board.
    fn camera_of(
        &self,
        recorded: &Frames<'_>,
        rectification: Option<&Rectification<'_>>,
        cameras: &Cameras,
        size: [usize; 2],
    ) -> Result<RectifiedCamera> {
        let told = recorded.camera().filter(|_| !self.cameras.are_given());
        if let Some(camera) = told {
            return Ok(camera);
        }
        let size = [u32::try_from(size[0])?, u32::try_from(size[1])?];
        let warnings = &cameras.warnings;
        self.cameras
            .camera("wall", rectification, warnings, size, Reference::Left)
    }

    /// Reads as many frames as are judged, and matches those that are pairs.
    fn gather(
        &self,
        recorded: &mut Frames<'_>,
        rectification: Option<&Rectification<'_>>,
        parameters: Parameters,
        path: &Path,
    ) -> Result<Gathered> {
        let bar = progress_bar(self.frames.into(), "frames of the wall");
        let mut gathered: Option<Gathered> = None;
        let count = |gathered: &Option<Gathered>| gathered.as_ref().map_or(0, |g| g.frames.len());
        while count(&gathered) < self.frames.into() {
            let Some((frame, seen)) = recorded.next_of(Seen::of)? else {
                break;
            };
            let seen = seen?;
            let kind = seen.kind();
            let is_dense = matches!(&seen, Seen::Found(found) if found.confidences.is_none());
            let (disparities_q4, size) = match seen {
                Seen::Found(found) => (found.sparse_q4(), found.size.map(|side| side as usize)),
                Seen::Pair(pair) => {
                    let is_calibrated = rectification.is_some();
                    let matched = recorded
                        .ensure_rectifiable(&pair, is_calibrated, "--calibration")
                        .and_then(|()| self.match_pair(pair, rectification, parameters, path));
                    matched.with_context(|| recorded.place_of(&frame))?
                }
            };
            let gathered = gathered.get_or_insert_with(|| Gathered {
                frames: Vec::new(),
                size,
                kind,
                is_dense,
            });
            ensure!(
                (gathered.size, gathered.kind) == (size, kind),
                "{} is not of the size or the kind of those before",
                recorded.place_of(&frame)
            );
            gathered.frames.push(disparities_q4);
            bar.inc(1);
        }
        bar.finish_and_clear();
        gathered.ok_or_else(|| recorded.none(JUDGED))
    }

    /// Matches a pair of views, and returns its disparities and the size of their view.
    fn match_pair(
        &self,
        pair: Pair,
        rectification: Option<&Rectification<'_>>,
        parameters: Parameters,
        path: &Path,
    ) -> Result<(Vec<i16>, [usize; 2])> {
        let mut views = views_of(pair.left, pair.right, false)?;
        if let Some(rectification) = rectification.filter(|_| !pair.is_rectified) {
            views = rectified(&views, rectification)?;
        }
        let config = Config {
            colour: views.has_colour(),
            ..self.config(parameters, views.width, path)?
        };
        let matched = match_frame(&config, &views, NativeKernels::fastest(), 2)?;
        Ok((matched.disparities_q4, [views.width.into(), views.height()]))
    }
}
