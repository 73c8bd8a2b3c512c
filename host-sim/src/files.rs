//! Writing of files. Errors name the file, and no file is left half written.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use anyhow::{Context, Result};
use image::{DynamicImage, ImageFormat};
use tempfile::NamedTempFile;

/// Writes each of these files whole or not at all: it writes temporary files beside them, and
/// renames these when all are written.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub fn write_files(files: &[(&Path, Vec<u8>)]) -> Result<()> {
    let mut written = Vec::new();
    for (path, bytes) in files {
        let file = write_beside(path, bytes);
        written.push(file.with_context(|| format!("cannot write {}", path.display()))?);
    }
    for (file, (path, _)) in written.into_iter().zip(files) {
        file.persist(path)
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Writes the content of the file `path` to a temporary file in its folder.
fn write_beside(path: &Path, bytes: &[u8]) -> io::Result<NamedTempFile> {
    if path.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        // Temporary files are private; this one becomes a file of the user with usual rights.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder)?;
    file.write_all(bytes)?;
    Ok(file)
}

/// Writes an image as PNG.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub fn write_png(path: &Path, image: &DynamicImage) -> Result<()> {
    write_files(&[(path, encode(image, ImageFormat::Png)?)])
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
    fs::create_dir_all(path).with_context(|| format!("cannot make the folder {}", path.display()))
}
