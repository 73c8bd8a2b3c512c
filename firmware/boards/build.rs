//! Tells the linker where the board's memory description is: in the folder of its package.

fn main() {
    let folder = env!("CARGO_MANIFEST_DIR");
    println!("cargo::rustc-link-search={folder}");
    println!("cargo::rerun-if-changed={folder}/memory.x");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // A board that is built for one preset has no log.
    let is_alone = ["LITE", "MICRO"]
        .iter()
        .any(|preset| std::env::var_os(format!("CARGO_FEATURE_{preset}")).is_some());
    if !is_alone {
        println!("cargo::rustc-link-arg-bins=-Tdefmt.x");
    }
    // Relocations take no flash. Tests find by them which function calls which.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
