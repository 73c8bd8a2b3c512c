//! Host simulator of vgstereo.

pub mod camera;
pub mod commands;
pub mod dataset;
pub mod disparity_files;
pub mod files;
pub mod frame;
pub mod kernels;
pub mod metrics;
pub mod parameters;
pub mod pictures;
pub mod render;
pub mod scene;
pub mod sink;
pub mod views;
