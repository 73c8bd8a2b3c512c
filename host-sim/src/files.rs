//! Reading and writing of files. Errors name the file, no more is read than a file of its kind can
//! have, and no file is left half written.

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Result, anyhow, ensure};
use image::{DynamicImage, ImageFormat};
use tempfile::NamedTempFile;

use crate::escapes::shown;

/// Held while there are temporary files: from before the first is made until the last has become
/// what it is to be, or was removed.
static TEMPORARY_FILES: Mutex<()> = Mutex::new(());

/// Waits until no temporary file is left, and keeps others from being made as long as the result
/// lives. Who ends the process then leaves nothing behind.
pub fn without_temporary_files() -> MutexGuard<'static, ()> {
    TEMPORARY_FILES
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
}

/// Largest number of bytes of a calibration, which may have maps.
pub const TEXT_BYTES_MAX: u64 = 1 << 24;

/// Largest number of bytes of parameters, or of what a scene states in numbers: its reader takes up to
/// 700 bytes of memory for each.
pub const SETTINGS_BYTES_MAX: u64 = 1 << 20;

/// Returns the bytes of a file that has at most `bytes_max`.
///
/// # Errors
/// Fails with one line that names the file and the reason: it cannot be read, or it has more bytes. A
/// regular file that has more is not read.
pub fn read_file(path: &Path, bytes_max: u64) -> Result<Vec<u8>> {
    let name = shown(path);
    let cannot_read = || format!("cannot read {name}");
    let file = fs::File::open(path).with_context(cannot_read)?;
    let length = file.metadata().with_context(cannot_read)?.len();
    ensure_bounded(length, bytes_max).with_context(cannot_read)?;
    read_bounded(file, bytes_max).with_context(cannot_read)
}

/// Returns the bytes of a file of text, as [`read_file`] does, as text.
///
/// # Errors
/// Fails with one line that names the file and the reason: as [`read_file`] does with
/// [`SETTINGS_BYTES_MAX`], or it is no text in UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    let bytes = read_file(path, SETTINGS_BYTES_MAX)?;
    String::from_utf8(bytes)
        .map_err(|_| anyhow!("cannot read {}: it is no text in UTF-8", shown(path)))
}

/// Returns what a reader has, at most `bytes_max` bytes.
///
/// # Errors
/// Fails with one line that gives the reason: it cannot be read, or it has more bytes.
pub fn read_bounded(reader: impl Read, bytes_max: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    reader.take(bytes_max + 1).read_to_end(&mut bytes)?;
    ensure_bounded(bytes.len() as u64, bytes_max)?;
    Ok(bytes)
}

fn ensure_bounded(bytes: u64, bytes_max: u64) -> Result<()> {
    ensure!(bytes <= bytes_max, "it has more than {bytes_max} bytes");
    Ok(())
}

/// Writes each of these files whole or not at all: it writes temporary files beside them, and
/// renames these when all are written. Links are followed, and what is not a regular file, such
/// as a pipe or `/dev/null`, is written directly and first.
///
/// # Errors
/// Fails with one line that names the file and the reason, and when two of them are one file.
pub fn write_files<P: AsRef<Path>>(files: &[(P, Vec<u8>)]) -> Result<()> {
    let paths: Vec<&Path> = files.iter().map(|(path, _)| path.as_ref()).collect();
    ensure_distinct_outputs(&[], &paths)?;
    let cannot_write = |path: &Path| format!("cannot write {}", shown(path));
    let (direct, renamed): (Vec<_>, Vec<_>) = files
        .iter()
        .map(|(path, bytes)| (path.as_ref(), bytes))
        .partition(|(path, _)| is_special(path));
    for (path, bytes) in direct {
        let file = fs::OpenOptions::new().write(true).open(path);
        file.and_then(|mut file| file.write_all(bytes))
            .with_context(|| cannot_write(path))?;
    }
    let _guard = without_temporary_files();
    let mut written = Vec::new();
    for (path, bytes) in renamed {
        let target = destination(path);
        let file = write_beside(&target, bytes).with_context(|| cannot_write(path))?;
        written.push((file, target, path));
    }
    for (file, target, path) in written {
        file.persist(target)
            .map_err(|error| error.error)
            .with_context(|| cannot_write(path))?;
    }
    Ok(())
}

/// Writes a file as [`write_files`] does, bit by bit, as `fill` gives it: whole or not at all.
///
/// # Errors
/// Fails as `fill` does, or with one line that names the file and the reason.
pub fn write_gradually<T>(path: &Path, fill: impl FnOnce(&mut fs::File) -> Result<T>) -> Result<T> {
    let cannot_write = || format!("cannot write {}", shown(path));
    if is_special(path) {
        let file = fs::OpenOptions::new().write(true).open(path);
        return fill(&mut file.with_context(cannot_write)?);
    }
    let _guard = without_temporary_files();
    let target = destination(path);
    let mut file = write_beside(&target, &[]).with_context(cannot_write)?;
    let filled = fill(file.as_file_mut())?;
    let kept = file.persist(target).map_err(|error| error.error);
    kept.with_context(cannot_write)?;
    Ok(filled)
}

/// Returns the names and the contents of these files of text.
///
/// # Errors
/// Fails with one line that names the file and the reason, as [`read_file`] does.
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<(String, Vec<u8>)>> {
    let files = paths.iter().map(|path| {
        let bytes = read_file(path, TEXT_BYTES_MAX)?;
        Ok((shown(path), bytes))
    });
    files.collect()
}

/// Checks that a file's name ends in a dot and `ending`, in either case.
///
/// # Errors
/// Fails with one line that names the file and the ending.
pub fn ensure_ending(path: &Path, ending: &str) -> Result<()> {
    let found = path.extension();
    ensure!(
        found.is_some_and(|found| found.eq_ignore_ascii_case(ending)),
        "{}: the name must end in .{ending}",
        shown(path)
    );
    Ok(())
}

/// Checks that the files that a command writes are different ones, and none of those that it
/// reads, however their paths are spelt. Files that are not regular are left out: two outputs
/// may be `/dev/null`.
///
/// # Errors
/// Fails with one line that names the two paths.
pub fn ensure_distinct_outputs(inputs: &[&Path], outputs: &[&Path]) -> Result<()> {
    for (index, output) in outputs.iter().enumerate() {
        for other in &outputs[..index] {
            ensure!(
                !is_one_file(other, output),
                "the outputs {} and {} are one file",
                shown(other),
                shown(output)
            );
        }
        for input in inputs {
            ensure!(
                !is_one_file(input, output),
                "the output {} would replace the input {}",
                shown(output),
                shown(input)
            );
        }
    }
    Ok(())
}

/// Whether two paths, of which none, one or both exist, are those of one regular file.
fn is_one_file(a: &Path, b: &Path) -> bool {
    // The first finds hard links, the second what does not exist yet.
    !is_special(a)
        && (same_file::is_same_file(a, b).unwrap_or(false) || destination(a) == destination(b))
}

/// Whether a path leads to something that can be written but is no regular file.
fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|data| !data.is_file() && !data.is_dir())
}

/// The links that are followed from one name; systems give up at about as many.
const LINKS_MAX: usize = 40;

/// Returns the absolute path at which a file of this path is, or will be, once links are
/// followed. Links may lead to what does not exist.
fn destination(path: &Path) -> PathBuf {
    let mut path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    for _ in 0..LINKS_MAX {
        match (fs::read_link(&path), path.parent()) {
            (Ok(target), Some(folder)) => path = folder.join(target),
            _ => break,
        }
    }
    match (path.parent(), path.file_name()) {
        (Some(folder), Some(name)) => folder
            .canonicalize()
            .unwrap_or_else(|_| destination(folder))
            .join(name),
        _ => path,
    }
}

/// Writes the content of the file `path` to a temporary file in its folder.
fn write_beside(path: &Path, bytes: &[u8]) -> io::Result<NamedTempFile> {
    if path.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    let folder = path.parent().unwrap_or(path);
    if !folder.is_dir() {
        return Err(io::Error::other("its folder does not exist"));
    }
    let mut builder = tempfile::Builder::new();
    // What a killed process leaves behind can be recognised.
    builder.prefix(".vgstereo-");
    #[cfg(unix)]
    {
        // Temporary files are private; this one becomes a file of the user with usual rights.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    // The temporary path, which errors of `tempfile` name, says nothing to the user: the kind
    // alone of the first error, and the file without its wrapper for the second.
    let mut file = builder
        .tempfile_in(folder)
        .map_err(|error| io::Error::from(error.kind()))?;
    file.as_file_mut().write_all(bytes)?;
    Ok(file)
}

/// Returns the bytes of an image file in this format.
///
/// # Errors
/// Fails when the format cannot hold the image.
pub fn encode(image: &DynamicImage, format: ImageFormat) -> Result<Vec<u8>> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, format)?;
    Ok(bytes.into_inner())
}

/// Makes a folder, and those above it, if it does not exist.
///
/// # Errors
/// Fails with one line that names the folder and the reason.
pub fn make_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).with_context(|| format!("cannot make the folder {}", shown(path)))
}
