//! Puts the project's memory layout of this part where the linker looks for it.

fn main() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../..");
    println!("cargo::rustc-link-search={root}");
    println!("cargo::rerun-if-changed={root}/memory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    // Takes no flash: a test finds the calls of panic functions by them.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
