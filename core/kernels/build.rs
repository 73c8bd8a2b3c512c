//! Tells the library which extensions the target has, because stable compilers do not expose these target features to code.

use std::env::var;

/// Processors with the vector instructions of Helium, as the compiler names them.
const HELIUM_PROCESSORS: [&str; 3] = ["cortex-m52", "cortex-m55", "cortex-m85"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-check-cfg=cfg(dsp_extension, helium, xpulp)");
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
    if target.starts_with("riscv32") && var("CARGO_FEATURE_XPULP_INSTRUCTIONS").is_ok() {
        println!("cargo::rustc-cfg=xpulp");
    }
    // Every processor with Helium has the DSP extension.
    if target.starts_with("thumbv7em") || has_helium {
        println!("cargo::rustc-cfg=dsp_extension");
    }
}
