//! Host simulator of vgstereo.

pub mod render;
pub mod scene;
