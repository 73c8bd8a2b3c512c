//! Puts the memory description that the project shares for this part where the linker looks for it.

fn main() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../..");
    println!("cargo::rustc-link-search={root}");
    println!("cargo::rerun-if-changed={root}/memory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // A board that is built for one preset has no log.
    if std::env::var_os("CARGO_FEATURE_COMPLETE").is_some() {
        println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    }
    // Relocations take no flash. A test finds calls of panic functions by them.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
