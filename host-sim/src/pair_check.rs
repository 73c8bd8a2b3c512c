//! A check of a pair of views before its disparities are believed: does it match better with the
//! views exchanged, with the right view some lines higher or lower, or in a wider search range?
//!
//! A few bands of lines are matched in each of these ways. Ways are compared by their score, the
//! mean confidence of the pixels, in which pixels without a confirmed match count 0. Scores of one
//! pair can be compared with each other; those of different scenes cannot, as they depend on the
//! texture.

use std::fmt;
use std::ops::Range;

use vgstereo_core::{Config, DisparityRange, Method, Output, Parameters, Preset, STEPS_PER_PX};
use vgstereo_firmware::camera::PixelFormat;
use vgstereo_kernels::NativeKernels;

use vgstereo_frame::{FrameError, Views, match_frame};

/// Number of bands of lines, spread evenly over the height.
const BANDS: usize = 6;
/// Lines of a band that count.
const MEASURED_LINES: usize = 4;
/// Lines above those that count, from which path costs come down.
const LEAD_LINES: usize = 6;
/// Lines below those that count, for patterns and speckle removal.
const TAIL_LINES: usize = 7;
/// Score of the exchanged pair, in percent of the best of the other ways, above which the views
/// are told to be exchanged. Good pairs that were exchanged have 235 % at least, and good pairs as
/// they are 43 % at most (docs/accuracy.md).
const EXCHANGED_MIN_PERCENT: u64 = 150;
/// Score of a pair with its right view moved, in percent of that as given, above which the view is
/// told to lie too high or too low. Good pairs that were moved have 108 % at least, and good pairs as
/// they are 93 % at most (docs/accuracy.md).
const MOVED_MIN_PERCENT: u64 = 105;
/// Score below which the views hardly match. Good pairs have 40 at least, and views of unrelated
/// scenes 14 at most unless very few disparities are searched.
const SCORE_MIN: u64 = 25;
/// Share of the pixels beyond an end of the search range, in percent, from which it is told that
/// the range is too small, and that share where the views hardly match within the range.
const OUTSIDE_MIN_PERCENT: [f32; 2] = [3.0, 12.0];

/// What seems to be wrong with a pair of views, or with the search range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hint {
    /// Both views are the same image.
    Identical,
    /// The pair matches far better with its views exchanged.
    Exchanged,
    /// The pair matches better when the right view is moved.
    LinesOff {
        /// By how many lines the right view lies too low; negative if it lies too high.
        too_low: i8,
    },
    /// A part of the scene has smaller disparities than the search range.
    Below(Outside),
    /// A part of the scene has larger disparities than the search range.
    Beyond(Outside),
    /// The views hardly match in any of the ways that were tried.
    HardlyMatches,
}

impl fmt::Display for Hint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Identical => {
                f.write_str("both views are the same image, so that there is nothing to match")
            }
            Self::Exchanged => f.write_str(
                "the pair matches far better with its views exchanged: give the left image first",
            ),
            Self::LinesOff { too_low } => {
                let lines = too_low.unsigned_abs();
                let plural = if lines == 1 { "" } else { "s" };
                let direction = if *too_low > 0 { "low" } else { "high" };
                write!(
                    f,
                    "the right view lies about {lines} line{plural} too {direction}: rectify the pair"
                )
            }
            Self::Below(Outside { percent, to_px }) => write!(
                f,
                "{percent:.0} % of the pixels lie below the search range, down to {to_px} px or \
                 further: lower --min-disparity"
            ),
            Self::Beyond(Outside { percent, to_px }) => write!(
                f,
                "{percent:.0} % of the pixels lie beyond the search range, up to {to_px} px or \
                 further: raise --d-max"
            ),
            Self::HardlyMatches => {
                f.write_str("the views hardly match: are they rectified, and of the same moment?")
            }
        }
    }
}

/// How well a pair matches as it is given and otherwise: mean confidences, 0 to 255.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scores {
    /// The pair as it is given.
    pub given: u64,
    /// The views exchanged.
    pub exchanged: u64,
    /// The right view taken some lines lower, with the number of lines; negative for higher.
    pub moved: [(i8, u64); 6],
}

/// Pixels that are outside a range of disparities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outside {
    /// Share of all pixels, percent.
    pub percent: f32,
    /// The disparity that all but the outermost twentieth of them keep within, px.
    pub to_px: i16,
}

/// Returns what seems to be wrong with views that are to be matched in this range of disparities;
/// nothing for a good pair. The grey of the views is compared, with parameters of its own: the
/// hints do not depend on the preset that the pair is matched with.
///
/// # Errors
/// [`FrameError`] when the range does not fit the width.
pub fn hints(views: &Views, disparities: DisparityRange) -> Result<Vec<Hint>, FrameError> {
    if views.left == views.right {
        return Ok(vec![Hint::Identical]);
    }
    let grey = &views.to_grey();
    let scores = scores_of_grey(grey, disparities)?;
    let given = scores.given;
    let (too_low, moved) = scores
        .moved
        .into_iter()
        .max_by_key(|&(_, score)| score)
        .unwrap_or((0, 0));
    let hardly_matches = given.max(moved).max(scores.exchanged) < SCORE_MIN;
    if !hardly_matches {
        if scores.exchanged * 100 > given.max(moved) * EXCHANGED_MIN_PERCENT {
            return Ok(vec![Hint::Exchanged]);
        }
        if moved * 100 > given * MOVED_MIN_PERCENT {
            return Ok(vec![Hint::LinesOff { too_low }]);
        }
    }
    let [below, beyond] = outside_of_grey(grey, disparities)?;
    // Where hardly anything is right, wrong matches lie everywhere.
    let percent_min = OUTSIDE_MIN_PERCENT[usize::from(hardly_matches)];
    let is_told = |outside: &Outside| outside.percent >= percent_min;
    let below = Some(below).filter(is_told).map(Hint::Below);
    let beyond = Some(beyond).filter(is_told).map(Hint::Beyond);
    let hints: Vec<Hint> = below.into_iter().chain(beyond).collect();
    Ok(if hardly_matches && hints.is_empty() {
        vec![Hint::HardlyMatches]
    } else {
        hints
    })
}

/// Returns how well a pair matches in the ways that are tried.
///
/// # Errors
/// [`FrameError`] when the range does not fit the width.
pub fn scores(views: &Views, disparities: DisparityRange) -> Result<Scores, FrameError> {
    scores_of_grey(&views.to_grey(), disparities)
}

fn scores_of_grey(grey: &Views, disparities: DisparityRange) -> Result<Scores, FrameError> {
    let score = |exchanged: bool, too_low: i8| -> Result<u64, FrameError> {
        let found = sample(grey, disparities, disparities, Way { exchanged, too_low })?;
        let sum: u64 = found
            .iter()
            .map(|&(_, confidence)| u64::from(confidence))
            .sum();
        Ok(sum / (found.len() as u64).max(1))
    };
    let mut moved = [-3, -2, -1, 1, 2, 3].map(|too_low| (too_low, 0));
    for (too_low, moved) in &mut moved {
        *moved = score(false, *too_low)?;
    }
    Ok(Scores {
        given: score(false, 0)?,
        exchanged: score(true, 0)?,
        moved,
    })
}

/// Returns which part of the pixels is found below and beyond a range of disparities, when more
/// disparities are searched on either side.
///
/// # Errors
/// [`FrameError`] when the range does not fit the width.
pub fn outside(views: &Views, disparities: DisparityRange) -> Result<[Outside; 2], FrameError> {
    outside_of_grey(&views.to_grey(), disparities)
}

fn outside_of_grey(grey: &Views, disparities: DisparityRange) -> Result<[Outside; 2], FrameError> {
    let wide = widened(disparities, grey.width);
    let found = sample(grey, wide, disparities, Way::default())?;
    let range_px = disparities.range_px();
    let steps = i32::from(STEPS_PER_PX);
    let (mut below, mut beyond) = (Vec::new(), Vec::new());
    for &(disparity_q4, confidence) in &found {
        if confidence == 0 {
            continue;
        }
        // By a whole pixel: less can stem from the sub-pixel step.
        if i32::from(disparity_q4) >= range_px.end * steps {
            beyond.push(disparity_q4);
        } else if i32::from(disparity_q4) <= (range_px.start - 1) * steps {
            below.push(disparity_q4);
        }
    }
    below.sort_unstable_by(|a, b| b.cmp(a));
    beyond.sort_unstable();
    Ok([below, beyond].map(|outside| Outside {
        percent: outside.len() as f32 * 100.0 / found.len().max(1) as f32,
        to_px: outside
            .get(outside.len() * 95 / 100)
            .map_or(0, |d| d / STEPS_PER_PX),
    }))
}

/// A way to take a pair.
#[derive(Debug, Clone, Copy, Default)]
struct Way {
    /// Whether the left view is taken for the right one.
    exchanged: bool,
    /// How many lines below that of the left view the line of the right view is taken.
    too_low: i8,
}

/// Returns a range that is wider by half the disparities and 8 px at either end, as far as the
/// width allows.
fn widened(disparities: DisparityRange, width: u16) -> DisparityRange {
    let Range { start, end } = disparities.range_px();
    let more = (end - start) / 2 + 8;
    let widest = i32::from(width) - 1;
    let candidate = |more: i32| {
        let minimum = (start - more).max(start.min(-widest));
        let end = (end + more).min(end.max(widest + 1));
        DisparityRange {
            minimum_px: minimum as i16,
            count: (end - minimum) as u16,
        }
    };
    let fitting = [more, more / 2, more / 4].map(candidate);
    let fits = |range: &&DisparityRange| range.fits(width);
    fitting.iter().find(fits).copied().unwrap_or(disparities)
}

/// Matches bands of lines of a grey pair in `searched` and returns disparity, 1/16 px, and
/// confidence of the pixels that count, 0 where no match was confirmed. Columns at the sides
/// that have no counterpart in either view, at the disparities `expected`, do not count.
fn sample(
    views: &Views,
    searched: DisparityRange,
    expected: DisparityRange,
    way: Way,
) -> Result<Vec<(i16, u8)>, FrameError> {
    let width = usize::from(views.width);
    let config = Config {
        output: Output::Sparse,
        ..Config::new(parameters(), views.width, searched)
    };
    let range_px = expected.range_px();
    let reach = range_px.start.abs().max(range_px.end - 1);
    let margin = usize::try_from(reach).unwrap_or(0).min(width / 4);
    let mut found = Vec::new();
    for band in 0..BANDS {
        let centre = (2 * band + 1) * views.height() / (2 * BANDS);
        let first = centre.cast_signed() - (LEAD_LINES + MEASURED_LINES / 2).cast_signed();
        let firsts = [first, first + isize::from(way.too_low)];
        let mut left = lines_of(&views.left, width, firsts[0]);
        let mut right = lines_of(&views.right, width, firsts[1]);
        let [left_valid, right_valid] = &views.valid_columns;
        let mut valid_columns = [(left_valid, firsts[0]), (right_valid, firsts[1])]
            .map(|(of, first)| lines_of(of, 1, first));
        if way.exchanged {
            std::mem::swap(&mut left, &mut right);
            valid_columns.reverse();
        }
        let band = Views {
            left,
            right,
            width: views.width,
            format: PixelFormat::Grey8,
            grey: None,
            valid_columns,
        };
        let matched = match_frame(&config, &band, NativeKernels::fastest(), 1)?;
        let disparities = matched.disparities_q4.chunks(width);
        let lines = disparities.zip(matched.confidences.chunks(width));
        for (disparities_q4, confidences) in lines.skip(LEAD_LINES).take(MEASURED_LINES) {
            let pixels = disparities_q4
                .iter()
                .copied()
                .zip(confidences.iter().copied());
            found.extend(pixels.take(width - margin).skip(margin));
        }
    }
    Ok(found)
}

/// The parameters of the check: the fastest that search both views, without what makes up for
/// lines that lie too high or low, or adapts to views that match badly, which would favour them.
fn parameters() -> Parameters {
    let mut parameters = Preset::Lite.parameters();
    // Short cells tell lines that are off less well.
    parameters.cell_length_max_px = 0;
    if let Method::Sgm(sgm) = &mut parameters.method {
        sgm.line_offset_max_lines = 0;
        sgm.line_gain_max_q8 = 0;
        sgm.usual_difference_max = u8::MAX;
        sgm.evidence_q8 = 0;
    }
    parameters
}

/// Returns the lines of a band from `first` on of a view of `width` values a line. Beyond the view,
/// its outermost line is repeated; of a view without lines there are none.
fn lines_of<T: Clone>(view: &[T], width: usize, first: isize) -> Vec<T> {
    let count = LEAD_LINES + MEASURED_LINES + TAIL_LINES;
    let last = (view.len() / width.max(1)).saturating_sub(1);
    let mut band = Vec::with_capacity(count * width);
    for line in first..first + count.cast_signed() {
        let start = usize::try_from(line).unwrap_or(0).min(last) * width;
        band.extend_from_slice(view.get(start..start + width).unwrap_or_default());
    }
    band
}
