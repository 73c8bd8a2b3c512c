//! The Python tools, run as users run them.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A Python that has what the tools need.
#[derive(Debug, Clone)]
pub struct Python(PathBuf);

/// What a program said, and how it ended.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Exit code; `None` after a signal.
    pub code: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl Python {
    /// The Python that the variable `PYTHON` names, or else `python3`; `None` unless it runs and has what
    /// `tools/requirements.txt` lists.
    #[must_use]
    pub fn find() -> Option<Self> {
        let name = std::env::var_os("PYTHON").unwrap_or_else(|| "python3".into());
        let mut command = Command::new(&name);
        let tried = command.args(["-c", "import cv2, numpy, tqdm"]).output();
        tried
            .is_ok_and(|output| output.status.success())
            .then(|| Self(name.into()))
    }

    /// Runs Python with these arguments, in which the packages of `tools` can be imported.
    ///
    /// # Panics
    /// Panics when it cannot be started.
    #[must_use]
    pub fn run<S: AsRef<OsStr>>(&self, arguments: &[S]) -> Outcome {
        let output = Command::new(&self.0)
            .args(arguments)
            .env("PYTHONPATH", root().join("tools"))
            // Nothing is left in the sources.
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .output()
            .unwrap_or_else(|error| panic!("{}: {error}", self.0.display()));
        let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
        Outcome {
            code: output.status.code(),
            stdout: text(&output.stdout),
            stderr: text(&output.stderr),
        }
    }

    /// Runs `tools/calibrate.py` on a folder of pictures.
    #[must_use]
    pub fn calibrate(&self, folder: &Path, arguments: &[&str]) -> Outcome {
        let tool = root().join("tools/calibrate.py");
        let mut all = vec![tool.as_os_str(), folder.as_os_str()];
        all.extend(arguments.iter().map(OsStr::new));
        self.run(&all)
    }

    /// Renders pairs of a board into a folder, with the cameras as `truth.yml`; the options are those of
    /// `tests/python/render_boards.py`.
    ///
    /// # Panics
    /// Panics when they cannot be rendered.
    pub fn render_boards(&self, folder: &Path, arguments: &[&str]) {
        let script = root().join("tests/python/render_boards.py");
        let mut all = vec![script.as_os_str(), folder.as_os_str()];
        all.extend(arguments.iter().map(OsStr::new));
        let outcome = self.run(&all);
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    }
}

/// The folder of the workspace.
fn root() -> &'static Path {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    tests.parent().unwrap_or(tests)
}
