//! What is done with pairs of one kind: all that can be refused was, before any is decoded.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use image::ImageFormat;
use vgstereo_core::geometry::{Depth, LaserScan, Rectification, RectifiedCamera, ScanConfig};
use vgstereo_core::{Config, DisparityRange, LineOffsets, Parameters, Reference};
use vgstereo_kernels::NativeKernels;

use super::options::Options;
use super::targets::Targets;
use crate::arguments::output_of;
use crate::cameras::Cameras;
use crate::depth_files::DepthFormat;
use crate::disparity_files::{DisparityFormat, grey_png};
use crate::files::encode;
use crate::images::ViewImages;
use crate::line_offsets::ViewOffsets;
use crate::pictures::colour_disparities;
use crate::point_files::PointFormat;
use crate::rectify::rectified;
use crate::scan_files::ScanFormat;
use crate::views::{picture_of, views_of};
use vgstereo_frame::{Matched, Views, match_frame};

/// What pairs have in common that are matched by one plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Kind {
    /// Width and height of a view as it comes, px.
    pub(super) size: (u32, u32),
    /// Whether they are rectified, though there be a calibration.
    pub(super) is_rectified: bool,
    /// The camera of the left view once it is rectified, where the options tell none.
    pub(super) camera: Option<RectifiedCamera>,
}

impl Kind {
    /// Images of this size, px.
    pub(super) fn of_images(size: (u32, u32)) -> Self {
        Self {
            size,
            is_rectified: false,
            camera: None,
        }
    }
}

/// What is done with pairs of a kind.
#[derive(Debug)]
pub(super) struct Plan {
    kind: Kind,
    cameras: Cameras,
    config: Config,
    height: u32,
    map: DisparityFormat,
    depth: Option<(DepthFormat, Depth)>,
    points: Option<(PointFormat, RectifiedCamera)>,
    scan: Option<(ScanFormat, ScanConfig)>,
}

/// A pair that was matched, and the files to write.
#[derive(Debug)]
pub(super) struct Done {
    pub(super) views: Views,
    pub(super) matched: Matched,
    /// The files of the targets, that of the map first.
    pub(super) files: Vec<(PathBuf, Vec<u8>)>,
}

impl Done {
    /// The pixels whose disparities were found, percent, rounded down.
    pub(super) fn found_percent(&self) -> usize {
        let confidences = &self.matched.confidences;
        let found = confidences.iter().filter(|&&c| c > 0).count();
        found * 100 / confidences.len().max(1)
    }
}

impl Plan {
    /// The plan for pairs of this kind. The formats of files are those of these targets.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub(super) fn new(options: &Options, targets: &Targets, kind: Kind) -> Result<Self> {
        let cameras = options
            .cameras
            .read((!kind.is_rectified).then_some(kind.size))?;
        let rectification = rectification(&cameras)?;
        let (width, height) = match &rectification {
            Some(r) => (u32::from(r.width), u32::from(r.height)),
            None => kind.size,
        };
        ensure!(
            !kind.is_rectified || (width, height) == kind.size,
            "--calibration gives views of {width}x{height} px, and these were rectified to {}x{}",
            kind.size.0,
            kind.size.1
        );
        let width = u16::try_from(width)?;
        let told = kind.camera.filter(|_| !options.cameras.are_given());
        let depth = match (&targets.depth, told) {
            (Some(path), Some(camera)) => Some((DepthFormat::choose(path)?, camera.depth())),
            (Some(path), None) => {
                let format = DepthFormat::choose(path)?;
                let warnings = &cameras.warnings;
                let depth = options
                    .cameras
                    .depth("--depth", rectification.as_ref(), warnings)?;
                Some((format, depth))
            }
            (None, _) => None,
        };
        let camera = |option| {
            let size = [width.into(), height];
            let (reference, warnings) = (options.reference.into(), &cameras.warnings);
            if let Some(left) = told {
                return seen_from(reference, left).context(option);
            }
            options
                .cameras
                .camera(option, rectification.as_ref(), warnings, size, reference)
        };
        let points = match &targets.points {
            Some(path) => Some((PointFormat::choose(path)?, camera("--points")?)),
            None => None,
        };
        let scan = match &targets.scan {
            Some(path) => {
                let format = ScanFormat::choose(path)?;
                let config = options.scan.config(camera("--scan")?, width, None);
                LaserScan::new(&config, &mut scan_memory(&config)).context("--scan")?;
                Some((format, config))
            }
            None => None,
        };
        let disparities = options.disparities(width)?;
        let map = DisparityFormat::choose(&targets.out, options.scale, disparities)?;
        let parameters = options.overrides.apply(options.preset)?;
        let config = Config {
            reference: options.reference.into(),
            output: output_of(options.sparse),
            line_offsets: match options.line_offsets {
                Some(offsets) => offsets.in_lines(height),
                None => LineOffsets::NONE,
            },
            ..Config::new(parameters, width, disparities)
        };
        config.validate()?;
        Ok(Self {
            kind,
            cameras,
            config,
            height,
            map,
            depth,
            points,
            scan,
        })
    }

    /// Matches a pair, and encodes the files of its targets.
    ///
    /// # Errors
    /// Fails with one line that gives the reason.
    pub(super) fn run(
        &self,
        options: &Options,
        targets: &Targets,
        images: ViewImages,
        threads: usize,
    ) -> Result<Done> {
        let mut views = views_of(images.left, images.right, options.grey)?;
        let rectification = rectification(&self.cameras)?;
        if let Some(rectification) = rectification.filter(|_| !self.kind.is_rectified) {
            views = rectified(&views, &rectification)?;
        }
        let config = Config {
            colour: views.has_colour(),
            ..self.config
        };
        let matched = match_frame(&config, &views, NativeKernels::fastest(), threads)?;
        let files = self.files(targets, &views, &matched)?;
        Ok(Done {
            views,
            matched,
            files,
        })
    }

    fn files(
        &self,
        targets: &Targets,
        views: &Views,
        matched: &Matched,
    ) -> Result<Vec<(PathBuf, Vec<u8>)>> {
        let (width, disparities) = (self.config.width, self.config.disparities);
        let map = &matched.disparities_q4;
        let mut files = vec![(targets.out.clone(), self.map.encode(map, width.into())?)];
        if let Some(path) = &targets.colour {
            let picture = colour_disparities(map, width.into(), disparities);
            files.push((path.clone(), encode(&picture.into(), ImageFormat::Png)?));
        }
        if let (Some(path), Some((format, depth))) = (&targets.depth, &self.depth) {
            files.push((path.clone(), format.encode(map, width, depth)?));
        }
        if let (Some(path), Some((format, camera))) = (&targets.points, &self.points) {
            let reference = usize::from(self.config.reference == Reference::Right);
            let colours = picture_of(views, reference)?;
            let bytes = format.encode(matched.lines(width), &colours, camera)?;
            files.push((path.clone(), bytes));
        }
        if let Some(path) = &targets.confidence {
            let meaning = "1 to 255, 0 = filled in or none".to_owned();
            let size = [width.into(), self.height];
            let png = grey_png(&matched.confidences, size, false, "Confidence", meaning)?;
            files.push((path.clone(), png));
        }
        if let (Some(path), Some((format, config))) = (&targets.scan, &self.scan) {
            let mut memory = scan_memory(config);
            let mut scan = LaserScan::new(config, &mut memory).context("--scan")?;
            matched.lines(width).for_each(|line| scan.push(&line));
            let depth = config.camera.depth();
            files.push((
                path.clone(),
                format.encode(&scan.finish(), &depth, disparities)?,
            ));
        }
        for (view, path) in targets.views().into_iter().enumerate() {
            let picture = picture_of(views, view)?;
            files.push((path, encode(&picture.into(), ImageFormat::Png)?));
        }
        Ok(files)
    }

    /// The files of these targets, and how the values of a file are to be read where that has to be said.
    pub(super) fn written(&self, targets: &Targets) -> Vec<(PathBuf, Option<String>)> {
        let meaning = |path: &PathBuf| {
            let is = |target: &Option<PathBuf>| target.as_ref() == Some(path);
            if *path == targets.out {
                Some(self.map.meaning())
            } else if is(&targets.depth) {
                self.depth.map(|(format, _)| format.meaning().to_owned())
            } else if is(&targets.points) {
                self.points.map(|(format, _)| format.meaning().to_owned())
            } else {
                None
            }
        };
        let mut written: Vec<_> = targets
            .files()
            .into_iter()
            .map(|path| (path.clone(), meaning(&path)))
            .collect();
        // Those with a meaning first.
        written.sort_by_key(|(_, meaning)| meaning.is_none());
        written
    }

    /// What a pair showed of how the lines of the other view lie, if it was not known before.
    pub(super) fn line_offsets_shown(&self, matched: &Matched) -> Option<ViewOffsets> {
        let shown = matched.line_offsets;
        (shown != self.config.line_offsets).then(|| ViewOffsets::of(shown, self.height))
    }

    /// A line that says what a pair showed so, and how to begin with it.
    pub(super) fn line_offsets_told(&self, matched: &Matched) -> Option<String> {
        let shown = self.line_offsets_shown(matched)?;
        let told = matched
            .line_offsets
            .told(self.height, self.config.reference);
        Some(format!(
            "{told}: made up for as far as lines are moved; to begin with it, --line-offsets={shown}"
        ))
    }

    /// The disparities that are searched.
    pub(super) fn disparities(&self) -> DisparityRange {
        self.config.disparities
    }

    /// The parameters of the matcher.
    pub(super) fn parameters(&self) -> &Parameters {
        &self.config.parameters
    }

    /// Width and height of the views that are matched, px.
    pub(super) fn size(&self) -> [u32; 2] {
        [self.config.width.into(), self.height]
    }

    /// What the views are rectified by, in lines; nothing where they are not.
    pub(super) fn rectification_told(&self) -> Result<String> {
        let rectification = rectification(&self.cameras)?;
        Ok(rectification.map_or_else(String::new, |r| self.cameras.told(&r)))
    }
}

fn rectification(cameras: &Cameras) -> Result<Option<Rectification<'_>>> {
    let bytes = cameras.rectification.as_deref();
    Ok(bytes.map(Rectification::from_bytes).transpose()?)
}

/// The camera of the reference view, by that of the left one.
fn seen_from(reference: Reference, left: RectifiedCamera) -> Result<RectifiedCamera> {
    let [mut x_q8, y_q8] = left.principal_q8();
    if reference == Reference::Right {
        x_q8 = x_q8.saturating_add(left.depth().offset_q8());
    }
    let camera = RectifiedCamera::new(left.depth(), left.focal_q8(), [x_q8, y_q8]);
    camera.context("the camera that the board has told is out of bounds")
}

fn scan_memory(config: &ScanConfig) -> Vec<u32> {
    vec![0; LaserScan::words(config.bearings, config.lines_min)]
}
