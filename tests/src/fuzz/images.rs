//! The reader of images.

use image::DynamicImage;
use vgstereo_sim::images::{Arrangement, ImageFile, PIXELS_MAX, SIDE_MAX_PX, ViewImages};

use super::{NAME, accepted, within_memory};

/// Larger images are not decoded here, because they take long; their headers are looked at.
const DECODED_MAX_PX: u64 = 1 << 20;

/// Reads an image and a pair of it. The first byte gives the number of used bits, 8 to 16, or none; the
/// others are the file.
pub fn run(bytes: &[u8]) {
    let Some((&bits, file)) = bytes.split_first() else {
        return;
    };
    let bits = (8..=16).contains(&bits).then_some(bits);
    // What decoders take for themselves, and what a file has besides its pixels. That of TIFF believes the
    // numbers of values that a file states, up to its own bounds of 256 MiB and 128 MiB.
    let is_tiff = file.starts_with(b"II") || file.starts_with(b"MM");
    let decoder_bytes = if is_tiff { 384 << 20 } else { 4 << 20 };
    let overhead = decoder_bytes + 32 * file.len() as u64;
    let opened = within_memory(overhead, || ImageFile::from_bytes(file.to_vec(), NAME));
    let Some(opened) = accepted(opened, NAME) else {
        return;
    };
    let (width, height) = opened.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    assert!(width.min(height) > 0 && width.max(height) <= SIDE_MAX_PX && pixels <= PIXELS_MAX);
    if pixels > DECODED_MAX_PX {
        return;
    }
    // Four channels of 32 bits, read, and as they are turned or converted.
    let bytes_max = overhead + 2 * 16 * pixels;
    let image = within_memory(bytes_max, || opened.decode());
    let Some(image) = accepted(image, NAME) else {
        return;
    };
    assert_eq!((image.width(), image.height()), (width, height));
    let pair = within_memory(2 * bytes_max, || ViewImages::decode(&opened, &opened, bits));
    let Some(pair) = accepted(pair, NAME) else {
        return;
    };
    assert_eq!(pair.left.dimensions(), (width, height));
    assert!(pair.left == pair.right);
    check_levels(&image, &pair, bits);
    check_halves(&opened, &pair, bits);
}

/// Checks that a picture of both views is halved where its side is even, and refused elsewhere.
fn check_halves(opened: &ImageFile, pair: &ViewImages, bits: Option<u8>) {
    let (width, height) = opened.dimensions();
    for (arrangement, [columns, lines], [x, y]) in [
        (Arrangement::SideBySide, [2, 1], [width / 2, 0]),
        (Arrangement::TopBottom, [1, 2], [0, height / 2]),
    ] {
        let halves = ViewImages::decode_joined(opened, arrangement, bits);
        let Some(halves) = accepted(halves, NAME) else {
            assert!(width % columns + height % lines > 0);
            continue;
        };
        assert_eq!(halves.bits, pair.bits);
        for (half, [x, y]) in [(&halves.left, [0, 0]), (&halves.right, [x, y])] {
            assert_eq!(half.dimensions(), (width / columns, height / lines));
            let mut pixels = half.enumerate_pixels();
            assert!(pixels.all(|(u, v, pixel)| pixel == pair.left.get_pixel(x + u, y + v)));
        }
    }
}

/// Checks the levels of a view against those of its file.
fn check_levels(image: &DynamicImage, pair: &ViewImages, bits: Option<u8>) {
    let is_wide = matches!(
        image,
        DynamicImage::ImageLuma16(_)
            | DynamicImage::ImageLumaA16(_)
            | DynamicImage::ImageRgb16(_)
            | DynamicImage::ImageRgba16(_)
    );
    if !is_wide {
        assert_eq!(pair.bits, None);
        assert!(pair.left == image.to_rgb8());
        return;
    }
    let stored = image.to_rgb16();
    let used = pair.bits.unwrap_or(16);
    let largest = stored.as_raw().iter().copied().max().unwrap_or(0);
    match bits {
        Some(bits) => assert!(used == bits || used == 16),
        None => assert!(u32::from(largest) < 1 << used),
    }
    for (&level, &stored) in pair.left.as_raw().iter().zip(stored.as_raw()) {
        // The part of full scale that a level is, cut off at full scale.
        let expected = u32::from(stored) * 256 / (1 << used);
        assert_eq!(
            u32::from(level),
            expected.min(255),
            "{stored} of {used} bits"
        );
    }
}
