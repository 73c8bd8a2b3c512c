//! Many pairs of images: those of a folder by their names, and those of a list.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::escapes::{shown, shown_name};
use crate::files::read_text;
use crate::images::Arrangement;
use crate::pair_files::Pair;

/// Endings of images, in lower case.
const ENDINGS: [&str; 11] = [
    "png", "jpg", "jpeg", "bmp", "tif", "tiff", "webp", "pgm", "ppm", "pnm", "pbm",
];

/// A pair, and what its results are named for.
#[derive(Debug, Clone)]
pub struct NamedPair {
    /// The name: that of the left image without what tells the side.
    pub name: String,
    /// The images.
    pub pair: Pair,
}

/// Pairs, and what was left out.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// The pairs, by their names.
    pub pairs: Vec<NamedPair>,
    /// The images without a partner.
    pub alone: Vec<PathBuf>,
}

/// Returns the pairs of a folder and of the folders in it. Two images are one if their paths in it differ in
/// the side alone: words of the names are `left` and `right`, `l` and `r`, `cam0` and `cam1`, a name is `im0`
/// and `im1`, or a folder `image_0` and `image_1`, or `image_2` and `image_3`. With an arrangement, each
/// image is a pair.
///
/// # Errors
/// Fails with one line that names the folder, when it cannot be read or has no pair, or two pairs of one name.
pub fn in_folder(folder: &Path, arrangement: Option<Arrangement>) -> Result<Found> {
    let mut found = Found::default();
    let images = images_in(folder)?;
    let Some(arrangement) = arrangement else {
        let mut by_key: BTreeMap<String, [Option<PathBuf>; 2]> = BTreeMap::new();
        for image in images {
            let marked = Marked::new(image.strip_prefix(folder).unwrap_or(&image));
            if let Some(side) = marked.side {
                by_key.entry(marked.key).or_default()[side] = Some(image);
            }
        }
        for views in by_key.into_values() {
            found.add(views, folder);
        }
        ensure!(
            !found.pairs.is_empty(),
            "{}: no two images are named as a pair, such as left_01.png and right_01.png, or left/01.png and right/01.png",
            shown(folder)
        );
        return found.sorted();
    };
    for image in images {
        let name = image
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let pair = Pair::Joined(image, arrangement);
        found.pairs.push(NamedPair { name, pair });
    }
    ensure!(
        !found.pairs.is_empty(),
        "{}: there is no image",
        shown(folder)
    );
    found.sorted()
}

/// Returns the pairs of the images of two folders whose names are the same, or differ in the side alone.
///
/// # Errors
/// Fails with one line that names the folders, when they cannot be read or have no pair.
pub fn of_folders(left: &Path, right: &Path) -> Result<Found> {
    let mut by_key: BTreeMap<String, [Option<PathBuf>; 2]> = BTreeMap::new();
    for (side, folder) in [left, right].into_iter().enumerate() {
        for image in images_of(folder)? {
            let marked = Marked::new(Path::new(image.file_name().unwrap_or_default()));
            by_key.entry(marked.key).or_default()[side] = Some(image);
        }
    }
    let mut found = Found::default();
    for views in by_key.into_values() {
        found.add(views, left);
    }
    ensure!(
        !found.pairs.is_empty(),
        "{} and {} have no images of the same names",
        shown(left),
        shown(right)
    );
    found.sorted()
}

/// Returns the pairs of a list: a text with a left and a right image on each line, and a name for their
/// results if another is wanted, between white space or, where there are some, tabs. Paths are relative to
/// the list. Empty lines, and those that begin with #, are left out. With an arrangement, there is one image.
///
/// # Errors
/// Fails with one line that names the list and the line, when it cannot be read, a line is none, or two pairs
/// have one name.
pub fn in_list(list: &Path, arrangement: Option<Arrangement>) -> Result<Found> {
    let text = read_text(list)?;
    let folder = list.parent().unwrap_or(Path::new(""));
    let images = if arrangement.is_some() { 1 } else { 2 };
    let mut found = Found::default();
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let words: Vec<&str> = if line.contains('\t') {
            line.split('\t').map(str::trim).collect()
        } else {
            line.split_whitespace().collect()
        };
        let is_line = (images..=images + 1).contains(&words.len()) && !words.contains(&"");
        ensure!(
            is_line,
            "{}, line {number}: it is {}, and a name if wanted; tabs stand between paths with spaces",
            shown(list),
            if images == 2 {
                "a left and a right image"
            } else {
                "an image"
            }
        );
        let path = |word: &str| folder.join(word);
        let pair = match arrangement {
            Some(arrangement) => Pair::Joined(path(words[0]), arrangement),
            None => Pair::Separate(path(words[0]), path(words[1])),
        };
        let name = match words.get(images) {
            Some(&name) => name.to_owned(),
            None => name_of(Path::new(words[0])),
        };
        ensure!(
            is_plain(&name),
            "{}, line {number}: {} is no name for files",
            shown(list),
            shown_name(&name)
        );
        found.pairs.push(NamedPair { name, pair });
    }
    ensure!(!found.pairs.is_empty(), "{}: there is no pair", shown(list));
    found.distinct()
}

/// Returns the pairs of these images: left, right, left, right, ...
///
/// # Errors
/// Fails with one line when an image has no partner, or two pairs have one name.
pub fn of_images(images: &[PathBuf]) -> Result<Found> {
    let (pairs, rest) = images.as_chunks::<2>();
    ensure!(
        rest.is_empty(),
        "{} images: a pair has a left and a right one",
        images.len()
    );
    let pairs = pairs.iter().map(|[left, right]| NamedPair {
        name: name_of(left),
        pair: Pair::Separate(left.clone(), right.clone()),
    });
    let found = Found {
        pairs: pairs.collect(),
        alone: vec![],
    };
    found.distinct()
}

impl Found {
    fn add(&mut self, views: [Option<PathBuf>; 2], folder: &Path) {
        match views {
            [Some(left), Some(right)] => self.pairs.push(NamedPair {
                name: Marked::new(left.strip_prefix(folder).unwrap_or(&left)).name(),
                pair: Pair::Separate(left, right),
            }),
            views => self.alone.extend(views.into_iter().flatten()),
        }
    }

    fn sorted(mut self) -> Result<Self> {
        self.pairs.sort_by(|a, b| a.name.cmp(&b.name));
        self.alone.sort();
        self.distinct()
    }

    /// Checks that no two pairs have one name.
    fn distinct(self) -> Result<Self> {
        let mut places: HashMap<&str, &Pair> = HashMap::new();
        for NamedPair { name, pair } in &self.pairs {
            if let Some(other) = places.insert(name, pair) {
                let [first, second] = [other, pair].map(|pair| shown(pair.paths()[0]));
                anyhow::bail!(
                    "{first} and {second} are of two pairs of one name, {}",
                    shown_name(name)
                );
            }
        }
        Ok(self)
    }
}

/// The name of a pair whose left image is this: that of the file, or else of its folder.
fn name_of(left: &Path) -> String {
    let file = Marked::new(Path::new(left.file_name().unwrap_or_default()));
    if file.rest.is_empty() {
        let folder = left.parent().and_then(Path::file_name).unwrap_or_default();
        return Marked::new(&Path::new(folder).join("image"))
            .rest
            .first()
            .cloned()
            .unwrap_or_else(|| file.name());
    }
    file.name()
}

fn is_plain(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    matches!(
        (parts.next(), parts.next()),
        (Some(Component::Normal(_)), None)
    )
}

/// The images of a folder and of the folders in it.
fn images_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut images = images_of(folder)?;
    for below in entries(folder)? {
        if below.is_dir() {
            images.extend(images_of(&below)?);
        }
    }
    Ok(images)
}

fn images_of(folder: &Path) -> Result<Vec<PathBuf>> {
    let is_image = |path: &PathBuf| {
        let ending = path.extension().and_then(|ending| ending.to_str());
        let ending = ending.map(str::to_ascii_lowercase);
        ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str())) && path.is_file()
    };
    Ok(entries(folder)?.into_iter().filter(is_image).collect())
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let cannot_read = || format!("cannot read {}", shown(folder));
    let entries = fs::read_dir(folder).with_context(cannot_read)?;
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<_, _>>()
        .with_context(cannot_read)?;
    paths.sort();
    Ok(paths)
}

/// A path in which what names the side was found.
struct Marked {
    /// The side that all marks name: 0 is left, 1 is right.
    side: Option<usize>,
    /// The path with its marks replaced: both images of a pair have the same.
    key: String,
    /// The parts of the path, its ending not among them, without marks; those without anything else are
    /// left out.
    rest: Vec<String>,
}

impl Marked {
    fn new(path: &Path) -> Self {
        let parts: Vec<String> = path
            .components()
            .filter_map(|part| match part {
                Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
                _ => None,
            })
            .collect();
        let mut sides = Vec::new();
        let (mut keys, mut rest) = (Vec::new(), Vec::new());
        for (index, part) in parts.iter().enumerate() {
            let is_folder = index + 1 < parts.len();
            let (stem, ending) = match part.rsplit_once('.').filter(|_| !is_folder) {
                Some((stem, ending)) => (stem, ending),
                None => (part.as_str(), ""),
            };
            let marks = marks(stem, is_folder);
            let (mut key, mut pieces, mut from) = (String::new(), Vec::new(), 0);
            for mark in &marks {
                sides.push(mark.side);
                key += &format!("{}*{}", &stem[from..mark.place.start], mark.family);
                pieces.push(&stem[from..mark.place.start]);
                from = mark.place.end;
            }
            key += &format!("{}.{ending}", &stem[from..]);
            pieces.push(&stem[from..]);
            let pieces = pieces
                .iter()
                .map(|piece| piece.trim_matches(['_', '-', '.', ' ']));
            let pieces: Vec<&str> = pieces.filter(|piece| !piece.is_empty()).collect();
            keys.push(key);
            if !pieces.is_empty() {
                rest.push(pieces.join("_"));
            }
        }
        let is_one = sides.windows(2).all(|pair| pair[0] == pair[1]);
        Self {
            side: sides.first().copied().filter(|_| is_one),
            key: keys.join("/"),
            rest,
        }
    }

    fn name(&self) -> String {
        if self.rest.is_empty() {
            return "pair".to_owned();
        }
        self.rest.join("_")
    }
}

/// A part of a name that names the side.
struct Mark {
    place: std::ops::Range<usize>,
    side: usize,
    /// Tells pairs of cameras of one place apart.
    family: u32,
}

/// The parts of a file's or a folder's name that name the side.
fn marks(name: &str, is_folder: bool) -> Vec<Mark> {
    let words = words(name);
    let mut marks = Vec::new();
    for (index, place) in words.iter().enumerate() {
        let word = name[place.clone()].to_ascii_lowercase();
        // A number may follow at once, or after a stroke.
        let number = words.get(index + 1).filter(|number| {
            let between = &name[place.end..number.start];
            number.len() <= 2 && matches!(between, "" | "_" | "-")
        });
        let number =
            number.and_then(|number| Some((number.end, name[number.clone()].parse::<u32>().ok()?)));
        let is_alone = place.start == 0 && number.is_some_and(|(end, _)| end == name.len());
        let (end, side, family) = match (word.as_str(), number) {
            ("left" | "l", _) => (place.end, 0, 0),
            ("right" | "r", _) => (place.end, 1, 0),
            ("cam", Some((end, number @ 0..=1))) => (end, number, 0),
            ("im", Some((end, number @ 0..=1))) if is_alone => (end, number, 0),
            ("image", Some((end, number @ 0..=3))) if is_alone && is_folder => {
                (end, number % 2, number / 2)
            }
            _ => continue,
        };
        marks.push(Mark {
            place: place.start..end,
            side: side as usize,
            family,
        });
    }
    marks
}

/// The words of a name, of letters or of digits: a word also begins at the capital of `imageLeft`.
fn words(name: &str) -> Vec<std::ops::Range<usize>> {
    let mut words: Vec<std::ops::Range<usize>> = Vec::new();
    let mut before = ' ';
    for (at, letter) in name.char_indices() {
        let goes_on = letter.is_alphabetic()
            && before.is_alphabetic()
            && !(before.is_lowercase() && letter.is_uppercase())
            || letter.is_ascii_digit() && before.is_ascii_digit();
        let end = at + letter.len_utf8();
        match words.last_mut() {
            Some(word) if goes_on => word.end = end,
            _ if letter.is_alphabetic() || letter.is_ascii_digit() => words.push(at..end),
            _ => {}
        }
        before = letter;
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        folder
    }

    /// Name, left and right of each pair, and the images without a partner.
    fn told(found: &Found, folder: &Path) -> (Vec<String>, Vec<String>) {
        let inner = |path: &Path| path.strip_prefix(folder).unwrap().display().to_string();
        let pair = |named: &NamedPair| {
            let paths: Vec<String> = named.pair.paths().into_iter().map(inner).collect();
            format!("{}: {}", named.name, paths.join(" "))
        };
        let alone = found.alone.iter().map(|path| inner(path));
        (found.pairs.iter().map(pair).collect(), alone.collect())
    }

    #[test]
    fn pairs_are_found_by_names_that_differ_in_the_side_alone() {
        for (files, expected, alone) in [
            (
                &[
                    "left_02.png",
                    "right_01.png",
                    "left_01.png",
                    "right_02.png",
                    "left_03.png",
                    "notes.txt",
                ][..],
                &[
                    "01: left_01.png right_01.png",
                    "02: left_02.png right_02.png",
                ][..],
                &["left_03.png"][..],
            ),
            (
                &["left/7.png", "right/7.png", "right/8.jpg", "depth/7.png"],
                &["7: left/7.png right/7.png"],
                &["right/8.jpg"],
            ),
            (
                &[
                    "image_0/000_10.png",
                    "image_1/000_10.png",
                    "disp_occ/000_10.png",
                ],
                &["000_10: image_0/000_10.png image_1/000_10.png"],
                &[],
            ),
            (
                &[
                    "a_left.png",
                    "a_right.png",
                    "bLeft.png",
                    "bRight.png",
                    "bright.png",
                    "12-l.bmp",
                    "12-r.bmp",
                ],
                &[
                    "12: 12-l.bmp 12-r.bmp",
                    "a: a_left.png a_right.png",
                    "b: bLeft.png bRight.png",
                ],
                &[],
            ),
            (
                &[
                    "cones/im0.png",
                    "cones/im1.png",
                    "teddy/left.png",
                    "teddy/right.png",
                ],
                &[
                    "cones: cones/im0.png cones/im1.png",
                    "teddy: teddy/left.png teddy/right.png",
                ],
                &[],
            ),
            (
                &["left.png", "right.png"],
                &["pair: left.png right.png"],
                &[],
            ),
            (
                &[
                    "left/image_01.png",
                    "right/image_01.png",
                    "left/image_00.png",
                    "right/image_00.png",
                ],
                &[
                    "image_00: left/image_00.png right/image_00.png",
                    "image_01: left/image_01.png right/image_01.png",
                ],
                &[],
            ),
            (
                &["cam0/5.png", "cam1/5.png"],
                &["5: cam0/5.png cam1/5.png"],
                &[],
            ),
        ] {
            let folder = folder(files);
            let found = in_folder(folder.path(), None).unwrap();
            let (pairs, rest) = told(&found, folder.path());
            assert_eq!(
                (&pairs[..], &rest[..]),
                (
                    &expected.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()[..],
                    &alone.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()[..]
                )
            );
        }
    }

    #[test]
    fn folders_without_pairs_or_with_two_of_one_name_are_refused() {
        let refused = |files: &[&str]| {
            let folder = folder(files);
            in_folder(folder.path(), None).unwrap_err().to_string()
        };
        assert!(refused(&[]).contains("left_01.png and right_01.png"));
        assert!(refused(&["a.png", "left.png"]).contains("no two images"));
        let files = [
            "image_0/1.png",
            "image_1/1.png",
            "image_2/1.png",
            "image_3/1.png",
        ];
        assert!(
            refused(&files).ends_with("of one name, 1"),
            "{}",
            refused(&files)
        );
    }

    #[test]
    fn two_folders_pair_images_of_the_same_names() {
        let folder = folder(&[
            "a/1.png",
            "b/1.png",
            "a/2.png",
            "a/x_left.png",
            "b/x_right.png",
        ]);
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        let found = of_folders(&a, &b).unwrap();
        let (pairs, alone) = told(&found, folder.path());
        assert_eq!(
            pairs,
            ["1: a/1.png b/1.png", "x: a/x_left.png b/x_right.png"]
        );
        assert_eq!(alone, ["a/2.png"]);
        assert!(of_folders(&b, folder.path()).is_err());
    }

    #[test]
    fn lists_have_two_paths_a_line_and_a_name_if_wanted() {
        let folder = folder(&[]);
        let list = folder.path().join("pairs.txt");
        let read = |text: &str| {
            fs::write(&list, text).unwrap();
            in_list(&list, None)
        };
        let text =
            "# pairs\n\n s/left.png s/right.png\nl 1.png\tr 1.png\t first one\nb/l.png b/r.png x\n";
        let (pairs, _) = told(&read(text).unwrap(), folder.path());
        let expected = [
            "s: s/left.png s/right.png",
            "first one: l 1.png r 1.png",
            "x: b/l.png b/r.png",
        ];
        assert_eq!(pairs, expected);
        for (text, words) in [
            ("a.png\n", "line 1: it is a left and a right image"),
            ("\na.png b.png c d\n", "line 2"),
            ("a.png b.png ../c\n", "../c is no name"),
            ("a.png b.png\nx/a.png b.png\n", "of one name, a"),
            ("# none\n", "there is no pair"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
