//! Tells the linker where this board's memory description is.

fn main() {
    let folder = env!("CARGO_MANIFEST_DIR");
    println!("cargo::rustc-link-search={folder}");
    println!("cargo::rerun-if-changed={folder}/memory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    // Relocations take no flash. A test finds calls of panic functions by them.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
