//! Host simulator of vgstereo: the core that firmware links, fed from images and rendered
//! scenes. The command `vgstereo` is in [`commands`], kernels for the host in [`kernels`].

pub mod arguments;
pub mod camera;
pub mod commands;
pub mod dataset;
pub mod disparity_files;
pub mod exposure;
pub mod files;
pub mod frame;
pub mod kernels;
pub mod line_offset;
pub mod metrics;
pub mod parameters;
pub mod pictures;
pub mod prepared;
pub mod published;
pub mod render;
pub mod scene;
pub mod sink;
pub mod tables;
pub mod terminal;
pub mod views;
