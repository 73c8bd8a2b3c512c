//! What a terminal may show: names of files can hold characters that nobody sees, that move what is
//! written, or that begin a line which looks like the program's own.

use std::borrow::Cow;
use std::path::Path;

/// Returns a text whose characters that a terminal does not show are escaped as `\u200b`: controls,
/// characters of no width or that change the direction of writing, and spaces other than the usual
/// one. Line breaks stay.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c != '\n' && is_hidden(c))
}

/// Returns a path for a message: as [`printable`], and line breaks are escaped too.
#[must_use]
pub fn shown(path: &Path) -> String {
    shown_name(&path.to_string_lossy())
}

/// Returns a name for a message or a table: as [`printable`], and line breaks are escaped too.
#[must_use]
pub fn shown_name(name: &str) -> String {
    escaped(name, is_hidden).into_owned()
}

fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_escaped) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        if is_escaped(c) {
            // In units of 16 bits, so that JSON reads the escapes too.
            for unit in c.encode_utf16(&mut [0; 2]) {
                escaped += &format!("\\u{unit:04x}");
            }
        } else {
            escaped.push(c);
        }
    }
    Cow::Owned(escaped)
}

/// Whether a character cannot be seen, as the tables of the standard library have it.
fn is_hidden(c: char) -> bool {
    if c.is_ascii() {
        return c.is_ascii_control();
    }
    // A mark that combines with the letter before it can be seen, and is not escaped there.
    let after_letter = String::from_iter(['a', c]);
    after_letter.escape_debug().nth(2).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_seen_is_escaped_and_spaces_stay() {
        assert_eq!(
            printable("a  b\nc é 日 \"x\" \\ e\u{301} 🦀"),
            "a  b\nc é 日 \"x\" \\ e\u{301} 🦀"
        );
        assert_eq!(
            printable("\u{1b}]0;t\u{7}\u{9b}\r\t\u{202e}\u{7f}"),
            "\\u001b]0;t\\u0007\\u009b\\u000d\\u0009\\u202e\\u007f"
        );
        // Of no width, of direction, breaks of lines, spaces, a byte order mark, a tag.
        for c in "\u{ad}\u{61c}\u{200b}\u{200d}\u{200f}\u{2028}\u{2029}\u{2060}\u{2066}\u{a0}\u{feff}\u{e0041}".chars() {
            let text = c.to_string();
            let shown = printable(&text);
            assert!(shown.is_ascii(), "{shown:?}");
            // What JSON escapes it reads back.
            let name: String = serde_json::from_str(&format!("\"{shown}\"")).unwrap();
            assert_eq!(name, text);
        }
    }

    #[test]
    fn a_name_stays_on_its_line() {
        assert_eq!(printable("a\nwrote b"), "a\nwrote b");
        assert_eq!(
            shown(Path::new("a\nwrote b\u{200b}.png")),
            "a\\u000awrote b\\u200b.png"
        );
        assert_eq!(shown(Path::new("left 1.png")), "left 1.png");
    }
}
