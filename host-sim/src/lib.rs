//! Host simulator of vgstereo.
