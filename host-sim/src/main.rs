//! The `vgstereo` command.
fn main() {}
