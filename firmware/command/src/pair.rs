//! Pairs of images for the boards.

use std::path::Path;

use anyhow::{Result, ensure};
use image::RgbImage;
use image::imageops::{crop_imm, thumbnail};
use vgstereo_core::camera::{Geometry, Layout, LinePairSource, PixelFormat};
use vgstereo_core::disparity::DisparityRange;
use vgstereo_core::preset::Preset;
use vgstereo_emulated::Request;
use vgstereo_emulated::request::MAX_FAULTS;
use vgstereo_firmware::scripted::ScriptedFault;
use vgstereo_sim::camera::SimulatedCamera;
use vgstereo_sim::dataset::load_scene;
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::scene::Scene;

use crate::board::Board;

/// A pair as a board's camera sends it.
#[derive(Debug, Clone)]
pub struct Pair {
    /// Name for tables.
    pub name: String,
    /// Left view.
    pub left: RgbImage,
    /// Right view, of the same size.
    pub right: RgbImage,
    /// How pixels are sent.
    pub format: PixelFormat,
    /// Disparities to search.
    pub disparities: DisparityRange,
}

impl Pair {
    /// The built-in scene, in grey.
    #[must_use]
    pub fn rendered(width: u32, height: u32, disparities: u16) -> Self {
        let scene = render(&RenderOptions {
            width,
            height,
            d_max: disparities.saturating_sub(1),
            ..RenderOptions::default()
        });
        Self {
            format: PixelFormat::Grey8,
            ..Self::from(scene)
        }
    }

    /// A scene from disk as it fits a board: grey and half as large on a small one.
    ///
    /// # Errors
    /// When the scene cannot be read.
    pub fn load(folder: &Path, board: &Board) -> Result<Self> {
        let pair = Self::from(load_scene(folder)?);
        Ok(if board.is_small { pair.halved() } else { pair })
    }

    fn halved(self) -> Self {
        let half = |view: &RgbImage| thumbnail(view, view.width() / 2, view.height() / 2);
        Self {
            left: half(&self.left),
            right: half(&self.right),
            format: PixelFormat::Grey8,
            disparities: DisparityRange::up_to(self.disparities.count / 2),
            ..self
        }
    }

    /// Leaves the first `lines` lines.
    pub fn cut(&mut self, lines: u32) {
        for view in [&mut self.left, &mut self.right] {
            let (width, height) = view.dimensions();
            *view = crop_imm(view, 0, 0, width, lines.min(height)).to_image();
        }
    }

    /// The camera that sends it for ever.
    ///
    /// # Errors
    /// When the views differ in size or are too wide.
    pub fn camera(&self) -> Result<SimulatedCamera> {
        let (left, right) = (self.left.clone(), self.right.clone());
        let camera = SimulatedCamera::new(left, right, Layout::SideBySide, self.format)?;
        Ok(camera)
    }

    /// What the camera is.
    ///
    /// # Errors
    /// As [`Pair::camera`].
    pub fn geometry(&self) -> Result<Geometry> {
        Ok(self.camera()?.geometry())
    }

    /// The lines of a frame, of each the left view's bytes and then the right's.
    ///
    /// # Errors
    /// As [`Pair::camera`].
    pub fn lines(&self) -> Result<Vec<u8>> {
        let mut camera = self.camera()?;
        let line_bytes = self.geometry()?.line_bytes();
        let mut lines = vec![0; 2 * line_bytes * self.left.height() as usize];
        for pair in lines.chunks_exact_mut(2 * line_bytes) {
            let (left, right) = pair.split_at_mut(line_bytes);
            camera.read_pair(left, right)?;
        }
        Ok(lines)
    }

    /// The request to match this pair.
    ///
    /// # Errors
    /// As [`Pair::camera`]; when there are more faults than a board takes.
    pub fn request(
        &self,
        preset: Preset,
        frames: u32,
        faults: &[ScriptedFault],
    ) -> Result<Request> {
        let mut request = Request {
            preset,
            hamming_alone: false,
            geometry: self.geometry()?,
            disparities: self.disparities,
            frames,
            faults: Default::default(),
        };
        let taken = request.faults.extend_from_slice(faults);
        ensure!(taken.is_ok(), "a board takes at most {MAX_FAULTS} faults");
        Ok(request)
    }

    /// Width, height and number of disparities.
    #[must_use]
    pub fn size(&self) -> String {
        let (width, height) = self.left.dimensions();
        format!("{width}x{height}x{}", self.disparities.count)
    }
}

impl From<Scene> for Pair {
    fn from(scene: Scene) -> Self {
        Self {
            name: scene.name,
            left: scene.left,
            right: scene.right,
            format: PixelFormat::Rgb888,
            disparities: DisparityRange::up_to(scene.d_max),
        }
    }
}
