//! What the tests share: a folder with images and scenes, and runs of `vgstereo` in it.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use image::{DynamicImage, GrayImage, Luma, Rgb, RgbImage};
use tempfile::TempDir;

/// A temporary folder with a textured pair of images, `left.png` and `right.png`, whose disparity is
/// [`SHIFT`] everywhere.
pub(crate) struct Fixture {
    pub folder: TempDir,
}

pub(crate) const WIDTH: u32 = 80;
pub(crate) const HEIGHT: u32 = 40;
pub(crate) const SHIFT: u32 = 5;

impl Fixture {
    pub(crate) fn new() -> Self {
        let fixture = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        texture(0).save(fixture.path("left.png")).unwrap();
        texture(SHIFT).save(fixture.path("right.png")).unwrap();
        fixture
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs `vgstereo` in the folder and returns what it printed.
    pub(crate) fn run(&self, arguments: &[&str]) -> Outcome {
        let output = Command::cargo_bin("vgstereo")
            .unwrap()
            .current_dir(self.folder.path())
            .args(arguments)
            .output()
            .unwrap();
        Outcome {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }

    /// Returns the sorted names of the files in the folder.
    pub(crate) fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// Checks that these arguments are refused: with code 2, with one line on standard error that
    /// has these words, and without a file written.
    #[track_caller]
    pub(crate) fn refuses(&self, arguments: &[&str], words: &[&str]) {
        let before = self.files();
        let outcome = self.run(arguments);
        assert_eq!(outcome.code, Some(2), "{arguments:?}: {}", outcome.stderr);
        assert_eq!(outcome.stdout, "", "{arguments:?}");
        assert_eq!(outcome.stderr.lines().count(), 1, "{}", outcome.stderr);
        for word in words {
            assert!(
                outcome.stderr.contains(word),
                "{word:?} in {}",
                outcome.stderr
            );
        }
        assert_eq!(self.files(), before, "{arguments:?} wrote something");
    }
}

pub(crate) struct Outcome {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

/// The files below a folder, each with its bytes, by their paths in it.
pub(crate) fn files_below(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            let below = files_below(&path).into_iter();
            files.extend(below.map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            files.push((name, fs::read(path).unwrap()));
        }
    }
    files.sort();
    files
}

/// Returns a texture without repetition, moved to the left by `shift` columns.
pub(crate) fn texture(shift: u32) -> RgbImage {
    RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let mixed = ((x + shift) * 2_654_435 + y * 40_503).wrapping_mul(2_246_822_519) >> 15;
        Rgb([mixed as u8, (mixed >> 3) as u8, (mixed >> 5) as u8])
    })
}

/// Writes the folder of a scene with these masks. `gt` is the ground truth in the steps of its file.
pub(crate) fn write_scene(folder: &Path, gt: &DynamicImage, meta: &str, masks: &[&str]) {
    fs::create_dir_all(folder).unwrap();
    texture(0).save(folder.join("left.png")).unwrap();
    texture(SHIFT).save(folder.join("right.png")).unwrap();
    gt.save(folder.join("gt_left.png")).unwrap();
    fs::write(folder.join("meta.toml"), meta).unwrap();
    for mask in masks {
        let inner = |x, y| (20..WIDTH - 20).contains(&x) && (8..HEIGHT - 8).contains(&y);
        GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
            Luma([if inner(x, y) { 255 } else { 128 }])
        })
        .save(folder.join(mask))
        .unwrap();
    }
}

/// Returns a folder whose sub-folder `set` holds the scenes `a`, with all masks, and `b`, with one
/// mask and ground truth that is 2 px off.
pub(crate) fn two_scenes() -> Fixture {
    let fixture = Fixture::new();
    let byte = GrayImage::from_pixel(WIDTH, HEIGHT, Luma([4 * SHIFT as u8]));
    write_scene(
        &fixture.path("set/a"),
        &byte.into(),
        "d_max = 12\ngt_scale = 4\n",
        &["nonocc.png", "all.png", "disc.png"],
    );
    let wide = image::ImageBuffer::from_pixel(WIDTH, HEIGHT, Luma([256 * (SHIFT as u16 + 2)]));
    write_scene(
        &fixture.path("set/b"),
        &DynamicImage::ImageLuma16(wide),
        "d_max = 12\ngt_scale = 256\n",
        &["nonocc.png"],
    );
    // Not a scene: it has folders, not images.
    fs::create_dir_all(fixture.path("set/group/deep")).unwrap();
    fixture
}
