//! The syntax of calibration files: YAML, XML, JSON, TOML, npy and npz become one tree, whose numbers are
//! finite and counted when they are read.

use anyhow::{Context, Result, anyhow, ensure};
use serde_json::{Map, Value};

use super::numpy;

/// Nesting of XML elements beyond which a file is refused.
const DEPTH_MAX: usize = 32;
/// Most numbers that one entry may have.
const NUMBERS_MAX: usize = 1 << 16;

/// A calibration file.
#[derive(Debug, Clone)]
pub(super) struct Document {
    /// The name of the file, for messages.
    pub(super) name: String,
    root: Value,
}

/// An entry of a file.
#[derive(Debug, Clone)]
pub(super) struct Entry<'a> {
    file: &'a str,
    /// The keys down to the entry, joined by dots.
    path: String,
    value: &'a Value,
}

impl Document {
    /// Parses a file. Its kind is told from its first bytes.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason.
    pub(super) fn parse(name: &str, bytes: &[u8]) -> Result<Self> {
        let root = if numpy::is_matrix(bytes) {
            let stem = std::path::Path::new(name).file_stem();
            let stem = stem.map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
            numpy::matrix(bytes).map(|numbers| Value::Object(Map::from_iter([(stem, numbers)])))
        } else if numpy::is_archive(bytes) {
            numpy::archive(bytes).map(Value::Object)
        } else {
            std::str::from_utf8(bytes)
                .map_err(|_| anyhow!("neither text nor npy or npz"))
                .and_then(if name.ends_with(".toml") {
                    parse_toml
                } else {
                    parse_text
                })
        };
        let root = root.with_context(|| format!("cannot read {name}"))?;
        ensure!(
            root.as_object().is_some_and(|entries| !entries.is_empty()),
            "cannot read {name}: there are no entries, as calibrations have"
        );
        Ok(Self {
            name: name.to_owned(),
            root,
        })
    }

    /// The camera that the name of the file names: 0 for `left`, 1 for `right`.
    pub(super) fn side(&self) -> Option<usize> {
        let name = std::path::Path::new(&self.name).file_name()?;
        let name = name.to_string_lossy().to_ascii_lowercase();
        match (name.contains("left"), name.contains("right")) {
            (true, false) => Some(0),
            (false, true) => Some(1),
            _ => None,
        }
    }

    pub(super) fn root(&self) -> Entry<'_> {
        Entry {
            file: &self.name,
            path: String::new(),
            value: &self.root,
        }
    }
}

impl<'a> Entry<'a> {
    /// The entry of this name below this one.
    pub(super) fn get(&self, key: &str) -> Option<Entry<'a>> {
        self.value.get(key).map(|value| self.below(key, value))
    }

    /// The entry of this name below this one.
    ///
    /// # Errors
    /// Fails when there is none.
    pub(super) fn require(&self, key: &str) -> Result<Entry<'a>> {
        self.get(key)
            .ok_or_else(|| self.error(&format!("has no {key}")))
    }

    /// Names and entries below this one; those of a list are named by their number.
    pub(super) fn entries(&self) -> Vec<(String, Entry<'a>)> {
        match self.value {
            Value::Object(entries) => entries
                .iter()
                .map(|(key, value)| (key.clone(), self.below(key, value)))
                .collect(),
            Value::Array(values) => (0..)
                .zip(values)
                .map(|(index, value): (usize, _)| {
                    let key = index.to_string();
                    let entry = self.below(&key, value);
                    (key, entry)
                })
                .collect(),
            _ => Vec::new(),
        }
    }

    /// The text of this entry, if it is text.
    pub(super) fn text(&self) -> Option<&'a str> {
        self.value.as_str()
    }

    /// The numbers of this entry: a number, a list, nested lists row by row, a matrix with `data`, or
    /// text of numbers with blanks between them.
    ///
    /// # Errors
    /// Fails when there is something else, or a number that is not finite, or not as many as a matrix states.
    pub(super) fn list(&self) -> Result<Vec<f64>> {
        let mut numbers = Vec::new();
        collect(self.value, &mut numbers).map_err(|reason| self.error(&reason))?;
        Ok(numbers)
    }

    /// [`Entry::list`] of exactly `N` numbers.
    ///
    /// # Errors
    /// Fails as [`Entry::list`] does, and when there are more or fewer.
    pub(super) fn numbers<const N: usize>(&self) -> Result<[f64; N]> {
        let list = self.list()?;
        let count = list.len();
        list.try_into()
            .map_err(|_| self.error(&format!("has {count} numbers instead of {N}")))
    }

    /// A width and a height, px.
    ///
    /// # Errors
    /// Fails as [`Entry::numbers`] does, and when they are not whole numbers from 1 to 65,535.
    pub(super) fn size(&self) -> Result<[u16; 2]> {
        let [width, height] = self.numbers()?;
        self.side(width)
            .and_then(|width| Ok([width, self.side(height)?]))
    }

    /// A width and a height that are two entries below this one; `None` if there are none.
    ///
    /// # Errors
    /// Fails as [`Entry::size`] does.
    pub(super) fn size_of(&self, width: &str, height: &str) -> Result<Option<[u16; 2]>> {
        match (self.get(width), self.get(height)) {
            (Some(width), Some(height)) => {
                let ([w], [h]) = (width.numbers()?, height.numbers()?);
                Ok(Some([width.side(w)?, height.side(h)?]))
            }
            _ => Ok(None),
        }
    }

    /// An error that names the file and this entry.
    pub(super) fn error(&self, reason: &str) -> anyhow::Error {
        if self.path.is_empty() {
            anyhow!("{}: the file {reason}", self.file)
        } else {
            anyhow!("{}: {} {reason}", self.file, self.path)
        }
    }

    /// Names the file and this entry in an error.
    pub(super) fn within<T>(&self, result: Result<T>) -> Result<T> {
        result.map_err(|error| {
            if self.path.is_empty() {
                anyhow!("{}: {error:#}", self.file)
            } else {
                anyhow!("{}: {}: {error:#}", self.file, self.path)
            }
        })
    }

    fn side(&self, px: f64) -> Result<u16> {
        if px.fract() == 0.0 && (1.0..=65_535.0).contains(&px) {
            Ok(px as u16)
        } else {
            Err(self.error(&format!("is {px}, not a number of pixels")))
        }
    }

    fn below(&self, key: &str, value: &'a Value) -> Entry<'a> {
        let path = if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        };
        Entry {
            file: self.file,
            path,
            value,
        }
    }
}

/// Adds the numbers of a value to a list.
fn collect(value: &Value, numbers: &mut Vec<f64>) -> Result<(), String> {
    let mut add = |number: Option<f64>, text: &dyn std::fmt::Display| match number {
        Some(number) if number.is_finite() && numbers.len() < NUMBERS_MAX => {
            numbers.push(number);
            Ok(())
        }
        _ => Err(format!("has {text} where a finite number belongs")),
    };
    match value {
        Value::Number(number) => add(number.as_f64(), number),
        Value::String(text) => text
            .split_whitespace()
            .try_for_each(|word| add(word.parse().ok(), &word)),
        Value::Array(values) => values.iter().try_for_each(|value| collect(value, numbers)),
        Value::Object(entries) => {
            let before = numbers.len();
            let data = entries
                .get("data")
                .ok_or("is not a matrix: it has no data")?;
            collect(data, numbers)?;
            let mut sides = Vec::new();
            for key in ["rows", "cols"] {
                if let Some(side) = entries.get(key) {
                    collect(side, &mut sides)?;
                }
            }
            let count = (numbers.len() - before) as f64;
            match sides[..] {
                [rows, columns] if rows * columns != count => Err(format!(
                    "states {rows} by {columns} numbers and has {count}"
                )),
                _ => Ok(()),
            }
        }
        Value::Null => Err("has nothing, or no number, where a finite number belongs".to_owned()),
        Value::Bool(_) => Err("has a truth value where a finite number belongs".to_owned()),
    }
}

fn parse_toml(text: &str) -> Result<Value> {
    toml::from_str(text).map_err(|error| anyhow!("{}", error.message()))
}

fn parse_text(text: &str) -> Result<Value> {
    let text = text.trim_start_matches('\u{feff}').trim_start();
    match text.chars().next() {
        Some('<') => parse_xml(text),
        Some('{') => Ok(serde_json::from_str(text)?),
        _ => {
            let options = serde_saphyr::options! {
                // They become null, which is refused if the entry is read.
                non_finite_float_policy: serde_saphyr::options::NonFiniteFloatPolicy::PassThrough,
            };
            serde_saphyr::from_str_with_options(&mended_yaml(text), options).map_err(|error| {
                // The rest of the message shows the lines around.
                let message = error.to_string();
                let first = message.lines().next().unwrap_or("no YAML");
                anyhow!("{}", first.trim_start_matches("error: "))
            })
        }
    }
}

/// YAML as parsers take it. OpenCV's first line, `%YAML:1.0`, is no directive of YAML, and
/// its own reader takes `key:value` without the blank that YAML asks for.
fn mended_yaml(text: &str) -> String {
    let mut mended = String::with_capacity(text.len() + 16);
    for (number, line) in text.lines().enumerate() {
        if number == 0 && line.starts_with("%YAML") {
            mended.push('\n');
            continue;
        }
        let key_end = line.find(':').filter(|&end| {
            let key = line[..end].trim_start();
            let is_name = key.starts_with(|c: char| c.is_ascii_alphabetic())
                && key
                    .chars()
                    .all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '.' | '-'));
            is_name
                && line[end + 1..]
                    .starts_with(|c: char| c.is_ascii_digit() || matches!(c, '[' | '-' | '.'))
        });
        match key_end {
            Some(end) => {
                mended.push_str(&line[..=end]);
                mended.push(' ');
                mended.push_str(&line[end + 1..]);
            }
            None => mended.push_str(line),
        }
        mended.push('\n');
    }
    mended
}

/// An XML file of OpenCV: each element below the root is an entry.
fn parse_xml(text: &str) -> Result<Value> {
    let options = roxmltree::ParsingOptions {
        nodes_limit: 1 << 16,
        ..roxmltree::ParsingOptions::default()
    };
    let document = roxmltree::Document::parse_with_options(text, options)?;
    let root = document.root_element();
    ensure!(
        root.has_tag_name("opencv_storage"),
        "an XML file of <{}>; OpenCV's have <opencv_storage>",
        root.tag_name().name()
    );
    element(root, 0)
}

fn element(node: roxmltree::Node<'_, '_>, depth: usize) -> Result<Value> {
    ensure!(depth < DEPTH_MAX, "elements are nested too deeply");
    if !node.children().any(|child| child.is_element()) {
        return Ok(Value::String(node.text().unwrap_or("").trim().to_owned()));
    }
    let entries = node
        .children()
        .filter(roxmltree::Node::is_element)
        .map(|child| {
            Ok((
                child.tag_name().name().to_owned(),
                element(child, depth + 1)?,
            ))
        });
    Ok(Value::Object(entries.collect::<Result<_>>()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers_of(text: &str, key: &str) -> Result<Vec<f64>> {
        Document::parse("a.yml", text.as_bytes())?
            .root()
            .require(key)?
            .list()
    }

    #[test]
    fn the_dialects_of_opencv_are_read() {
        for head in [
            "%YAML:1.0\n---\n",
            "%YAML:1.0\n",
            "%YAML 1.2\n---\n",
            "---\n",
            "\u{feff}",
        ] {
            for data in [
                "data: [ 1., -2.5e+00,\n       3e-1, .5 ]",
                "data:[1, -2.5, 0.3, 0.5]",
            ] {
                let text = format!(
                    "{head}# a comment\nM1: !!opencv-matrix\n   rows: 2\n   cols: 2\n   dt: d\n   {data}\n\
                     Viewer.PointSize:2\n"
                );
                assert_eq!(numbers_of(&text, "M1").unwrap(), [1.0, -2.5, 0.3, 0.5]);
                assert_eq!(numbers_of(&text, "Viewer.PointSize").unwrap(), [2.0]);
            }
        }
        let xml = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<M1 type_id=\"opencv-matrix\">\n  \
                   <rows>1</rows>\n  <cols>2</cols>\n  <dt>d</dt>\n  <data>\n    1. -2.5e+00</data></M1>\n\
                   </opencv_storage>\n";
        assert_eq!(numbers_of(xml, "M1").unwrap(), [1.0, -2.5]);
        let json = "{\"M1\": {\"type_id\": \"opencv-matrix\", \"rows\": 1, \"cols\": 2, \"data\": [1.0, 2]}}";
        assert_eq!(numbers_of(json, "M1").unwrap(), [1.0, 2.0]);
    }

    #[test]
    fn numbers_that_are_none_or_too_few_are_refused_with_file_and_entry() {
        for (text, words) in [
            ("M1: [1, .nan]", "finite"),
            ("M1: [1, .inf]", "finite"),
            ("M1: [1, x]", "x where a finite number"),
            ("M1: {rows: 2, cols: 2, data: [1, 2, 3]}", "states 2 by 2"),
            ("M1: {rows: 2, cols: 2}", "no data"),
            ("M1: yes", "finite"),
        ] {
            let error = numbers_of(text, "M1").unwrap_err().to_string();
            assert!(
                error.contains("a.yml: M1") && error.contains(words),
                "{text}: {error}"
            );
        }
        // Where no number is read, none is refused.
        assert_eq!(numbers_of("rms: .nan\nM1: [1]", "M1").unwrap(), [1.0]);
        let error = numbers_of("M2: 1", "M1").unwrap_err().to_string();
        assert!(error.contains("a.yml") && error.contains("M1"), "{error}");
        for text in [
            "",
            "[1, 2]",
            "a: [1",
            "<svg></svg>",
            "{\"a\": ",
            "just words",
        ] {
            let error = Document::parse("b.yml", text.as_bytes()).unwrap_err();
            assert!(format!("{error:#}").contains("b.yml"), "{error:#}");
        }
    }
}
