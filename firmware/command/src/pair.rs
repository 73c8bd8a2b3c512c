//! Pairs of images as the cameras of the boards send them.

use std::path::Path;

use anyhow::{Result, ensure};
use glam::{DMat3, DVec3};
use image::RgbImage;
use image::imageops::{crop_imm, thumbnail};
use vgstereo_core::geometry::{
    Interpolation, Rectification, RectifiedCamera, Rectifier, ScanConfig,
};
use vgstereo_core::{DisparityRange, Preset, Reference};
use vgstereo_emulated::Request;
use vgstereo_emulated::request::{Calibration, CameraRequest, MAX_FAULTS, ScanRequest};
use vgstereo_firmware::camera::{Geometry, Layout, LinePairSource, PixelFormat};
use vgstereo_firmware::scripted::ScriptedFault;
use vgstereo_sim::calibration::{Camera, Lens, Maps, RectifiedPair, StereoCalibration};
use vgstereo_sim::camera::SimulatedCamera;
use vgstereo_sim::dataset::load_scene;
use vgstereo_sim::render::{RenderOptions, rectified_camera, render, rendered_cameras};
use vgstereo_sim::scene::Scene;

use crate::board::Board;

/// A pair of images, rectified or with its rectification, with the pixel format in which a board's
/// camera sends it and the disparities that the board searches.
#[derive(Debug, Clone)]
pub struct Pair {
    /// The name in tables.
    pub name: String,
    /// The left view.
    pub left: RgbImage,
    /// The right view; its size is that of the left view.
    pub right: RgbImage,
    /// The pixel format on the wire.
    pub format: PixelFormat,
    /// The disparities to search.
    pub disparities: DisparityRange,
    /// The rectification of the views; `None` if they are rectified.
    pub rectification: Option<Vec<u8>>,
    /// The left rectified camera, and how far it looks down, rad, if that is known.
    pub camera: Option<(RectifiedCamera, Option<f32>)>,
}

impl Pair {
    /// Returns the built-in scene in grey, `width` x `height` px, with `disparities`
    /// disparities from 0 on.
    #[must_use]
    pub fn rendered(width: u32, height: u32, disparities: u16) -> Self {
        let options = RenderOptions {
            width,
            height,
            d_max: disparities.saturating_sub(1),
            ..RenderOptions::default()
        };
        let cameras = rendered_cameras(&options);
        let camera = rectified_camera(&cameras);
        Self {
            format: PixelFormat::Grey8,
            camera: camera.map(|camera| (camera, Some(cameras.pitch_rad as f32))),
            ..Self::from(render(&options))
        }
    }

    /// Returns the built-in scene as [`Pair::rendered`] does, taken for what two distorted cameras
    /// see that are turned against each other; with `all` that they see, also with pixels at the borders
    /// that no camera saw. What a board makes of it shows no scene, but every step
    /// of the rectification.
    ///
    /// # Errors
    /// Fails when no pixel of such views would be seen by both cameras.
    pub fn crooked(width: u16, height: u16, disparities: u16, all: bool) -> Result<Self> {
        let middle = |px: u16| f64::from(px - 1) / 2.0;
        let focal_px = f64::from(width);
        let camera = |distortion: [f64; 4], offset_px: f64| {
            let lens = Lens::radial_tangential(&distortion)?;
            let matrix = [
                focal_px,
                focal_px,
                middle(width) + offset_px,
                middle(height) - offset_px,
            ];
            Camera::new(matrix, lens, Some([width, height]))
        };
        let calibration = StereoCalibration {
            cameras: [
                camera([-0.3, 0.1, 0.0, 0.0], 1.5)?,
                camera([-0.25, 0.08, 0.0, 0.0], -2.0)?,
            ],
            rotation: DMat3::from_rotation_z(0.02) * DMat3::from_rotation_x(-0.01),
            translation: DVec3::new(-60.0, 0.5, 1.0),
            unit_mm: Some(1.0),
            format: "built-in",
            stored: None,
            warnings: Vec::new(),
        };
        let size = [width, height];
        let views = RectifiedPair::compute(&calibration, size, size, all)?;
        let maps = Maps::new(&views, calibration.unit_mm, Interpolation::Bilinear)?;
        let camera = Rectification::from_bytes(&maps.bytes)?.camera(Reference::Left);
        Ok(Self {
            name: "crooked".to_owned(),
            camera: camera.map(|camera| (camera, None)),
            rectification: Some(maps.bytes),
            ..Self::rendered(width.into(), height.into(), disparities)
        })
    }

    /// Loads a scene so that it fits a board: in grey and half as large on a small board,
    /// whole and in colour on the others.
    ///
    /// # Errors
    /// Fails when the scene cannot be read.
    pub fn load(folder: &Path, board: &Board) -> Result<Self> {
        let pair = Self::from(load_scene(folder)?);
        Ok(if board.is_small { pair.halved() } else { pair })
    }

    /// Returns the pair in grey with half the width, height and disparities.
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

    /// Cuts both views to their first `lines` lines, unless they have a rectification, which is for all
    /// of them.
    pub fn cut(&mut self, lines: u32) {
        if self.rectification.is_some() {
            return;
        }
        for view in [&mut self.left, &mut self.right] {
            let (width, height) = view.dimensions();
            *view = crop_imm(view, 0, 0, width, lines.min(height)).to_image();
        }
    }

    /// Returns the pair with the middle `columns` columns of both views, which have no rectification.
    #[must_use]
    pub fn middle(self, columns: u32) -> Self {
        let part = |view: &RgbImage| {
            let (width, height) = view.dimensions();
            let columns = columns.min(width);
            crop_imm(view, (width - columns) / 2, 0, columns, height).to_image()
        };
        Self {
            left: part(&self.left),
            right: part(&self.right),
            ..self
        }
    }

    /// Returns a camera that sends this pair as every frame.
    ///
    /// # Errors
    /// Fails when the views differ in size, are empty or are too wide.
    pub fn camera(&self) -> Result<SimulatedCamera> {
        let (left, right) = (self.left.clone(), self.right.clone());
        let camera = SimulatedCamera::new(left, right, Layout::SideBySide, self.format)?;
        Ok(camera)
    }

    /// Returns the size of the views and the pixel format.
    ///
    /// # Errors
    /// Fails when there is no camera for this pair; see [`Pair::camera`].
    pub fn geometry(&self) -> Result<Geometry> {
        Ok(self.camera()?.geometry())
    }

    /// Returns the bytes of a frame: for each line those of the left view, then those of the
    /// right view.
    ///
    /// # Errors
    /// Fails when there is no camera for this pair; see [`Pair::camera`].
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

    /// Returns the request to match this pair with `preset` until `frames` frames are whole,
    /// while the camera has these faults.
    ///
    /// # Errors
    /// Fails when there is no camera for this pair, see [`Pair::camera`], or when there are
    /// more faults than a board takes.
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
            calibration: self.calibration()?,
            scan: None,
            camera: None,
            is_live: false,
            disparities: self.disparities,
            frames,
            faults: Default::default(),
        };
        let taken = request.faults.extend_from_slice(faults);
        ensure!(taken.is_ok(), "a board takes at most {MAX_FAULTS} faults");
        Ok(request)
    }

    /// Returns the request to match this pair for ever and to serve the link, while the camera has
    /// these faults.
    ///
    /// # Errors
    /// As [`Pair::request`].
    pub fn live_request(&self, preset: Preset, faults: &[ScriptedFault]) -> Result<Request> {
        let camera = self.camera.filter(|_| self.rectification.is_none());
        Ok(Request {
            camera: camera.map(|(camera, _)| CameraRequest::new(&camera)),
            is_live: true,
            ..self.request(preset, 0, faults)?
        })
    }

    /// Returns a laser scan of 60 bearings of what this pair shows at heights from 500 mm below the
    /// camera to 300 mm above; `None` if its camera is not known.
    #[must_use]
    pub fn scan(&self) -> Option<ScanRequest> {
        let (camera, pitch_rad) = self.camera?;
        let width = u16::try_from(self.left.width()).ok()?;
        Some(ScanRequest::new(&ScanConfig {
            camera,
            columns: 0..width,
            bearings: width.min(60),
            pitch_rad: pitch_rad.unwrap_or_default(),
            heights_mm: -500..=300,
            range_max_mm: 30_000,
            lines_min: 3,
            confidence_min: 1,
        }))
    }

    /// What a board has to know of the rectification.
    fn calibration(&self) -> Result<Option<Calibration>> {
        let Some(bytes) = &self.rectification else {
            return Ok(None);
        };
        let rectification = Rectification::from_bytes(bytes)?;
        let words = Rectifier::words(&rectification, !self.format.is_grey());
        Ok(Some(Calibration {
            bytes: u32::try_from(bytes.len())?,
            rectifier_words: u32::try_from(words)?,
            width: rectification.width,
        }))
    }

    /// Returns width and height of the views that are matched, px: those of the images, or of what they
    /// are rectified to.
    ///
    /// # Errors
    /// Fails when the bytes of the rectification are none.
    pub fn matched_size(&self) -> Result<(u32, u32)> {
        let Some(bytes) = &self.rectification else {
            return Ok(self.left.dimensions());
        };
        let rectification = Rectification::from_bytes(bytes)?;
        Ok((rectification.width.into(), rectification.height.into()))
    }

    /// Returns width, height and number of disparities as text, such as `160x120x32`.
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
            rectification: None,
            camera: None,
        }
    }
}
