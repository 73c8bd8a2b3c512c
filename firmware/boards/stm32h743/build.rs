//! Puts the board's memory layout where the linker looks for it.

fn main() {
    let own = env!("CARGO_MANIFEST_DIR");
    println!("cargo::rustc-link-search={own}");
    println!("cargo::rerun-if-changed={own}/memory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    // Takes no flash: shows what calls what.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
