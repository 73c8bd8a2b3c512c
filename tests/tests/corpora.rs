//! The stored inputs of the fuzz targets, and what becomes of them when a few bytes are spoilt, run by the very
//! functions that are fuzzed.

use std::collections::BTreeSet;
use std::fs;
use std::panic;
use std::path::{Path, PathBuf};

use libtest_mimic::{Arguments, Trial};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_tests::fuzz::TARGETS;

/// Inputs that are made of each stored one.
const SPOILT: u64 = 100;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fuzz")
        .join(name)
}

/// The names in a folder, with the end `.rs` cut off.
fn names(folder: &Path) -> BTreeSet<String> {
    let entries =
        fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names
        .map(|name| name.trim_end_matches(".rs").to_owned())
        .collect()
}

/// The source of the program that gives a target to the fuzzer, which a stable compiler does not build.
fn program(target: &str) -> String {
    format!(
        "//! Fuzz target `{target}`: see [`vgstereo_tests::fuzz::{target}`].\n\n#![no_main]\n\n\
        libfuzzer_sys::fuzz_target!(|bytes: &[u8]| vgstereo_tests::fuzz::{target}::run(bytes));\n"
    )
}

/// An input with one to four changes: a byte replaced, a bit flipped, a piece removed or repeated, the end cut off.
fn spoilt(input: &[u8], seed: u64) -> Vec<u8> {
    let mut random = Pcg32::seed_from_u64(seed);
    let mut below = |limit: usize| random.next_u32() as usize % limit.max(1);
    let mut bytes = input.to_vec();
    for _ in 0..=below(4) {
        let first = below(bytes.len());
        let last = (first + 1 + below(16)).min(bytes.len());
        match below(5) {
            0 => bytes[first..]
                .iter_mut()
                .take(1)
                .for_each(|byte| *byte = below(256) as u8),
            1 => bytes[first..]
                .iter_mut()
                .take(1)
                .for_each(|byte| *byte ^= 1 << below(8)),
            2 => drop(bytes.drain(first..last)),
            3 => {
                let piece = bytes[first..last].to_vec();
                bytes.splice(first..first, piece);
            }
            _ => bytes.truncate(first),
        }
    }
    bytes
}

fn main() {
    let mut trials = vec![Trial::test("all_targets_are_listed", || {
        let listed = TARGETS.map(|(name, _)| name.to_owned()).into();
        assert_eq!(names(&folder("fuzz_targets")), listed, "the programs");
        assert_eq!(names(&folder("corpus")), listed, "the corpora");
        for (name, _) in TARGETS {
            let path = folder("fuzz_targets").join(format!("{name}.rs"));
            assert_eq!(fs::read_to_string(path)?, program(name));
        }
        Ok(())
    })];
    for (target, run) in TARGETS {
        let corpus = folder("corpus").join(target);
        trials.push(Trial::test(format!("{target}::has_a_corpus"), move || {
            assert!(!names(&folder("corpus").join(target)).is_empty());
            Ok(())
        }));
        let inputs = fs::read_dir(corpus).into_iter().flatten();
        for path in inputs.map(|entry| entry.unwrap().path()) {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            trials.push(Trial::test(format!("{target}::{name}"), move || {
                let input = fs::read(&path)?;
                run(&input);
                for seed in 0..SPOILT {
                    let input = spoilt(&input, seed);
                    if panic::catch_unwind(|| run(&input)).is_err() {
                        return Err(format!("panics when spoilt with seed {seed}").into());
                    }
                }
                Ok(())
            }));
        }
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
