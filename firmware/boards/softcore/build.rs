//! Tells the linker where the memory descriptions of this board's programs are.

fn main() {
    let folder = env!("CARGO_MANIFEST_DIR");
    println!("cargo::rustc-link-search={folder}");
    for (program, memory) in [
        ("softcore", "memory.x"),
        ("softcore-plain", "memory-plain.x"),
    ] {
        println!("cargo::rerun-if-changed={folder}/{memory}");
        println!("cargo::rustc-link-arg-bin={program}=-T{memory}");
    }
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // Relocations take no room. A test finds calls of panic functions by them.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
