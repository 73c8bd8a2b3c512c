//! The stored inputs of the fuzz targets, run by the very functions that are fuzzed.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use libtest_mimic::{Arguments, Trial};
use vgstereo_tests::fuzz::TARGETS;

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

fn main() {
    let mut trials = vec![Trial::test("all_targets_are_listed", || {
        let listed = TARGETS.map(|(name, _)| name.to_owned()).into();
        assert_eq!(names(&folder("fuzz_targets")), listed, "the programs");
        assert_eq!(names(&folder("corpus")), listed, "the corpora");
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
                run(&fs::read(&path)?);
                Ok(())
            }));
        }
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
