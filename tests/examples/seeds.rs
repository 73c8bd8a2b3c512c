//! Makes the binary seeds of the fuzz targets in `tests/fuzz/corpus`; those of text are written by hand.
//!
//!     cargo run -p vgstereo-tests --example seeds

use std::fs;
use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, Result};
use arbitrary::{Arbitrary, Unstructured};
use image::{DynamicImage, ImageFormat, Rgb, RgbImage};
use png::{BitDepth, ColorType};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use vgstereo_core::{Method, Output, Reference};
use vgstereo_firmware::scripted::FaultKind;
use vgstereo_link::{BoardMessage, Encoder, HostMessage, Line, Reason, Values};
use vgstereo_sim::calibration::{Options, rectify};
use vgstereo_sim::files::encode;
use vgstereo_sim::link::recording::Recorder;
use vgstereo_sim::pfm::Pfm;
use vgstereo_tests::fuzz::{matcher, session};

fn main() -> Result<()> {
    let corpora = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let seeds = [
        ("images", images()?),
        ("truth_and_masks", truth_and_masks()?),
        ("session", sessions()?),
        ("matcher", matchers()?),
        ("link_decoder", link_decoders()?),
        ("link_lines", link_lines()),
        ("rectification", rectifications(&corpora)?),
        ("recording", recordings()?),
    ];
    for (target, seeds) in seeds {
        for (name, bytes) in seeds {
            let path = corpora.join(target).join(name);
            fs::write(&path, bytes).with_context(|| path.display().to_string())?;
        }
    }
    Ok(())
}

/// Recordings that are whole and cut, and bytes that are none, each after a length of pieces and a cut.
fn recordings() -> Result<Seeds> {
    let mut recorder = Recorder::new(Cursor::new(Vec::new()))?;
    for (at, bytes) in [&b"\0abc"[..], b"", &[7; 40]].into_iter().enumerate() {
        recorder.push(1_000 * at as u64, bytes)?;
    }
    let whole = recorder.finish()?.into_inner();
    let cut = whole[..whole.len() / 2].to_vec();
    let files = [
        ("whole", 9, 0, whole),
        ("cut", 1, 90, cut),
        ("none", 3, 255, b"\0no recording\0".to_vec()),
        ("name-alone", 3, 3, b"\x89MCAP0\r\n".to_vec()),
    ];
    let seeds =
        files.map(|(name, piece, cut, file)| (name.to_owned(), after(piece, after(cut, file))));
    Ok(seeds.into())
}

/// Inputs of a target with their names.
type Seeds = Vec<(String, Vec<u8>)>;

/// A byte for the target, and the file.
fn after(first: u8, file: Vec<u8>) -> Vec<u8> {
    [vec![first], file].concat()
}

/// A small picture of all levels.
fn picture() -> DynamicImage {
    RgbImage::from_fn(9, 6, |x, y| {
        Rgb([28 * x, 50 * y, 20 * (x + y)].map(|level| level as u8))
    })
    .into()
}

/// A small image in every format, kind of pixel and order that is read.
fn images() -> Result<Seeds> {
    let eight = picture();
    let grey = DynamicImage::from(eight.to_luma8());
    // As a camera of 12 bits stores its levels.
    let mut wide = eight.to_luma16();
    wide.iter_mut().for_each(|level| *level >>= 4);
    let wide = DynamicImage::from(wide);
    let mut seeds = Vec::new();
    for (name, format) in [
        ("png", ImageFormat::Png),
        ("jpeg", ImageFormat::Jpeg),
        ("tiff", ImageFormat::Tiff),
        ("webp", ImageFormat::WebP),
        ("bmp", ImageFormat::Bmp),
        ("portable-map", ImageFormat::Pnm),
    ] {
        for (kind, image) in [("colour", &eight), ("grey", &grey)] {
            let file = encode(image, format)?;
            seeds.push((format!("{name}-{kind}"), after(0, file)));
        }
    }
    for (name, format) in [
        ("png", ImageFormat::Png),
        ("tiff", ImageFormat::Tiff),
        ("portable-map", ImageFormat::Pnm),
    ] {
        seeds.push((format!("{name}-12-bit"), after(0, encode(&wide, format)?)));
    }
    seeds.push((
        "png-12-bit-stated".to_owned(),
        after(12, encode(&wide, ImageFormat::Png)?),
    ));
    let png = |kind, depth, packed: &[u8]| png_file((9, 6), kind, depth, packed);
    seeds.extend([
        (
            "png-palette".to_owned(),
            after(0, png(ColorType::Indexed, BitDepth::Two, &[0x1b; 18])?),
        ),
        (
            "png-1-bit".to_owned(),
            after(0, png(ColorType::Grayscale, BitDepth::One, &[0x5a; 12])?),
        ),
        (
            "png-alpha-16-bit".to_owned(),
            after(16, png(ColorType::Rgba, BitDepth::Sixteen, &[7; 432])?),
        ),
        (
            "portable-map-plain".to_owned(),
            after(
                0,
                b"P2\n# of 10 bits\n3 2\n1023\n0 1 2 1023 512 7\n".to_vec(),
            ),
        ),
        (
            "portable-map-bits".to_owned(),
            after(0, b"P4\n9 2\n\xaa\x80\x55\x00".to_vec()),
        ),
    ]);
    Ok(seeds)
}

/// A PNG of these samples, packed as the file has them.
fn png_file(
    (width, height): (u32, u32),
    kind: ColorType,
    depth: BitDepth,
    packed: &[u8],
) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(kind);
    encoder.set_depth(depth);
    if kind == ColorType::Indexed {
        encoder.set_palette(vec![0, 0, 0, 9, 8, 7, 200, 100, 50, 255, 255, 255]);
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(packed)?;
    writer.finish()?;
    Ok(bytes)
}

fn truth_and_masks() -> Result<Seeds> {
    use BitDepth::{Eight, Four, One, Sixteen};
    use ColorType::{Grayscale, Indexed, Rgb};
    // The steps per px are the square of the first byte in 1/64: 16 stands for 4.
    let mut seeds = Vec::new();
    for (name, steps, kind, depth, packed) in [
        (
            "truth-8-bit",
            16,
            Grayscale,
            Eight,
            vec![0, 1, 9, 200, 254, 255],
        ),
        (
            "truth-16-bit",
            128,
            Grayscale,
            Sixteen,
            vec![0, 0, 0, 1, 1, 0, 9, 9, 200, 3, 255, 255],
        ),
        (
            "truth-colours",
            16,
            Rgb,
            Eight,
            [3, 3, 3, 250, 250, 250].repeat(3),
        ),
        ("truth-without-steps", 255, Grayscale, Eight, vec![1; 6]),
        (
            "mask-1-bit",
            0,
            Grayscale,
            One,
            vec![0b1010_0000, 0b0110_0000],
        ),
        (
            "mask-palette",
            0,
            Indexed,
            Four,
            vec![0x01, 0x10, 0x11, 0x00],
        ),
        (
            "mask-8-bit",
            1,
            Grayscale,
            Eight,
            vec![0, 255, 128, 255, 0, 1],
        ),
    ] {
        let file = png_file((3, 2), kind, depth, &packed)?;
        seeds.push((name.to_owned(), after(steps, file)));
    }
    let map = Pfm {
        width: 3,
        height: 2,
        values: vec![0.0, 1.5, f32::INFINITY, -1.0, f32::NAN, 63.75],
    };
    seeds.push(("float-map".to_owned(), after(0, map.to_bytes())));
    let big_endian = [b"Pf\n1 2\n1.0\n".as_slice(), &[0x40, 0x20, 0, 0].repeat(2)].concat();
    seeds.push(("float-map-big-endian".to_owned(), after(0, big_endian)));
    Ok(seeds)
}

/// The first of random inputs of a length whose case is a wanted one.
fn search<T>(name: &str, length: usize, is_wanted: impl Fn(&T) -> bool) -> Result<(String, Vec<u8>)>
where
    T: for<'a> Arbitrary<'a>,
{
    let mut random = Pcg32::seed_from_u64(length as u64);
    let mut inputs = (0..100_000).map(|_| {
        let mut bytes = vec![0; length];
        random.fill_bytes(&mut bytes);
        bytes
    });
    let wanted = inputs.find(|bytes| {
        T::arbitrary(&mut Unstructured::new(bytes)).is_ok_and(|case| is_wanted(&case))
    });
    let bytes = wanted.with_context(|| format!("no input stands for {name}"))?;
    Ok((name.to_owned(), bytes))
}

fn sessions() -> Result<Seeds> {
    use session::Case;
    let has = |case: &Case, kind| case.camera.iter().any(|fault| fault.kind == kind);
    Ok(vec![
        search("no-fault", 1, |case: &Case| case.height == 4)?,
        search("one-line", 60, |case: &Case| case.height == 1)?,
        search("duplicated-frame", 8, move |case: &Case| {
            has(case, FaultKind::DuplicatedFrame) && case.height > 3
        })?,
        search("failing-sink", 24, |case: &Case| {
            case.sink.len() > case.camera.len()
        })?,
        search("storm", 600, |case: &Case| case.height == 5)?,
    ])
}

fn matchers() -> Result<Seeds> {
    use matcher::Case;
    let sgm = |case: &Case, is_wanted: fn(&vgstereo_core::SgmParameters) -> bool| {
        let is_large =
            case.pair.width > 20 && case.pair.height > 6 && case.config.disparities.count > 8;
        is_large && matches!(case.config.parameters.method, Method::Sgm(sgm) if is_wanted(&sgm))
    };
    let recall = |case: &Case| matches!(case.config.parameters.method, Method::Recall(_));
    Ok(vec![
        search("recall", 100, move |case: &Case| {
            recall(case) && case.pair.width > 20 && case.config.output == Output::Dense
        })?,
        search("recall-right-view", 90, move |case: &Case| {
            recall(case) && case.config.reference == Reference::Right
        })?,
        search("sgm-plain", 130, move |case: &Case| {
            sgm(case, |sgm| {
                sgm.speckle.is_none() && sgm.vote.is_none() && sgm.weighted_median.is_none()
            })
        })?,
        search("sgm-all-stages", 140, move |case: &Case| {
            sgm(case, |sgm| {
                sgm.speckle.is_some() && sgm.vote.is_some() && sgm.weighted_median.is_some()
            })
        })?,
        search("sgm-colour-aligned", 150, move |case: &Case| {
            case.config.colour && sgm(case, |sgm| sgm.colour && sgm.moving_lines() > 0)
        })?,
        search("one-pixel", 80, |case: &Case| {
            case.pair.width * case.pair.height == 1
        })?,
    ])
}

/// Streams of packets, and contents of packets that the target frames, with 255 between them.
fn link_decoders() -> Result<Seeds> {
    let mut memory = [0; 400];
    let mut encoder = Encoder::new(&mut memory);
    let line = BoardMessage::Disparities(Line {
        frame: 1,
        line: 2,
        column: 3,
        values: Values::Plain(&[160, 161, i16::MIN, 900, 159, 158]),
    });
    let aborted = BoardMessage::FrameAborted {
        frame: 1,
        reason: Reason::Sequence,
    };
    let mut stream = vec![0];
    for message in [&line, &aborted, &line] {
        stream.extend_from_slice(encoder.encode(1000, message)?);
    }
    stream.extend_from_slice(encoder.encode(1000, &HostMessage::Stop)?);
    // Version, kind, sequence number and time, then the body.
    let hello: &[u8] =
        b"\x01\x01\x00\x05\x01d\x01f\x10\x08\x00\x10\x08\x01\x01p\x00\x10\x02\x04\x00\x01\x00";
    let board = [
        hello,
        &[1, 2, 1, 5, 9, 70, 0, 0, 8, 4],
        &[1, 5, 2, 5, 9, 0, 0, 4, 1, 0x63, 0x10],
        &[1, 6, 3, 5, 9, 0, 0, 4, 0, 7, 8, 9, 10],
        &[1, 7, 4, 5, 9, 0, 0, 5, 1, 0xdf, 0xe, 1, 0],
        &[1, 8, 5, 5, 9, 0, 0, 1, 0, 2, 0, 3, 0],
        &[1, 9, 6, 5, 9, 70, 0, 0, 0, 0, 0, 0, 0, 0, 9, 4, 1, 0xf],
        &[1, 10, 7, 5, 9, 0, 0, 1, 2, 3, 4],
        &[1, 3, 9, 5, 9],
        &[1, 13, 9, 5, 0, 1, b't'],
        &[2, 13, 100, 5, 0, 1, b't'],
        &[1, 14, 10, 5, 9, 3],
    ];
    let host: [&[u8]; 6] = [
        &[1, 73, 0, 5],
        &[1, 67, 1, 5, 4, 2, 1, 0, 0, 8, 4],
        &[1, 68, 2, 5, 4, 9, 0, 1, 2, 3, 4],
        &[1, 69, 3, 5, 4, 9],
        &[1, 71, 4, 5, 1, 48, 0, 0, 1, 8, 0, 0, 1, 1],
        &[1, 65, 5, 5],
    ];
    Ok(vec![
        ("stream".to_owned(), after(7, stream)),
        ("board".to_owned(), after(200, board.join(&255))),
        ("host".to_owned(), after(1, host.join(&255))),
    ])
}

/// Lines of values, and packed lines of as many values as the first byte says.
fn link_lines() -> Seeds {
    let values = [300_i16, 301, i16::MIN, 299, 299, 1200, 1201, 0, -1, -1, -1];
    let values = values.iter().flat_map(|value| value.to_le_bytes());
    vec![
        ("values".to_owned(), after(0, values.collect())),
        ("packed-plain".to_owned(), after(2, vec![0, 1, 2, 3, 4])),
        (
            "packed-groups".to_owned(),
            after(6, vec![1, 0x63, 0x10, 0xdf, 0xe, 1, 0]),
        ),
        ("packed-nothing".to_owned(), after(8, vec![1, 0xff])),
    ]
}

/// Rectifications of the calibrations of text.
fn rectifications(corpora: &Path) -> Result<Seeds> {
    let mut seeds = Vec::new();
    for name in ["opencv-yaml", "opencv-json"] {
        let bytes = fs::read(corpora.join("calibration").join(name))?;
        let made = rectify(&[("stereo.yml".to_owned(), bytes)], &Options::default())?;
        let content = &made.maps.bytes;
        seeds.push((
            format!("{name}-mended"),
            after(1, content[..content.len() - 4].to_vec()),
        ));
        seeds.push((name.to_owned(), after(0, content.clone())));
    }
    Ok(seeds)
}
