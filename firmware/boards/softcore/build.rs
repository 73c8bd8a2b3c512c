//! Tells the linker where this board's memory description is.

fn main() {
    let folder = env!("CARGO_MANIFEST_DIR");
    println!("cargo::rustc-link-search={folder}");
    println!("cargo::rerun-if-changed={folder}/memory.x");
    println!("cargo::rustc-link-arg-bins=-Tmemory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // Relocations take no room. A test finds calls of panic functions by them.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
