//! Host simulator of vgstereo.

pub mod camera;
pub mod sink;
