//! Matrices that `NumPy` stored: one in a `.npy` file, several with their names in a `.npz` archive.

use std::io::{Cursor, Read};

use anyhow::{Context, Result, bail, ensure};
use serde_json::{Map, Value};
use zip::ZipArchive;

/// Most numbers of a matrix. More would not be that of a camera.
const NUMBERS_MAX: u64 = 64;
/// Most bytes of a matrix of an archive. What inflates to more is no matrix of a camera.
const MATRIX_BYTES_MAX: u64 = 4096;
/// Most matrices of an archive.
const MATRICES_MAX: usize = 256;

/// Whether these are the first bytes of one matrix.
pub(super) fn is_matrix(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x93NUMPY")
}

/// Whether these are the first bytes of an archive: of its first file, or of its end if it is empty.
pub(super) fn is_archive(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06")
}

/// The matrices of an archive by their names. What is no matrix of a camera - too large, or not of
/// numbers - is null, as archives hold maps and corners as well.
///
/// # Errors
/// Fails with the reason when the archive is damaged, has too many files, or one in a form that `NumPy` does
/// not write.
pub(super) fn archive(bytes: &[u8]) -> Result<Map<String, Value>> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).context("the archive is damaged")?;
    ensure!(
        archive.len() <= MATRICES_MAX,
        "{} matrices in one archive",
        archive.len()
    );
    let mut matrices = Map::new();
    for index in 0..archive.len() {
        let file = archive
            .by_index(index)
            .context("the archive is damaged, or not one of NumPy")?;
        let Some(name) = file.name()?.strip_suffix(".npy").map(str::to_owned) else {
            continue;
        };
        let mut matrix_bytes = Vec::new();
        file.take(MATRIX_BYTES_MAX + 1)
            .read_to_end(&mut matrix_bytes)
            .with_context(|| format!("{name}.npy is damaged"))?;
        let is_small = matrix_bytes.len() as u64 <= MATRIX_BYTES_MAX;
        let value = if is_small {
            matrix(&matrix_bytes).ok()
        } else {
            None
        };
        matrices.insert(name, value.unwrap_or_default());
    }
    Ok(matrices)
}

/// The numbers of a matrix, row by row.
///
/// # Errors
/// Fails with the reason when it is damaged or not a small matrix of numbers.
pub(super) fn matrix(bytes: &[u8]) -> Result<Value> {
    // Version 1 states the length of its header in two bytes and the others in four. As much as that
    // is allocated before anything is read.
    let (header_bytes, rest) = match bytes.get(6..) {
        Some([1, _, a, b, rest @ ..]) => (u16::from_le_bytes([*a, *b]).into(), rest),
        Some([_, _, a, b, c, d, rest @ ..]) => (u32::from_le_bytes([*a, *b, *c, *d]), rest),
        _ => (u32::MAX, &[][..]),
    };
    let header = rest.get(..header_bytes as usize);
    let header = header.context("the header breaks off")?;
    // A dictionary with a tuple. The time that parsing takes doubles with each bracket that is not closed.
    let brackets = header.iter().filter(|byte| b"{[(".contains(byte)).count();
    ensure!(brackets <= 4, "the header is not that of a matrix");
    let file = npyz::NpyFile::new(bytes)?;
    // This bounds what is allocated for a false header.
    ensure!(
        file.len() <= NUMBERS_MAX,
        "{} numbers in one matrix",
        file.len()
    );
    let (order, shape) = (file.order(), file.shape().to_vec());
    let kind = file.dtype().descr();
    let numbers: Vec<f64> = match kind.trim_matches(['\'', '"']) {
        "<f8" => file.into_vec()?,
        "<f4" => file.into_vec::<f32>()?.into_iter().map(f64::from).collect(),
        "<i4" => file.into_vec::<i32>()?.into_iter().map(f64::from).collect(),
        "<i8" => file
            .into_vec::<i64>()?
            .into_iter()
            .map(|n| n as f64)
            .collect(),
        other => bail!("numbers of type {other}, not <f8"),
    };
    let numbers = match (order, shape.as_slice()) {
        (npyz::Order::C, _) | (_, [] | [_]) => numbers,
        (npyz::Order::Fortran, &[rows, columns]) => by_rows(&numbers, rows, columns)?,
        (npyz::Order::Fortran, _) => bail!("more than two dimensions, stored by columns"),
    };
    // Numbers that are not finite become null, which is refused where it is read.
    Ok(numbers.into_iter().map(Value::from).collect())
}

/// The numbers of a matrix that is stored by columns, row by row.
fn by_rows(by_columns: &[f64], rows: u64, columns: u64) -> Result<Vec<f64>> {
    let (rows, columns) = (usize::try_from(rows)?, usize::try_from(columns)?);
    let number = |row: usize, column: usize| by_columns.get(column * rows + row).copied();
    let numbers = (0..rows).flat_map(|row| (0..columns).map(move |column| number(row, column)));
    numbers.collect::<Option<_>>().context("it breaks off")
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use zip::write::{SimpleFileOptions, ZipWriter};

    use super::super::document::Document;
    use super::*;

    #[test]
    fn brackets_in_the_header_of_a_matrix_do_not_cost_time() {
        for bracket in ["{", "[", "(", "{[("] {
            let text = bracket.repeat(60);
            let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
            bytes.extend(u16::try_from(text.len()).unwrap().to_le_bytes());
            bytes.extend(text.as_bytes());
            let error = Document::parse("a.npy", &bytes).unwrap_err();
            assert!(format!("{error:#}").contains("header"), "{error:#}");
        }
    }

    #[test]
    fn matrices_of_numpy_are_read() {
        let header =
            b"\x93NUMPY\x01\0\x46\0{'descr': '<f8', 'fortran_order': False, 'shape': (1, 2), }";
        let mut bytes = header.to_vec();
        bytes.resize(79, b' ');
        bytes.push(b'\n');
        for number in [1.5_f64, -2.0] {
            bytes.extend(number.to_le_bytes());
        }
        let document = Document::parse("calib/rot_mat.npy", &bytes).unwrap();
        let read = document.root().require("rot_mat").unwrap().list().unwrap();
        assert_eq!(read, [1.5, -2.0]);
        let refused = |bytes: &[u8]| {
            let error = Document::parse("rot_mat.npy", bytes).unwrap_err();
            let error = format!("{error:#}");
            assert!(error.contains("rot_mat.npy"), "{error}");
            error
        };
        refused(&bytes[..90]);
        // A header of 4 GiB, of which nothing is there.
        for version in 2..=3 {
            bytes[6] = version;
            bytes[8..12].fill(0xff);
            assert!(refused(&bytes).contains("the header breaks off"));
        }
        assert!(refused(&bytes[..9]).contains("the header breaks off"));
    }

    /// A matrix as `NumPy` writes it.
    fn npy(kind: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let mut header =
            format!("{{'descr': '{kind}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
        while !(10 + header.len() + 1).is_multiple_of(64) {
            header.push(' ');
        }
        header.push('\n');
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
        [bytes, header.into_bytes(), data.to_vec()].concat()
    }

    fn f8(numbers: &[f64]) -> Vec<u8> {
        numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
    }

    fn npz(files: &[(&str, Vec<u8>)], method: zip::CompressionMethod) -> Vec<u8> {
        let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
        let options = SimpleFileOptions::default().compression_method(method);
        for (name, bytes) in files {
            writer.start_file(*name, options).unwrap();
            writer.write_all(bytes).unwrap();
        }
        writer.finish().unwrap().into_inner()
    }

    #[test]
    fn archives_have_their_matrices_by_name() {
        let sides: Vec<u8> = [640_i64, 480]
            .iter()
            .flat_map(|n| n.to_le_bytes())
            .collect();
        let files = [
            (
                "mtx.npy",
                npy("<f8", "False", "(2, 2)", &f8(&[1.0, 2.0, 3.0, 4.0])),
            ),
            // By columns, as transposed matrices are stored.
            (
                "R.npy",
                npy(
                    "<f8",
                    "True",
                    "(2, 3)",
                    &f8(&[1.0, 4.0, 2.0, 5.0, 3.0, 6.0]),
                ),
            ),
            ("size.npy", npy("<i8", "False", "(2,)", &sides)),
            // Of objects, as pictures' poses are, and too large, as maps are.
            ("rvecs.npy", npy("|O", "False", "(2,)", b"pickled")),
            (
                "map.npy",
                npy("<f8", "False", "(1000, 1)", &f8(&[0.5; 1000])),
            ),
            ("read.me", b"text".to_vec()),
        ];
        for method in [
            zip::CompressionMethod::Stored,
            zip::CompressionMethod::Deflated,
        ] {
            let bytes = npz(&files, method);
            let document = Document::parse("stereo.npz", &bytes).unwrap();
            let list = |key: &str| document.root().require(key).unwrap().list();
            assert_eq!(list("mtx").unwrap(), [1.0, 2.0, 3.0, 4.0]);
            assert_eq!(list("R").unwrap(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
            assert_eq!(list("size").unwrap(), [640.0, 480.0]);
            for key in ["rvecs", "map"] {
                let error = list(key).unwrap_err().to_string();
                assert!(
                    error.contains("stereo.npz") && error.contains(key),
                    "{error}"
                );
            }
            assert_eq!(document.root().entries().len(), 5);
        }
    }

    #[test]
    fn bombs_and_damaged_archives_cost_little_and_are_refused() {
        let deflated = zip::CompressionMethod::Deflated;
        let refused = |bytes: &[u8], words: &str| {
            let error = format!("{:#}", Document::parse("a.npz", bytes).unwrap_err());
            assert!(error.contains("a.npz") && error.contains(words), "{error}");
        };
        // Two numbers, and a thousand times as many bytes behind them as the archive has: not read.
        let long = npy("<f8", "False", "(2,)", &vec![0; 32_000_000]);
        let bomb = npz(&[("M1.npy", long)], deflated);
        assert!(bomb.len() < 64_000);
        let document = Document::parse("a.npz", &bomb).unwrap();
        assert!(document.root().require("M1").unwrap().list().is_err());
        let many: Vec<(String, Vec<u8>)> =
            (0..257).map(|n| (format!("{n}.npy"), Vec::new())).collect();
        let many: Vec<(&str, Vec<u8>)> = many
            .iter()
            .map(|(name, bytes)| (name.as_str(), bytes.clone()))
            .collect();
        refused(&npz(&many, deflated), "257");
        refused(&npz(&[], deflated), "no entries");
        let matrix = npy("<f8", "False", "(2,)", &f8(&[1.0, 2.0]));
        let mut bytes = npz(&[("M1.npy", matrix)], zip::CompressionMethod::Stored);
        refused(&bytes[..bytes.len() - 30], "damaged");
        // Another number than its checksum is of.
        let at = bytes
            .windows(8)
            .position(|w| w == 2.0_f64.to_le_bytes())
            .unwrap();
        bytes[at] ^= 1;
        refused(&bytes, "M1.npy is damaged");
    }
}
