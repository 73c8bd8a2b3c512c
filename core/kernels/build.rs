//! Tells the library which extensions the target has, because stable compilers do not expose these target features to code.

use std::env::var;

/// Processors with the vector instructions of Helium, as the compiler names them.
const HELIUM_PROCESSORS: [&str; 3] = ["cortex-m52", "cortex-m55", "cortex-m85"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!(
        "cargo::rustc-check-cfg=cfg(dsp_extension, helium, rv32, rv32_bytes, rv32_xpulp, xpulp)"
    );
    let target = var("TARGET").unwrap_or_default();
    // The name of the target does not tell what a part of Armv8-M has: its flags do.
    let flags = var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default();
    let has_helium = target.starts_with("thumbv8m.main")
        && flags.split('\x1f').any(|flag| {
            let processor = flag.split_once("target-cpu=").map(|(_, name)| name);
            processor.is_some_and(|name| HELIUM_PROCESSORS.contains(&name))
        });
    if has_helium {
        println!("cargo::rustc-cfg=helium");
    }
    // A program for a processor with Xpulp asks for it: nothing else tells.
    let is_riscv = target.starts_with("riscv32");
    let has_xpulp = is_riscv && var("CARGO_FEATURE_XPULP_INSTRUCTIONS").is_ok();
    if has_xpulp {
        println!("cargo::rustc-cfg=xpulp");
    }
    // Whatever has an operating system has all sets for RISC-V, so that their arithmetic is tested. A bare processor has
    // those that it can run: to compile the others takes longer than its own.
    let is_bare = var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "none");
    let has_bytes = is_riscv && var("CARGO_FEATURE_BYTE_INSTRUCTIONS").is_ok();
    let sets = [
        ("rv32", is_riscv),
        // Those for Xpulp share code with it.
        ("rv32_bytes", has_bytes || has_xpulp),
        ("rv32_xpulp", has_xpulp),
    ];
    for (set, _) in sets.iter().filter(|(_, runs)| *runs || !is_bare) {
        println!("cargo::rustc-cfg={set}");
    }
    // Every processor with Helium has the DSP extension.
    if target.starts_with("thumbv7em") || has_helium {
        println!("cargo::rustc-cfg=dsp_extension");
    }
}
