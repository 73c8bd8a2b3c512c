//! Rectification of whole views, line by line through the core's own stage.

use anyhow::{Result, ensure};
use vgstereo_core::Line;
use vgstereo_core::geometry::{Rectification, Rectifier};
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_kernels::NativeKernels;

use vgstereo_frame::Views;

/// Returns the rectified views of the raw ones, in grey or in colour as these are, with the columns
/// that the cameras saw.
///
/// # Errors
/// Fails with one line that states both sizes when the rectification is for another size.
pub fn rectified(raw: &Views, rectification: &Rectification<'_>) -> Result<Views> {
    let (raw_width, raw_height) = (rectification.raw_width, rectification.raw_height);
    ensure!(
        raw.width == raw_width && raw.height() == usize::from(raw_height),
        "the rectification is for views of {raw_width}x{raw_height} px, and these have {}x{}",
        raw.width,
        raw.height()
    );
    let has_colour = raw.has_colour();
    let width = usize::from(rectification.width);
    let kernels = NativeKernels::fastest();
    let mut memory = vec![0; Rectifier::words(rectification, has_colour)];
    let mut rectifier = Rectifier::new(*rectification, has_colour, kernels, &mut memory)?;
    let (mut grey, mut pixels) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
    let mut valid_columns = [Vec::new(), Vec::new()];
    let mut row = vec![0; width];
    for (left, right) in raw.lines(kernels) {
        rectifier.push(&left, &right)?;
        while let Some(pair) = rectifier.next_pair() {
            for (view, line) in pair.iter().enumerate() {
                line.write_grey(&mut row);
                grey[view].extend_from_slice(&row);
                let columns = line.valid_columns();
                valid_columns[view]
                    .push(u16::try_from(columns.start)?..u16::try_from(columns.end)?);
                if has_colour {
                    let start = pixels[view].len();
                    pixels[view].resize(start + 3 * width, 0);
                    for channel in 0..3 {
                        line.write_channel(channel, &mut row);
                        let levels = pixels[view][start + channel..].iter_mut().step_by(3);
                        levels.zip(&row).for_each(|(to, &level)| *to = level);
                    }
                }
            }
        }
    }
    let ([left, right], format, grey) = if has_colour {
        (pixels, PixelFormat::Rgb888, Some(grey))
    } else {
        (grey, PixelFormat::Grey8, None)
    };
    Ok(Views {
        left,
        right,
        width: rectification.width,
        format,
        grey,
        valid_columns,
    })
}
