//! Reading of images: PNG, JPEG, TIFF, WebP, BMP and the portable maps PGM, PPM and PBM.
//!
//! Images are turned upright as their orientation tag says. A header is looked at before
//! anything is decoded, and an image that is larger than is stated here, or that breaks off, is
//! refused.

use std::fs::File;
use std::io::{Cursor, Read};
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use image::codecs::pnm::PnmDecoder;
use image::imageops::crop_imm;
use image::metadata::Orientation;
use image::{
    ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, Rgb, RgbImage,
};

use crate::escapes::shown;
use crate::files::read_bounded;

/// Largest number of pixels along a side of an image.
pub const SIDE_MAX_PX: u32 = 65_535;
/// Largest number of pixels of an image.
pub const PIXELS_MAX: u64 = 1 << 26;
/// Largest number of bytes of an image file: an uncompressed image of [`PIXELS_MAX`] pixels, with
/// room to spare.
pub(crate) const FILE_BYTES_MAX: u64 = 1 << 30;
/// Number of bytes at the beginning of an image file that tell its format.
const HEAD_BYTES: u64 = 64;

/// An image file whose header was read.
#[derive(Debug)]
pub struct ImageFile {
    name: String,
    bytes: Vec<u8>,
    format: ImageFormat,
    width: u32,
    height: u32,
}

impl ImageFile {
    /// Reads a file into memory and looks at its header. The format is recognised from the content,
    /// not from the name. `-` is standard input.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason.
    pub fn open(path: &Path) -> Result<Self> {
        let name = shown(path);
        let bytes = if path == Path::new("-") {
            read_image(std::io::stdin().lock())
        } else {
            File::open(path).map_err(Into::into).and_then(read_image)
        };
        Self::from_bytes(bytes.with_context(|| format!("cannot read {name}"))?, &name)
    }

    /// Looks at the header of an image file in memory; `name` is for messages.
    ///
    /// # Errors
    /// Fails with one line that gives name and reason: the format is none of those that are read,
    /// the header is damaged, or the image is empty or too large.
    pub fn from_bytes(bytes: Vec<u8>, name: &str) -> Result<Self> {
        let refused = |reason: String| anyhow!("cannot read {name}: {reason}");
        let format = format_of(&bytes).with_context(|| format!("cannot read {name}"))?;
        let mut file = Self {
            name: name.to_owned(),
            bytes,
            format,
            width: 0,
            height: 0,
        };
        let mut decoder = file.decoder()?;
        let (mut width, mut height) = decoder.dimensions();
        let turned = matches!(
            decoder.orientation(),
            Ok(Orientation::Rotate90
                | Orientation::Rotate270
                | Orientation::Rotate90FlipH
                | Orientation::Rotate270FlipH)
        );
        drop(decoder);
        if turned {
            (width, height) = (height, width);
        }
        (file.width, file.height) = (width, height);
        ensure!(
            width > 0 && height > 0,
            refused("the image is empty".to_owned())
        );
        ensure_bounded(width, height).with_context(|| format!("cannot read {name}"))?;
        Ok(file)
    }

    /// Width and height of the upright image, px.
    #[must_use]
    pub fn dimensions(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Decodes the image and turns it upright.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason: it is damaged or breaks off.
    pub fn decode(&self) -> Result<DynamicImage> {
        ensure!(
            has_end(self.format, &self.bytes),
            "cannot read {}: the file breaks off before its end",
            self.name
        );
        let mut decoder = self.decoder()?;
        let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
        let mut image = DynamicImage::from_decoder(decoder).map_err(|e| self.refused(&e))?;
        image.apply_orientation(orientation);
        Ok(image)
    }

    /// Whether the file states which of 16 bits are used, as a portable map does by its largest value:
    /// its levels are scaled to the full range when they are read. The value 65535 states nothing, as it
    /// is written for whatever a camera gave.
    fn states_depth(&self) -> bool {
        self.format == ImageFormat::Pnm
            && PnmDecoder::new(Cursor::new(&self.bytes))
                .is_ok_and(|decoder| decoder.header().maximal_sample() < u16::MAX.into())
    }

    fn decoder(&self) -> Result<impl ImageDecoder + '_> {
        let mut reader = ImageReader::with_format(Cursor::new(&self.bytes), self.format);
        let mut limits = Limits::default();
        limits.max_image_width = Some(SIDE_MAX_PX);
        limits.max_image_height = Some(SIDE_MAX_PX);
        // Four channels of 16 bits.
        limits.max_alloc = Some(8 * PIXELS_MAX);
        reader.limits(limits);
        reader.into_decoder().map_err(|error| self.refused(&error))
    }

    fn refused(&self, error: &dyn std::fmt::Display) -> anyhow::Error {
        anyhow!("cannot read {}: {error}", self.name)
    }
}

/// Whether a file begins as an image of a format that is read.
#[must_use]
pub fn is_image(path: &Path) -> bool {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD_BYTES).read_to_end(&mut head));
    read.is_ok() && format_of(&head).is_ok()
}

/// Returns the bytes of an image file. What does not begin as one is not read on, as it may have no end.
fn read_image(mut reader: impl Read) -> Result<Vec<u8>> {
    let mut head = Vec::new();
    reader.by_ref().take(HEAD_BYTES).read_to_end(&mut head)?;
    format_of(&head)?;
    read_bounded(head.chain(reader), FILE_BYTES_MAX)
}

/// The format of an image file, by its first [`HEAD_BYTES`].
fn format_of(bytes: &[u8]) -> Result<ImageFormat> {
    let guessed = ImageReader::new(Cursor::new(bytes)).with_guessed_format();
    let format = guessed.ok().and_then(|reader| reader.format());
    format.context("neither PNG, JPEG, TIFF, WebP, BMP nor a portable map")
}

/// Checks that an image has no more pixels than are read.
///
/// # Errors
/// Fails with one line that states its size and the largest.
pub(crate) fn ensure_bounded(width: u32, height: u32) -> Result<()> {
    ensure!(
        width.max(height) <= SIDE_MAX_PX && u64::from(width) * u64::from(height) <= PIXELS_MAX,
        "{width}x{height} px is too large: at most {SIDE_MAX_PX} px a side and {PIXELS_MAX} px in all are read"
    );
    Ok(())
}

/// Whether a file goes on to its end, for the formats whose decoders make up what is missing; those of
/// the others tell.
fn has_end(format: ImageFormat, bytes: &[u8]) -> bool {
    match format {
        ImageFormat::Jpeg => jpeg_has_end(bytes),
        // The RIFF header states how many bytes follow its first 8.
        ImageFormat::WebP => bytes
            .get(4..)
            .and_then(<[u8]>::split_first_chunk)
            .is_some_and(|(size, rest)| rest.len() as u64 >= u64::from(u32::from_le_bytes(*size))),
        // White space follows each number of a plain map; without it, digits may be missing.
        ImageFormat::Pnm if bytes.starts_with(b"P2") || bytes.starts_with(b"P3") => {
            !bytes.last().is_some_and(u8::is_ascii_digit)
        }
        _ => true,
    }
}

/// Whether the segments of a JPEG go on to the marker of its end. Decoders take one that breaks off
/// for a whole image whose lower part is grey.
fn jpeg_has_end(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    loop {
        // Within a scan, 0xff is followed by 0 or by a restart marker; any number of 0xff may come
        // before a marker.
        let Some(at) = rest.iter().position(|&byte| byte == 0xff) else {
            return false;
        };
        let Some((&marker, after)) = rest.get(at + 1..).and_then(|rest| rest.split_first()) else {
            return false;
        };
        rest = match marker {
            0xd9 => return true,
            0xff => &rest[at + 1..],
            // No segment follows: a stuffed byte, a restart, the start of the image.
            0x00 | 0x01 | 0xd0..=0xd8 => after,
            _ => match after.first_chunk() {
                Some(length) => after
                    .get(u16::from_be_bytes(*length).into()..)
                    .unwrap_or(&[]),
                None => return false,
            },
        };
    }
}

/// How one picture holds two views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrangement {
    /// The left view is the left half, the right view the right half.
    SideBySide,
    /// The left view is the top half, the right view the bottom half.
    TopBottom,
}

impl Arrangement {
    /// Returns width and height of each of the views in a picture, px.
    ///
    /// # Errors
    /// Fails with one line that names the file when its side has no half.
    pub fn view_dimensions(self, both: &ImageFile) -> Result<(u32, u32)> {
        let ImageFile { width, height, .. } = *both;
        let (size, rest, needed) = match self {
            Self::SideBySide => (
                (width / 2, height),
                width % 2,
                "side by side have an even width",
            ),
            Self::TopBottom => (
                (width, height / 2),
                height % 2,
                "one above the other have an even height",
            ),
        };
        ensure!(
            rest == 0,
            "cannot read {}: it is {width}x{height} px, and two views {needed}",
            both.name
        );
        Ok(size)
    }
}

/// Two views as 8 bits of red, green and blue.
#[derive(Debug)]
pub struct ViewImages {
    /// The left view.
    pub left: RgbImage,
    /// The right view, of the same size.
    pub right: RgbImage,
    /// How many bits of their 16 the levels use, if they do not use all.
    pub bits: Option<u8>,
}

impl ViewImages {
    /// Decodes a pair of views. Of levels with 16 bits the upper 8 of those are kept that the pair
    /// uses: `bits` of them, 8 to 16, or else the fewest that hold the largest level of both views,
    /// as cameras of 10 or 12 bits store theirs in files of 16. A view of 8 bits is taken as it is, and
    /// so is one whose file states its largest level, below 65535. Alpha is ignored.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason: one cannot be decoded, they differ in
    /// size, or their levels are floating-point numbers.
    pub fn decode(left: &ImageFile, right: &ImageFile, bits: Option<u8>) -> Result<Self> {
        ensure!(
            left.dimensions() == right.dimensions(),
            "{} is {}x{}, but {} is {}x{}: a rectified pair has one size",
            left.name,
            left.width,
            left.height,
            right.name,
            right.width,
            right.height
        );
        let ([left, right], bits) = with_used_bits([left, right], bits)?;
        Ok(Self { left, right, bits })
    }

    /// Decodes a picture that holds both views, upright. Its levels are taken as
    /// [`ViewImages::decode`] takes those of two files.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason, as [`Arrangement::view_dimensions`]
    /// and [`ViewImages::decode`] do.
    pub fn decode_joined(
        both: &ImageFile,
        arrangement: Arrangement,
        bits: Option<u8>,
    ) -> Result<Self> {
        let (width, height) = arrangement.view_dimensions(both)?;
        let ([both], bits) = with_used_bits([both], bits)?;
        let (x, y) = match arrangement {
            Arrangement::SideBySide => (width, 0),
            Arrangement::TopBottom => (0, height),
        };
        let half = |x, y| crop_imm(&both, x, y, width, height).to_image();
        Ok(Self {
            left: half(0, 0),
            right: half(x, y),
            bits,
        })
    }
}

/// Decodes images together. Of levels with 16 bits the upper 8 of those that they use are kept;
/// returns how many these are, where they are not all.
fn with_used_bits<const N: usize>(
    files: [&ImageFile; N],
    bits: Option<u8>,
) -> Result<([RgbImage; N], Option<u8>)> {
    let mut images = Vec::new();
    let mut largest = None;
    for file in files {
        let image = file.decode()?;
        let states_depth = file.states_depth();
        match image.color() {
            ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
                if !states_depth {
                    largest = largest.max(Some(largest_level(&image)));
                }
            }
            ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => {}
            _ => bail!(
                "cannot read {}: its levels are floating-point numbers; give it 8 or 16 bits",
                file.name
            ),
        }
        images.push((image, states_depth));
    }
    let used = largest.map(|largest| match bits {
        Some(bits) => bits.clamp(8, 16),
        None => (16 - largest.leading_zeros() as u8).max(8),
    });
    let mut images = images.into_iter().map(|(image, states_depth)| {
        with_upper_bits(image, used.filter(|_| !states_depth).unwrap_or(16))
    });
    // There are as many images as files.
    let images = std::array::from_fn(|_| images.next().unwrap_or_default());
    Ok((images, used.filter(|&bits| bits < 16)))
}

/// Returns the number of used bits that a text states.
///
/// # Errors
/// Fails with one line that states the range.
pub fn parse_bits(text: &str) -> Result<u8, String> {
    let bits = text.parse().ok().filter(|bits| (8..=16).contains(bits));
    bits.ok_or_else(|| "it must be from 8 to 16".to_owned())
}

/// Returns a line that tells that images of 16 bits were read as if they had `bits`.
#[must_use]
pub fn bits_note(bits: u8) -> String {
    format!("the images of 16 bits use {bits} of them: --bits N takes another number")
}

/// The largest level of an image of 16 bits, in any channel but alpha.
fn largest_level(image: &DynamicImage) -> u16 {
    let largest = |levels: &[u16]| levels.iter().copied().max().unwrap_or(0);
    match image {
        DynamicImage::ImageLuma16(image) => largest(image.as_raw()),
        DynamicImage::ImageRgb16(image) => largest(image.as_raw()),
        image => largest(image.to_rgb16().as_raw()),
    }
}

/// Returns the upper 8 of the lower `bits` bits of each level of an image of 16 bits; an image of 8
/// bits as it is.
fn with_upper_bits(image: DynamicImage, bits: u8) -> RgbImage {
    let narrow = |level: u16| u8::try_from(level >> (bits - 8)).unwrap_or(u8::MAX);
    match image.color() {
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
            let wide = image.into_rgb16();
            let mut levels = RgbImage::new(wide.width(), wide.height());
            for (pixel, wide) in levels.pixels_mut().zip(wide.pixels()) {
                *pixel = Rgb(wide.0.map(narrow));
            }
            levels
        }
        _ => image.into_rgb8(),
    }
}
