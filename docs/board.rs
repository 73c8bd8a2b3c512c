use static_cell::ConstStaticCell;
use vgstereo_core::{Config, DisparityRange, Matcher, Preset, PushError};
use vgstereo_kernels::Armv7em;

const WIDTH: usize = 320;
const CONFIG: Config = Config::new(
    Preset::Lite.parameters(),
    WIDTH as u16,
    DisparityRange::up_to(47),
);
const _: () = assert!(CONFIG.validate().is_ok());

/// The matcher's working memory, lent to it for as long as it lives.
static MEMORY: ConstStaticCell<[u32; CONFIG.memory_words()]> =
    ConstStaticCell::new([0; CONFIG.memory_words()]);

/// Builds the matcher; `None` when its memory is lent already.
pub fn matcher() -> Option<Matcher<'static, Armv7em>> {
    Matcher::new(&CONFIG, Armv7em, MEMORY.try_take()?).ok()
}

/// Matches a frame: `next` gives pairs of lines from the top, `send` takes the number of a line
/// and its disparities in 1/16 px.
pub fn match_frame(
    matcher: &mut Matcher<'_, Armv7em>,
    mut next: impl FnMut() -> Option<[[u8; WIDTH]; 2]>,
    mut send: impl FnMut(u32, &[i16]),
) -> Result<(), PushError> {
    while let Some([left, right]) = next() {
        if let Some(line) = matcher.push(&left, &right)? {
            send(line.line, line.disparities_q4);
        }
    }
    while let Some(line) = matcher.finish() {
        send(line.line, line.disparities_q4);
    }
    Ok(())
}
