//! Images: formats, depths, orientation, and what is refused.

use std::fs;
use std::io::Cursor;

use assert_cmd::Command;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::codecs::webp::WebPEncoder;
use image::{
    DynamicImage, ExtendedColorType, GrayImage, ImageBuffer, ImageEncoder, ImageFormat, Luma, Rgb,
    RgbImage, Rgba,
};
use vgstereo_sim::images::ImageFile;
use vgstereo_sim::pfm::Pfm;
use vgstereo_sim::render::{RenderOptions, render};

use crate::fixture::{Fixture, HEIGHT, WIDTH, texture};

/// Matches two files with a small preset and returns the map and what was said.
fn matched(fixture: &Fixture, left: &str, right: &str, more: &[&str]) -> (Vec<u8>, String) {
    let pair = [
        "match", left, right, "--out", "m.pfm", "--d-max", "12", "--preset", "micro",
    ];
    let outcome = fixture.run(&[&pair, more].concat());
    assert_eq!(outcome.code, Some(0), "{left} {right}: {}", outcome.stderr);
    (fs::read(fixture.path("m.pfm")).unwrap(), outcome.stdout)
}

/// Levels of 16 bits that are those of an image of 8 bits, moved up.
pub(crate) fn widened(image: &RgbImage, shift: u32) -> DynamicImage {
    let wide = |level: u8| u16::from(level) << shift;
    let image = ImageBuffer::from_fn(image.width(), image.height(), |x, y| {
        Rgb(image.get_pixel(x, y).0.map(wide))
    });
    DynamicImage::ImageRgb16(image)
}

#[test]
fn ten_twelve_and_sixteen_bits_give_the_same_map() {
    let fixture = Fixture::new();
    let (expected, said) = matched(&fixture, "left.png", "right.png", &[]);
    assert!(!said.contains("bits"), "{said}");
    for (shift, bits) in [(2, "10"), (4, "12"), (8, "16")] {
        for extension in ["png", "tiff"] {
            let [left, right] = ["left", "right"].map(|side| format!("{side}-{bits}.{extension}"));
            for (name, moved) in [(&left, 0), (&right, crate::fixture::SHIFT)] {
                widened(&texture(moved), shift)
                    .save(fixture.path(name))
                    .unwrap();
            }
            let (map, said) = matched(&fixture, &left, &right, &[]);
            assert!(map == expected, "{bits} bits in {extension}");
            let told = format!("use {bits} of them");
            assert_eq!(said.contains(&told), bits != "16", "{said}");
            // A view of 8 bits is as it is.
            assert!(matched(&fixture, "left.png", &right, &[]).0 == expected);
            // Too many bits make a dark image, and the user's word counts.
            let (_, said) = matched(&fixture, &left, &right, &["--bits", "14"]);
            assert!(said.contains("use 14 of them"), "{said}");
        }
    }
    for bits in ["7", "17", "x"] {
        let arguments = [
            "match",
            "left.png",
            "right.png",
            "--out",
            "o.png",
            "--bits",
            bits,
        ];
        fixture.refuses(&arguments, &["--bits", "8 to 16"]);
    }
}

#[test]
fn the_brighter_view_decides_for_both() {
    let fixture = Fixture::new();
    let dark = RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
        Rgb(texture(0).get_pixel(x, y).0.map(|level| level / 5))
    });
    widened(&dark, 4).save(fixture.path("dark.png")).unwrap();
    widened(&texture(5), 4)
        .save(fixture.path("right-12.png"))
        .unwrap();
    let (_, said) = matched(&fixture, "dark.png", "right-12.png", &[]);
    assert!(said.contains("use 12 of them"), "{said}");
}

#[test]
fn a_portable_map_states_its_largest_value() {
    let fixture = Fixture::new();
    let grey = |shift| DynamicImage::from(texture(shift)).into_luma8();
    for (name, shift) in [("l.png", 0), ("r.png", 5)] {
        grey(shift).save(fixture.path(name)).unwrap();
    }
    let (expected, _) = matched(&fixture, "l.png", "r.png", &[]);
    for largest in [1023_u32, 4095, 1000] {
        for (name, shift) in [("l.pgm", 0), ("r.pgm", 5)] {
            let mut bytes = format!("P5\n{WIDTH} {HEIGHT}\n{largest}\n").into_bytes();
            for level in grey(shift).as_raw() {
                // The nearest value, which is read back as the level.
                let value = (u32::from(*level) * largest + 127) / 255;
                bytes.extend((value as u16).to_be_bytes());
            }
            fs::write(fixture.path(name), bytes).unwrap();
        }
        let (map, said) = matched(&fixture, "l.pgm", "r.pgm", &[]);
        assert!(!said.contains("of them"), "{said}");
        let [found, values] =
            [&map, &expected].map(|bytes| Pfm::from_bytes(bytes, "m.pfm").unwrap().values);
        let different = found
            .iter()
            .zip(&values)
            .filter(|&(a, b)| (a - b).abs() > 1.0 / 16.0)
            .count();
        // Levels may round to the next.
        assert!(
            different * 50 < values.len(),
            "{largest}: {different} differ"
        );
    }
}

/// What a file states of its depth is its own: it bears on no other view, and `--bits` not on it. The
/// largest value 65535 states nothing.
#[test]
fn a_stated_depth_is_that_of_its_file_alone() {
    let fixture = Fixture::new();
    for (side, shift) in [("left", 0), ("right", crate::fixture::SHIFT)] {
        let grey = DynamicImage::from(texture(shift)).into_luma8();
        grey.save(fixture.path(&format!("{side}-8.png"))).unwrap();
        // 4 k of 1023, scaled to 16 bits, has the upper 8 bits k for every k below 256.
        let ten_bits = |level: &u8| u16::from(*level) << 2;
        let levels: Vec<u16> = grey.as_raw().iter().map(ten_bits).collect();
        for largest in [1023, 65_535] {
            let mut bytes = format!("P5\n{WIDTH} {HEIGHT}\n{largest}\n").into_bytes();
            bytes.extend(levels.iter().flat_map(|level| level.to_be_bytes()));
            fs::write(fixture.path(&format!("{side}-{largest}.pgm")), bytes).unwrap();
        }
        let wide = ImageBuffer::<Luma<u16>, _>::from_raw(WIDTH, HEIGHT, levels).unwrap();
        wide.save(fixture.path(&format!("{side}-10.png"))).unwrap();
    }
    let (expected, _) = matched(&fixture, "left-8.png", "right-8.png", &[]);
    for (left, right, more) in [
        ("left-1023.pgm", "right-1023.pgm", &["--bits", "10"][..]),
        ("left-10.png", "right-1023.pgm", &[]),
        ("left-1023.pgm", "right-10.png", &["--bits", "10"]),
        ("left-65535.pgm", "right-65535.pgm", &[]),
        ("left-65535.pgm", "right-10.png", &[]),
    ] {
        let (map, said) = matched(&fixture, left, right, more);
        assert!(map == expected, "{left} {right}");
        let all_stated = left.contains("1023") && right.contains("1023");
        assert_eq!(said.contains("use 10 of them"), !all_stated, "{said}");
    }
}

/// An EXIF block that states an orientation, 1 to 8.
pub(crate) fn exif(orientation: u16) -> Vec<u8> {
    let mut block = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    block.extend(orientation.to_le_bytes());
    block.extend([0; 6]);
    block
}

/// An uncompressed TIFF that states an orientation.
fn turned_tiff(image: &RgbImage, orientation: u16) -> Vec<u8> {
    let (width, height) = image.dimensions();
    let pixels = image.as_raw().len() as u32;
    // Tag, type (3: 16 bits, 4: 32 bits), count, value; the pixels follow the header of 8 bytes, and
    // the three depths follow the pixels.
    let entries: [(u16, u16, u32, u32); 10] = [
        (256, 4, 1, width),
        (257, 4, 1, height),
        (258, 3, 3, 8 + pixels),
        (259, 3, 1, 1),
        (262, 3, 1, 2),
        (273, 4, 1, 8),
        (274, 3, 1, orientation.into()),
        (277, 3, 1, 3),
        (278, 4, 1, height),
        (279, 4, 1, pixels),
    ];
    let mut bytes = b"II*\0".to_vec();
    bytes.extend((8 + pixels + 6).to_le_bytes());
    bytes.extend(image.as_raw());
    bytes.extend([8, 0, 8, 0, 8, 0]);
    bytes.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in entries {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([0; 4]);
    bytes
}

#[test]
fn images_are_turned_upright() {
    // Where the pixel at the top left of the upright image is stored, for each orientation.
    let upright = RgbImage::from_fn(24, 16, |x, y| Rgb([x as u8 * 10, y as u8 * 15, 77]));
    let stored = |orientation: u16| -> RgbImage {
        let (width, height) = upright.dimensions();
        let (w, h) = if orientation >= 5 {
            (height, width)
        } else {
            (width, height)
        };
        RgbImage::from_fn(w, h, |x, y| {
            // EXIF 2.3, tag 0x0112: what row 0 and column 0 of the stored image show.
            let (x, y) = match orientation {
                1 => (x, y),
                2 => (width - 1 - x, y),
                3 => (width - 1 - x, height - 1 - y),
                4 => (x, height - 1 - y),
                5 => (y, x),
                6 => (width - 1 - y, x),
                7 => (width - 1 - y, height - 1 - x),
                _ => (y, height - 1 - x),
            };
            *upright.get_pixel(x, y)
        })
    };
    for orientation in 1..=8 {
        let image = stored(orientation);
        let (width, height) = image.dimensions();
        let mut png = Vec::new();
        let mut encoder = PngEncoder::new(&mut png);
        encoder.set_exif_metadata(exif(orientation)).unwrap();
        encoder
            .write_image(image.as_raw(), width, height, ExtendedColorType::Rgb8)
            .unwrap();
        let file = ImageFile::from_bytes(png, "a.png").unwrap();
        assert_eq!(file.dimensions(), upright.dimensions());
        assert_eq!(
            file.decode().unwrap().into_rgb8(),
            upright,
            "PNG {orientation}"
        );

        let mut webp = Vec::new();
        let mut encoder = WebPEncoder::new_lossless(&mut webp);
        encoder.set_exif_metadata(exif(orientation)).unwrap();
        encoder
            .write_image(image.as_raw(), width, height, ExtendedColorType::Rgb8)
            .unwrap();
        for (name, bytes) in [
            ("a.webp", webp),
            ("a.tiff", turned_tiff(&image, orientation)),
        ] {
            let file = ImageFile::from_bytes(bytes, name).unwrap();
            assert_eq!(file.dimensions(), upright.dimensions());
            let decoded = file.decode().unwrap().into_rgb8();
            assert_eq!(decoded, upright, "{name} {orientation}");
        }

        let mut jpeg = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, 100);
        encoder.set_exif_metadata(exif(orientation)).unwrap();
        encoder.encode_image(&image).unwrap();
        let file = ImageFile::from_bytes(jpeg, "a.jpg").unwrap();
        assert_eq!(file.dimensions(), upright.dimensions());
        let decoded = file.decode().unwrap().into_rgb8();
        let most = decoded.as_raw().iter().zip(upright.as_raw());
        let most = most.map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(most < 24, "JPEG {orientation}: {most}");
    }
}

#[test]
fn a_view_without_colour_makes_both_grey() {
    let fixture = Fixture::new();
    let grey = DynamicImage::from(texture(0)).into_luma8();
    grey.save(fixture.path("grey.png")).unwrap();
    // Not that of colours, of which one view has none.
    for (left, right) in [("grey.png", "right.png"), ("right.png", "grey.png")] {
        let (expected, _) = matched(&fixture, left, right, &["--grey"]);
        assert!(matched(&fixture, left, right, &[]).0 == expected, "{left}");
    }
    let (grey, _) = matched(&fixture, "left.png", "right.png", &["--grey"]);
    let (coloured, _) = matched(&fixture, "left.png", "right.png", &[]);
    assert!(grey != coloured, "colour counts where both have it");
}

#[test]
fn every_format_and_kind_of_pixel_is_read() {
    let fixture = Fixture::new();
    let (expected, _) = matched(&fixture, "left.png", "right.png", &[]);
    let rgb = DynamicImage::from(texture(0));
    let kinds = [
        ("a.ppm", rgb.clone()),
        ("a.bmp", rgb.clone()),
        ("a.tiff", rgb.clone()),
        ("a.webp", rgb.clone()),
        ("alpha.png", rgb.to_rgba8().into()),
        ("alpha16.png", rgb.to_rgba16().into()),
    ];
    for (name, image) in kinds {
        image.save(fixture.path(name)).unwrap();
        assert!(
            matched(&fixture, name, "right.png", &[]).0 == expected,
            "{name}"
        );
    }
    // A palette, as a name does not tell.
    let mut indexed = Vec::new();
    let mut encoder = png::Encoder::new(&mut indexed, WIDTH, HEIGHT);
    encoder.set_color(png::ColorType::Indexed);
    let palette: Vec<u8> = (0..=255).flat_map(|i: u8| [i, i, i]).collect();
    encoder.set_palette(palette);
    let mut writer = encoder.write_header().unwrap();
    let grey = DynamicImage::from(texture(0)).into_luma8();
    writer.write_image_data(grey.as_raw()).unwrap();
    writer.finish().unwrap();
    fs::write(fixture.path("indexed.png"), indexed).unwrap();
    grey.save(fixture.path("grey.png")).unwrap();
    let (expected, _) = matched(&fixture, "grey.png", "right.png", &[]);
    assert!(matched(&fixture, "indexed.png", "right.png", &[]).0 == expected);
    let transparent = ImageBuffer::from_fn(WIDTH, HEIGHT, |x, y| {
        image::LumaA([grey.get_pixel(x, y).0[0], (x % 3) as u8])
    });
    transparent.save(fixture.path("la.png")).unwrap();
    assert!(matched(&fixture, "la.png", "right.png", &[]).0 == expected);
    let float = DynamicImage::from(texture(0)).into_rgb32f();
    float.save(fixture.path("float.tiff")).unwrap();
    let arguments = ["match", "float.tiff", "right.png", "--out", "o.png"];
    fixture.refuses(&arguments, &["float.tiff", "floating-point"]);
}

#[test]
fn a_view_comes_from_standard_input() {
    let fixture = Fixture::new();
    let (expected, _) = matched(&fixture, "left.png", "right.png", &[]);
    let mut command = Command::cargo_bin("vgstereo").unwrap();
    command.current_dir(fixture.folder.path());
    command.args([
        "match",
        "-",
        "right.png",
        "--out",
        "i.pfm",
        "--d-max",
        "12",
        "--preset",
        "micro",
    ]);
    command.write_stdin(fs::read(fixture.path("left.png")).unwrap());
    assert!(command.output().unwrap().status.success());
    assert!(fs::read(fixture.path("i.pfm")).unwrap() == expected);
    fixture.refuses(&["match", "-", "-", "--out", "o.png"], &["standard input"]);
}

/// A gradient of 16x16 px as a lossy WebP, which no crate at hand writes: made with libwebp's encoder.
const LOSSY_WEBP: &[u8] = b"RIFF6\x00\x00\x00WEBPVP8 *\x00\x00\x00P\x01\x00\x9d\x01*\x10\x00\x10\x00\x0f\xc0\xfe%\xb0\x00\x04t\x00\x00\xfeJ\x9b\xf7\x08\xa7\x02\xb1\xe2\x08C\xdc\xffsGnF\xda.\x04\x00\x00";

#[test]
fn what_breaks_off_is_never_taken_for_whole() {
    let scene = render(&RenderOptions {
        width: 24,
        height: 18,
        d_max: 8,
        ..RenderOptions::default()
    });
    let image = DynamicImage::from(scene.left);
    let formats = [
        ImageFormat::Png,
        ImageFormat::Jpeg,
        ImageFormat::Pnm,
        ImageFormat::Bmp,
        ImageFormat::Tiff,
        ImageFormat::WebP,
    ];
    let mut files = Vec::new();
    for format in formats {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        files.push((format!("{format:?}"), bytes.into_inner()));
    }
    files.push(("lossy WebP".to_owned(), LOSSY_WEBP.to_vec()));
    files.push((
        "plain map".to_owned(),
        b"P2\n3 2\n255\n1 20 130\n4 50 160\n".to_vec(),
    ));
    for (format, bytes) in files {
        let read = |bytes: &[u8]| {
            let file = ImageFile::from_bytes(bytes.to_vec(), "cut").ok()?;
            file.decode().ok()
        };
        let whole = read(&bytes).unwrap();
        for length in 0..bytes.len() {
            if let Some(cut) = read(&bytes[..length]) {
                // Only bytes without pixels are missing.
                assert_eq!(cut, whole, "{format}: {length} of {} bytes", bytes.len());
            }
        }
    }
}

#[test]
fn an_image_too_large_is_refused_by_its_header() {
    let fixture = Fixture::new();
    for (name, header) in [
        ("wide.pgm", "P5\n70000 2\n255\n"),
        ("large.pgm", "P5\n16384 8192\n255\n"),
        ("none.pgm", "P5\n4294967295 4294967295\n255\n"),
    ] {
        fs::write(fixture.path(name), header).unwrap();
        fixture.refuses(&["match", name, name, "--out", "o.png"], &[name]);
    }
    // 121 million pixels in 15 KB; then one small enough, which is refused for an option.
    let bomb = |side: u32| {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, side, side);
        encoder.set_depth(png::BitDepth::One);
        let mut writer = encoder.write_header().unwrap();
        writer
            .write_image_data(&vec![0; (side.div_ceil(8) * side) as usize])
            .unwrap();
        writer.finish().unwrap();
        bytes
    };
    fs::write(fixture.path("bomb.png"), bomb(11_000)).unwrap();
    fixture.refuses(
        &["match", "bomb.png", "bomb.png", "--out", "o.png"],
        &["too large", "67108864"],
    );
    fs::write(fixture.path("big.png"), bomb(8000)).unwrap();
    let arguments = [
        "match", "big.png", "big.png", "--out", "o.png", "--d-max", "8000",
    ];
    fixture.refuses(&arguments, &["--d-max 8000"]);
    let grey: GrayImage = GrayImage::from_pixel(4, 4, Luma([3]));
    grey.save(fixture.path("small.png")).unwrap();
    let rgba = image::RgbaImage::from_pixel(4, 5, Rgba([1, 2, 3, 4]));
    rgba.save(fixture.path("other.png")).unwrap();
    let arguments = ["match", "small.png", "other.png", "--out", "o.png"];
    fixture.refuses(&arguments, &["small.png is 4x4", "other.png is 4x5"]);
}
