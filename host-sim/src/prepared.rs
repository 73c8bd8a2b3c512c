//! A scene with the lines of its views: ready to be matched and measured.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use vgstereo_core::geometry::Rectification;
use vgstereo_core::{Config, DisparityRange, Output, Parameters};
use vgstereo_kernels::NativeKernels;

use crate::dataset::load_scene;
use crate::escapes::{shown, shown_name};
use crate::metrics::BadPixels;
use crate::rectify::rectified;
use crate::scene::Scene;
use crate::views::{picture_of, views_of};
use vgstereo_frame::{Matched, Views, match_frame};

/// A scene whose views were converted to the lines that a matcher takes.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The scene: images, search range and ground truth.
    pub scene: Scene,
    views: Views,
}

impl Prepared {
    /// Loads the scene in `folder`. With `grey`, the grey of colour images is matched.
    ///
    /// # Errors
    /// Fails with one line that names the file or folder and the reason.
    pub fn load(folder: &Path, grey: bool) -> Result<Self> {
        Self::new(load_scene(folder)?, grey).with_context(|| shown(folder))
    }

    /// Prepares a scene that is already in memory. With `grey`, the grey of colour images is
    /// matched.
    ///
    /// # Errors
    /// Fails when the views are wider than a matcher takes, or not wider than the largest disparity.
    pub fn new(scene: Scene, grey: bool) -> Result<Self> {
        let views = views_of(scene.left.clone(), scene.right.clone(), grey)?;
        Self::with_views(scene, views)
    }

    fn with_views(scene: Scene, views: Views) -> Result<Self> {
        ensure!(
            scene.d_max < views.width,
            "d_max, {} px, is not smaller than the width of the views, {} px",
            scene.d_max,
            views.width
        );
        Ok(Self { scene, views })
    }

    /// Prepares a scene whose views are as the cameras gave them: they are rectified, and become the
    /// scene's. With `grey`, the grey of colour images is matched.
    ///
    /// # Errors
    /// Fails with one line that gives the reason when the rectification is for views of another size,
    /// or as [`Prepared::new`] does.
    pub fn rectified(
        mut scene: Scene,
        grey: bool,
        rectification: &Rectification<'_>,
    ) -> Result<Self> {
        let raw = views_of(scene.left, scene.right, grey)?;
        let views = rectified(&raw, rectification)?;
        (scene.left, scene.right) = (picture_of(&views, 0)?, picture_of(&views, 1)?);
        Self::with_views(scene, views)
    }

    /// Returns the disparities that are searched: 0 to the scene's largest.
    #[must_use]
    pub fn disparities(&self) -> DisparityRange {
        DisparityRange::up_to(self.scene.d_max)
    }

    /// Returns whether the ground truth has all three masks of the benchmark.
    #[must_use]
    pub fn has_all_masks(&self) -> bool {
        let truth = self.scene.truth.as_ref();
        truth.is_some_and(|truth| {
            truth.nonocc.is_some() && truth.all.is_some() && truth.disc.is_some()
        })
    }

    /// Matches the views with up to `threads` threads and returns the disparities of the left
    /// view.
    ///
    /// # Errors
    /// Fails with one line that names the scene when the parameters are not valid or do not
    /// fit it.
    pub fn matched(
        &self,
        parameters: Parameters,
        output: Output,
        threads: usize,
    ) -> Result<Matched> {
        self.matched_as_frame(1, parameters, output, threads)
    }

    /// Matches the views as [`Prepared::matched`] does, as a camera's frame of this number, from 1 on, whose
    /// frames before were the same: each begins with the offsets of lines that the one before it taught.
    ///
    /// # Errors
    /// Those of [`Prepared::matched`].
    pub fn matched_as_frame(
        &self,
        number: u32,
        parameters: Parameters,
        output: Output,
        threads: usize,
    ) -> Result<Matched> {
        let mut config = Config {
            colour: self.views.has_colour(),
            output,
            ..Config::new(parameters, self.views.width, self.disparities())
        };
        let matched = |config: &Config| {
            match_frame(config, &self.views, NativeKernels::fastest(), threads)
                .with_context(|| shown_name(&self.scene.name))
        };
        for _ in 1..number {
            config.line_offsets = matched(&config)?.line_offsets;
        }
        matched(&config)
    }

    /// Returns the bad pixels of `matched`: those further than `threshold_px` from the ground
    /// truth. With `sparse`, pixels without a disparity do not count.
    ///
    /// # Errors
    /// Fails when the scene has no ground truth.
    pub fn measure(&self, matched: &Matched, threshold_px: f32, sparse: bool) -> Result<BadPixels> {
        let truth = self.scene.truth.as_ref();
        let truth = truth
            .with_context(|| format!("{} has no ground truth", shown_name(&self.scene.name)))?;
        Ok(BadPixels::measure(
            &matched.disparities_q4,
            truth,
            threshold_px,
            sparse,
        ))
    }
}
