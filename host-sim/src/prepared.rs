//! A scene with the lines of its views: ready to be matched and measured.

use std::path::Path;

use anyhow::{Context, Result};
use vgstereo_core::geometry::Rectification;
use vgstereo_core::{Config, DisparityRange, Output, Parameters};
use vgstereo_kernels::NativeKernels;

use crate::dataset::load_scene;
use crate::frame::{Matched, match_frame};
use crate::metrics::BadPixels;
use crate::rectify::rectified;
use crate::scene::Scene;
use crate::views::Views;

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
        Self::new(load_scene(folder)?, grey).with_context(|| folder.display().to_string())
    }

    /// Prepares a scene that is already in memory. With `grey`, the grey of colour images is
    /// matched.
    ///
    /// # Errors
    /// Fails when the views are wider than a matcher takes.
    pub fn new(scene: Scene, grey: bool) -> Result<Self> {
        let views = Views::new(scene.left.clone(), scene.right.clone(), grey)?;
        Ok(Self { scene, views })
    }

    /// Prepares a scene whose views are as the cameras gave them: they are rectified, and become the
    /// scene's. With `grey`, the grey of colour images is matched.
    ///
    /// # Errors
    /// Fails with one line that gives the reason when the rectification is for views of another size.
    pub fn rectified(
        mut scene: Scene,
        grey: bool,
        rectification: &Rectification<'_>,
    ) -> Result<Self> {
        let raw = Views::new(scene.left, scene.right, grey)?;
        let views = rectified(&raw, rectification)?;
        (scene.left, scene.right) = (views.picture(0)?, views.picture(1)?);
        Ok(Self { scene, views })
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
        let config = Config {
            colour: self.views.has_colour(),
            output,
            ..Config::new(parameters, self.views.width, self.disparities())
        };
        match_frame(&config, &self.views, NativeKernels::fastest(), threads)
            .with_context(|| self.scene.name.clone())
    }

    /// Returns the bad pixels of `matched`: those further than `threshold_px` from the ground
    /// truth. With `sparse`, pixels without a disparity do not count.
    ///
    /// # Errors
    /// Fails when the scene has no ground truth.
    pub fn measure(&self, matched: &Matched, threshold_px: f32, sparse: bool) -> Result<BadPixels> {
        let truth = self.scene.truth.as_ref();
        let truth = truth.with_context(|| format!("{} has no ground truth", self.scene.name))?;
        Ok(BadPixels::measure(
            &matched.disparities_q4,
            truth,
            threshold_px,
            sparse,
        ))
    }
}
