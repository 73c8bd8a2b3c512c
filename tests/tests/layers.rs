//! The layers of the crates: nothing lower imports anything upper, and no files import each
//! other in a circle.
//!
//! A node is a source file; an arrow is a path from one file into another, in a `use` or in
//! code, that of tests left out. The folder of a module is a room: it imports only rooms that
//! stand before it in the list of its crate.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use syn::visit::{self, Visit};

/// The rooms of a crate, lowest first, and the imports from below that are allowed, with the
/// reason for each.
struct Layers {
    /// Folder of the crate's sources, from the root of the workspace.
    sources: &'static str,
    /// Rooms, lowest first; those of one inner list do not import each other.
    rooms: &'static [&'static [&'static str]],
    /// A file, the room above it that it imports nevertheless, and why.
    allowed: &'static [(&'static str, &'static str, &'static str)],
}

const CRATES: [Layers; 8] = [
    Layers {
        sources: "core/src",
        rooms: &[
            &["disparity"],
            &["kernel"],
            &["rows"],
            &["geometry"],
            &["config"],
            &["pattern"],
            &["recall", "sgm", "literal"],
            &["plan"],
            &["matcher"],
        ],
        allowed: &[],
    },
    Layers {
        sources: "core/kernels/src",
        rooms: &[
            &["cases", "xpulp"],
            &["aarch64", "armv7em", "stereo_unit", "x86_64"],
            &["helium", "rv32", "native"],
            &["rv32_bytes"],
            &["rv32_xpulp"],
        ],
        allowed: &[],
    },
    Layers {
        sources: "firmware/link/src",
        rooms: &[
            &["pack", "packet"],
            &["message"],
            &["settings"],
            &["board", "host"],
            &["assembler", "decoder", "encoder"],
        ],
        allowed: &[],
    },
    Layers {
        sources: "firmware/src",
        rooms: &[
            &["camera", "watchdog"],
            &["fault", "sensors", "calibration"],
            &["sink"],
            &["session"],
            &["scripted"],
            &["live"],
        ],
        allowed: &[],
    },
    Layers {
        sources: "firmware/command/src",
        rooms: &[],
        allowed: &[],
    },
    Layers {
        sources: "host-sim/courtyard/src",
        rooms: &[],
        allowed: &[],
    },
    Layers {
        sources: "host-sim/frame/src",
        rooms: &[&["views"], &["map"], &["bands", "pipelined"]],
        allowed: &[],
    },
    Layers {
        sources: "host-sim/src",
        rooms: &[],
        allowed: &[],
    },
];

/// A module: the names from the crate's root down to it.
type Module = Vec<String>;

/// All modules of a crate that have a file of their own, with the modules that each imports.
fn arrows(sources: &Path) -> BTreeMap<Module, BTreeSet<Module>> {
    let files = files_below(sources);
    let modules: BTreeMap<Module, &PathBuf> = files
        .iter()
        .map(|file| (module_of(file.strip_prefix(sources).unwrap()), file))
        .collect();
    let mut arrows = BTreeMap::new();
    for (module, file) in &modules {
        let text = fs::read_to_string(file).unwrap();
        let syntax = syn::parse_file(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let mut paths = Paths::default();
        paths.visit_file(&syntax);
        let imported = paths.found.iter().filter_map(|path| {
            let absolute = absolute(path, module)?;
            // The file that the path leads into: its longest part that is a module.
            (0..=absolute.len())
                .rev()
                .map(|length| absolute[..length].to_vec())
                .find(|part| modules.contains_key(part))
        });
        let imported = imported.filter(|other| other != module).collect();
        arrows.insert(module.clone(), imported);
    }
    arrows
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = vec![];
    for entry in fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_below(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files
}

/// The module that a file is, from its place below the sources; the root is empty.
fn module_of(file: &Path) -> Module {
    let names = file.with_extension("");
    let mut names: Module = names
        .iter()
        .map(|name| name.to_string_lossy().into_owned())
        .collect();
    if names.last().is_some_and(|name| name == "mod") || names == ["lib"] {
        names.pop();
    }
    names
}

/// A path as it is written, from the root of the crate; `None` where it leads out of it.
fn absolute(path: &[String], module: &Module) -> Option<Module> {
    let (first, rest) = path.split_first()?;
    let start = match first.as_str() {
        "crate" => vec![],
        "self" => module.clone(),
        "super" => module[..module.len().checked_sub(1)?].to_vec(),
        _ => return None,
    };
    let mut absolute = start;
    for name in rest {
        if name == "super" {
            absolute.pop()?;
        } else {
            absolute.push(name.clone());
        }
    }
    Some(absolute)
}

/// Paths that begin at this crate, in all code but that of tests.
#[derive(Default)]
struct Paths {
    found: Vec<Vec<String>>,
}

impl Paths {
    fn add_tree(&mut self, tree: &syn::UseTree, mut path: Vec<String>) {
        match tree {
            syn::UseTree::Path(part) => {
                path.push(part.ident.to_string());
                self.add_tree(&part.tree, path);
            }
            syn::UseTree::Name(name) => {
                path.push(name.ident.to_string());
                self.found.push(path);
            }
            syn::UseTree::Rename(name) => {
                path.push(name.ident.to_string());
                self.found.push(path);
            }
            syn::UseTree::Glob(_) => self.found.push(path),
            syn::UseTree::Group(group) => {
                for tree in &group.items {
                    self.add_tree(tree, path.clone());
                }
            }
        }
    }
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let syn::Meta::List(list) = &attribute.meta else {
            return false;
        };
        list.path.is_ident("cfg") && list.tokens.to_string() == "test"
    })
}

impl<'ast> Visit<'ast> for Paths {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_test(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        self.add_tree(&item.tree, vec![]);
    }

    // `pub(crate)` imports nothing.
    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names = path.segments.iter().map(|part| part.ident.to_string());
        self.found.push(names.collect());
        visit::visit_path(self, path);
    }
}

/// A circle of modules that import each other, if there is one.
fn circle(arrows: &BTreeMap<Module, BTreeSet<Module>>) -> Option<Vec<Module>> {
    let mut rest = arrows.clone();
    loop {
        // A module that imports nothing of the rest is in no circle.
        let names: BTreeSet<Module> = rest.keys().cloned().collect();
        let free = rest
            .iter()
            .find(|(_, imported)| imported.is_disjoint(&names))
            .map(|(module, _)| module.clone());
        match free {
            Some(module) => rest.remove(&module),
            None if rest.is_empty() => return None,
            None => return Some(rest.into_keys().collect()),
        };
    }
}

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    for layers in &CRATES {
        let arrows = arrows(&workspace().join(layers.sources));
        assert!(arrows.len() > 4, "{}: hardly any file", layers.sources);
        let circle = circle(&arrows).map(|modules| {
            let names: Vec<String> = modules.iter().map(|module| module.join("::")).collect();
            names
        });
        assert_eq!(circle, None, "{}", layers.sources);
    }
}

#[test]
fn nothing_lower_imports_anything_upper() {
    for layers in &CRATES {
        if layers.rooms.is_empty() {
            continue;
        }
        let rank = |room: &str| {
            let mut rooms = layers.rooms.iter();
            let rank = rooms.position(|rooms| rooms.contains(&room));
            rank.unwrap_or_else(|| panic!("{}: {room} has no layer in the list", layers.sources))
        };
        let mut unused: BTreeSet<usize> = (0..layers.allowed.len()).collect();
        for (module, imported) in arrows(&workspace().join(layers.sources)) {
            // The root re-exports what it likes.
            let Some(room) = module.first() else { continue };
            let name = module.join("::");
            for other in imported.iter().filter(|other| other.first() != Some(room)) {
                let Some(other_room) = other.first() else {
                    panic!("{}: {name} imports the root of its crate", layers.sources);
                };
                let mut allowed = layers.allowed.iter();
                let reason = allowed.position(|(file, to, _)| *file == name && to == other_room);
                if let Some(reason) = reason {
                    unused.remove(&reason);
                }
                assert!(
                    rank(other_room) < rank(room) || reason.is_some(),
                    "{}: {name} imports {}",
                    layers.sources,
                    other.join("::")
                );
            }
        }
        assert!(
            unused.is_empty(),
            "{}: not needed: {unused:?}",
            layers.sources
        );
    }
}

/// The reader of sources sees what it is there to see.
#[test]
fn imports_and_circles_are_seen() {
    let found = |text: &str| {
        let mut paths = Paths::default();
        paths.visit_file(&syn::parse_file(text).unwrap());
        paths.found
    };
    let text = "use crate::{a::b, c as d}; fn f() { super::g::h(); } \
                #[cfg(test)] mod tests { use crate::z; }";
    let names = |path: &[&str]| {
        path.iter()
            .map(|name| (*name).to_owned())
            .collect::<Vec<_>>()
    };
    let expected = [
        names(&["crate", "a", "b"]),
        names(&["crate", "c"]),
        names(&["super", "g", "h"]),
    ];
    assert_eq!(found(text), expected);
    assert_eq!(
        absolute(&names(&["super", "super", "x"]), &names(&["a", "b"])),
        Some(names(&["x"]))
    );
    let module = |name: &str| vec![name.to_owned()];
    let mut arrows = BTreeMap::from([
        (module("a"), BTreeSet::from([module("b")])),
        (module("b"), BTreeSet::from([module("c")])),
        (module("c"), BTreeSet::new()),
    ]);
    assert_eq!(circle(&arrows), None);
    arrows.insert(module("c"), BTreeSet::from([module("b")]));
    let circle = circle(&arrows).unwrap();
    assert!(circle.contains(&module("b")) && circle.contains(&module("c")));
}
