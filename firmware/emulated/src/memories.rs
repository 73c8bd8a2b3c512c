//! The lent memory of a board, shared out as a request needs it.

use vgstereo_firmware::session;

use crate::request::{Refusal, Request};

/// Parts of the lent memory, each as large as the request needs it.
#[derive(Debug)]
pub struct Memories {
    /// The session's lines.
    pub lines: &'static mut [u32],
    /// The rectification, and the rectifier behind it. If the board is live, all that the rest leaves, for
    /// a calibration from the host.
    pub calibration: &'static mut [u32],
    /// The laser scan.
    pub scan: &'static mut [u32],
    /// The link, if the board is live.
    pub link: &'static mut [u32],
    /// The matcher: less than it takes, where no more is left.
    pub matcher: &'static mut [u32],
    /// All that the other parts do not take. Empty if the board is live.
    pub rest: &'static mut [u32],
}

impl Memories {
    /// Shares the memory out.
    ///
    /// # Errors
    /// Fails when it is too small for something else than the matcher, which sees that for itself.
    pub fn new(request: &Request, memory: &'static mut [u32]) -> Result<Self, Refusal> {
        let (lines, memory) = memory
            .split_at_mut_checked(session::memory_words(&request.geometry))
            .ok_or(Refusal("the lines do not fit the lent memory"))?;
        let scan_words = request.scan.map_or(0, |scan| scan.words());
        let (scan, memory) = memory
            .split_at_mut_checked(scan_words)
            .ok_or(Refusal("the scan does not fit the lent memory"))?;
        let (link, memory) = memory
            .split_at_mut_checked(request.link_words())
            .ok_or(Refusal("the link does not fit the lent memory"))?;
        let matcher_words = request.config().memory_words();
        let (matcher, memory) = memory.split_at_mut(matcher_words.min(memory.len()));
        let [rectification_words, rectifier_words] = request.calibration_words();
        let calibration_words = match request.is_live {
            true => memory.len(),
            false => rectification_words + rectifier_words,
        };
        let (calibration, rest) = memory
            .split_at_mut_checked(calibration_words)
            .ok_or(Refusal("the calibration does not fit the lent memory"))?;
        Ok(Self {
            lines,
            calibration,
            scan,
            link,
            matcher,
            rest,
        })
    }
}
