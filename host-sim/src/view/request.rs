//! What the page asks for, and what is asked of the board for it.

use serde::{Deserialize, Serialize};
use vgstereo_link::{Parameters, Streams};

/// A message of the page, in JSON. What is not one ends the connection of its sender.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Request {
    /// Show this, and no longer what was shown before.
    Show(Vec<Shown>),
    /// A command to the board.
    Board(Command),
}

/// A command to the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Command {
    /// Send frames.
    Start,
    /// Send none.
    Stop,
    /// Set all counters to 0, those of this end as well.
    ResetCounters,
    /// Take lines from the test pattern, or else from the camera.
    TestPattern(bool),
    /// Use these parameters.
    Parameters(Parameters),
}

/// A part of the page that shows something.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shown {
    /// The views as the camera gives them.
    Raw,
    /// The rectified views.
    Rectified,
    /// Disparities.
    Disparity,
    /// Depths.
    Depth,
    /// Confidences.
    Confidence,
    /// The cloud of points.
    Cloud,
    /// The plan view.
    Scan,
}

/// What is shown, to all who look together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Show(u8);

impl Show {
    /// Whether a part is shown.
    #[must_use]
    pub fn contains(self, shown: Shown) -> bool {
        self.0 & (1 << shown as u8) != 0
    }

    /// What is shown to either.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The streams that are to be asked of a board that can send `offered`. Depths and scans are
    /// made of disparities where the camera is known, because that takes fewer bytes; a scan that
    /// the board makes takes fewer still.
    #[must_use]
    pub fn streams(self, offered: Streams, has_camera: bool) -> Streams {
        let mut streams = Streams::NONE;
        let found = Streams::DISPARITIES.with(Streams::CONFIDENCES);
        for (shown, wanted) in [
            (Shown::Raw, Streams::RAW),
            (Shown::Rectified, Streams::RECTIFIED),
            (Shown::Disparity, Streams::DISPARITIES),
            (Shown::Confidence, Streams::CONFIDENCES),
            (Shown::Depth, Streams::DEPTHS),
            (Shown::Cloud, Streams::DEPTHS),
            (Shown::Scan, Streams::SCANS),
        ] {
            if !self.contains(shown) {
                continue;
            }
            streams = streams.with(match shown {
                Shown::Depth | Shown::Cloud if has_camera => Streams::DISPARITIES,
                Shown::Scan if has_camera && !offered.contains(Streams::SCANS) => found,
                _ => wanted,
            });
        }
        Streams::from_bits(streams.bits() & offered.bits())
    }
}

impl FromIterator<Shown> for Show {
    fn from_iter<I: IntoIterator<Item = Shown>>(shown: I) -> Self {
        Self(
            shown
                .into_iter()
                .fold(0, |bits, shown| bits | 1 << shown as u8),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: Streams = Streams::from_bits(0x7f);

    #[test]
    fn no_more_is_asked_of_the_board_than_is_shown() {
        let ask = |shown: &[Shown], offered, has_camera| {
            shown
                .iter()
                .copied()
                .collect::<Show>()
                .streams(offered, has_camera)
        };
        assert_eq!(ask(&[], ALL, true), Streams::NONE);
        assert_eq!(ask(&[Shown::Raw], ALL, true), Streams::RAW);
        let both = Streams::DISPARITIES.with(Streams::CONFIDENCES);
        assert_eq!(
            ask(&[Shown::Disparity, Shown::Confidence], ALL, false),
            both
        );
        // Of disparities where that can be, and of what the board can send otherwise.
        assert_eq!(
            ask(&[Shown::Depth, Shown::Cloud], ALL, true),
            Streams::DISPARITIES
        );
        assert_eq!(ask(&[Shown::Depth], ALL, false), Streams::DEPTHS);
        assert_eq!(ask(&[Shown::Scan], ALL, true), Streams::SCANS);
        assert_eq!(ask(&[Shown::Scan], both, true), both);
        assert_eq!(
            ask(&[Shown::Depth, Shown::Scan], both, false),
            Streams::NONE
        );
    }

    #[test]
    fn requests_are_read_and_what_is_none_is_refused() {
        let read = |text: &str| serde_json::from_str::<Request>(text).ok();
        let shown = vec![Shown::Raw, Shown::Depth];
        assert_eq!(
            read(r#"{"show":["raw","depth"]}"#),
            Some(Request::Show(shown))
        );
        assert_eq!(
            read(r#"{"board":"start"}"#),
            Some(Request::Board(Command::Start))
        );
        let parameters = Parameters {
            margin: Some(-3),
            ..Parameters::default()
        };
        assert_eq!(
            read(r#"{"board":{"parameters":{"margin":-3}}}"#),
            Some(Request::Board(Command::Parameters(parameters)))
        );
        for text in [
            "",
            "{}",
            "7",
            r#"{"show":["all"]}"#,
            r#"{"board":"commit"}"#,
            r#"{"board":{"parameters":{"margin":99999}}}"#,
            r#"{"board":"start","show":[]}"#,
        ] {
            assert_eq!(read(text), None, "{text}");
        }
    }
}
