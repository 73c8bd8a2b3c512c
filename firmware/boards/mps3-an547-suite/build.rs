//! Tells the linker where the board's memory description is.

fn main() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../mps3-an547");
    println!("cargo::rustc-link-search={folder}");
    println!("cargo::rerun-if-changed={folder}/memory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
}
