//! What is done with pairs of one size: all that can be refused was, before any is decoded.

use std::path::PathBuf;

use anyhow::{Context, Result};
use image::ImageFormat;
use vgstereo_core::geometry::{Depth, LaserScan, Rectification, RectifiedCamera, ScanConfig};
use vgstereo_core::{Config, DisparityRange, Parameters, Reference};
use vgstereo_kernels::NativeKernels;

use super::options::Options;
use super::targets::Targets;
use crate::arguments::output_of;
use crate::cameras::Cameras;
use crate::depth_files::DepthFormat;
use crate::disparity_files::{DisparityFormat, grey_png};
use crate::files::encode;
use crate::frame::{Matched, match_frame};
use crate::images::ViewImages;
use crate::pictures::colour_disparities;
use crate::point_files::PointFormat;
use crate::rectify::rectified;
use crate::scan_files::ScanFormat;
use crate::views::Views;

/// What is done with pairs of a size.
#[derive(Debug)]
pub(super) struct Plan {
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
    /// The plan for raw images of this size, px. The formats of files are those of these targets.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub(super) fn new(options: &Options, targets: &Targets, size: (u32, u32)) -> Result<Self> {
        let cameras = options.cameras.read(Some(size))?;
        let rectification = rectification(&cameras)?;
        let (width, height) = match &rectification {
            Some(r) => (u32::from(r.width), u32::from(r.height)),
            None => size,
        };
        let width = u16::try_from(width)?;
        let depth = match &targets.depth {
            Some(path) => {
                let format = DepthFormat::choose(path)?;
                let warnings = &cameras.warnings;
                let depth = options
                    .cameras
                    .depth("--depth", rectification.as_ref(), warnings)?;
                Some((format, depth))
            }
            None => None,
        };
        let camera = |option| {
            let size = [width.into(), height];
            let (reference, warnings) = (options.reference.into(), &cameras.warnings);
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
            ..Config::new(parameters, width, disparities)
        };
        config.validate()?;
        Ok(Self {
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
        let mut views = Views::new(images.left, images.right, options.grey)?;
        if let Some(rectification) = rectification(&self.cameras)? {
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
            let colours = views.picture(reference)?;
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
            let picture = views.picture(view)?;
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

fn scan_memory(config: &ScanConfig) -> Vec<u32> {
    vec![0; LaserScan::words(config.bearings, config.lines_min)]
}
