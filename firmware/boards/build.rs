//! Tells the linker where the board's memory description is: in the folder of its package.

fn main() {
    let folder = env!("CARGO_MANIFEST_DIR");
    println!("cargo::rustc-link-search={folder}");
    println!("cargo::rerun-if-changed={folder}/memory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    // Relocations take no flash. Tests find by them which function calls which.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
