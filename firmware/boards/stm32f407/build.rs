//! Puts the board's memory description where the linker looks for it.

fn main() {
    let own = env!("CARGO_MANIFEST_DIR");
    println!("cargo::rustc-link-search={own}");
    println!("cargo::rerun-if-changed={own}/memory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    // Relocations take no flash. They show which function calls which.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
