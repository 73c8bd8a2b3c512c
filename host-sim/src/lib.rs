//! The host simulator of vgstereo. It feeds the core that firmware links with stored images and
//! rendered scenes.
//!
//! From the bottom up: [`escapes`] makes names printable; [`files`], [`images`], [`pair_files`],
//! [`pair_lists`], [`pfm`], [`disparity_files`], [`depth_files`], [`point_files`], [`scan_files`] and
//! [`parameters`] read and write files. [`mod@calibration`] makes rectifications from calibration
//! files. [`scene`] holds a stereo pair, [`views`] makes what is matched of its images, [`mod@rectify`] rectifies it, [`dataset`]
//! loads one, [`render`] makes one, and [`exposure`] and [`line_offset`] let the right camera
//! differ from the left, and [`stress`] disturbs both. [`camera`] and [`sink`] are the two ends of a firmware's session.
//! The crate `vgstereo-frame` matches whole frames, and [`pair_check`] tells what is wrong with a pair. [`chessboard`] tells whether a board of squares is seen whole. [`metrics`] measures disparities against ground truth,
//! [`pictures`] shows them, [`published`] has results to compare with, and [`prepared`] joins a
//! scene with its matching and measuring. [`mod@link`] is the host's end of a board's link, and
//! [`mod@view`] shows what comes over it. [`arguments`], [`pair_arguments`], [`cameras`], [`tables`] and [`terminal`]
//! serve the [`commands`] of `vgstereo`.

pub mod arguments;
pub mod calibration;
pub mod camera;
pub mod cameras;
pub mod chessboard;
pub mod commands;
pub mod dataset;
pub mod depth_files;
pub mod disparity_files;
pub mod escapes;
pub mod exposure;
pub mod files;
pub mod images;
pub mod line_offset;
pub mod line_offsets;
pub mod link;
pub mod metrics;
pub mod pair_arguments;
pub mod pair_check;
pub mod pair_files;
pub mod pair_lists;
pub mod parameters;
pub mod pfm;
pub mod pictures;
pub mod point_files;
pub mod prepared;
pub mod published;
pub mod rectify;
pub mod render;
pub mod scan_files;
pub mod scene;
pub mod sink;
pub mod stress;
pub mod tables;
pub mod terminal;
pub mod view;
pub mod views;
pub mod wall;
