//! Calibrations: from the files that people have to the rectification that the core reads.
//!
//! ```text
//!  files ─ document ─▶ opencv, ros, kalibr, euroc, boofcv ─ read ─▶ StereoCalibration ─ check ─┐
//!                                                                                              │
//!  bytes for the core ◀─ maps ── RectifiedPair ◀── rectified: Bouguet's, or the files' own ◀───┘
//! ```
//!
//! [`rectify`] goes the whole way. All is in `f64`: it runs once, on a host.

mod boofcv;
mod camera;
mod check;
mod document;
mod euroc;
mod kalibr;
mod lens;
mod make;
mod maps;
mod numpy;
mod opencv;
mod read;
mod rectified;
mod ros;
mod stereo;

pub use camera::Camera;
pub use check::checked;
pub use lens::{Lens, Model};
pub use make::{Options, Rectified, rectify};
pub use maps::{ERROR_MAX_PX, Maps};
pub use read::{projections, read};
pub use rectified::{Keep, RectifiedPair};
pub use ros::camera_infos;
pub use stereo::{StereoCalibration, StoredRectification, parse_unit};
