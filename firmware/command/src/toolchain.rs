//! Finds the compilers and emulators for the boards on this machine, and installs them on
//! Debian.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};

use crate::board::{Board, Processor};

/// Debian's compiler. Its packages bring the source of the standard library.
const DEBIAN_COMPILER: &str = "/usr/bin/rustc";
const DEBIAN_LIBRARY: &str = "/usr/lib/rustlib/src/rust/library/core/src/lib.rs";
const DEBIAN_COMPILER_PACKAGES: [&str; 2] = ["rustc-web", "rust-web-src"];
/// The clippy of Debian's compiler.
const DEBIAN_LINTER: &str = "/usr/bin/cargo-clippy";
const DEBIAN_LINTER_PACKAGE: &str = "rust-web-clippy";

/// Returns the folder of the repository.
pub(crate) fn root() -> &'static Path {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).unwrap_or(own)
}

/// Makes a folder that is built in, if there is none, and waits until no other test or command builds there: none does
/// until the result is closed.
///
/// # Errors
/// Fails with one line when the folder cannot be made or locked.
pub(crate) fn lock(folder: &Path) -> Result<File> {
    let cannot_write = || format!("cannot write {}", folder.display());
    fs::create_dir_all(folder).with_context(cannot_write)?;
    let lock = File::create(folder.join("lock")).with_context(cannot_write)?;
    lock.lock().with_context(cannot_write)?;
    Ok(lock)
}

/// A compiler for a target.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Toolchain {
    /// The compiler that cargo uses, with the target installed by rustup.
    Rustup,
    /// Debian's compiler, which builds the standard library from its source.
    Debian {
        /// The path of LLVM's linker.
        linker: PathBuf,
    },
}

impl Toolchain {
    /// Returns the toolchain for a target; `None` if none is installed.
    ///
    /// # Errors
    /// Fails when there is no Rust compiler at all.
    pub fn find(target: &str) -> Result<Option<Self>> {
        let libraries = sysroot()?.join("lib/rustlib");
        if libraries.join(target).is_dir() {
            return Ok(Some(Self::Rustup));
        }
        let debian = Path::new(DEBIAN_COMPILER).is_file() && Path::new(DEBIAN_LIBRARY).is_file();
        if !debian {
            return Ok(None);
        }
        Ok(linker(&libraries)?.map(|linker| Self::Debian { linker }))
    }

    /// Returns the path of its clippy; `None` if it is not installed.
    ///
    /// # Errors
    /// Fails when there is no Rust compiler at all.
    pub fn linter(&self) -> Result<Option<PathBuf>> {
        let path = match self {
            Self::Rustup => sysroot()?.join("bin/cargo-clippy"),
            Self::Debian { .. } => DEBIAN_LINTER.into(),
        };
        Ok(path.is_file().then_some(path))
    }
}

/// Minor version of Rust 1 that the crate of the chips' models asks for, and of a nightly that
/// builds it too.
const MODEL_STABLE_MINOR: u32 = 98;
const MODEL_NIGHTLY_MINOR: u32 = 97;

/// A compiler for the models of chips, which is newer than that of the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelCompiler {
    /// The one that cargo uses.
    Own,
    /// The nightly that rustup has installed.
    Nightly,
}

impl ModelCompiler {
    /// Returns the compiler for the models; `None` if none is installed.
    #[must_use]
    pub fn find() -> Option<Self> {
        let is_new_enough = |compiler: Self, minor: u32| {
            minor_version(&mut compiler.program("rustc")).is_some_and(|found| found >= minor)
        };
        if is_new_enough(Self::Own, MODEL_STABLE_MINOR) {
            return Some(Self::Own);
        }
        is_new_enough(Self::Nightly, MODEL_NIGHTLY_MINOR).then_some(Self::Nightly)
    }

    /// Returns whether it has a clippy.
    #[must_use]
    pub fn lints(self) -> bool {
        let mut linter = self.program("clippy-driver");
        let output = linter.arg("--version").stderr(Stdio::null()).output();
        output.is_ok_and(|output| output.status.success())
    }

    /// Returns the command that runs its cargo.
    #[must_use]
    pub fn cargo(self) -> Command {
        self.program("cargo")
    }

    /// Returns the options that its cargo takes besides.
    #[must_use]
    pub fn options(self) -> &'static [&'static str] {
        match self {
            Self::Own => &[],
            Self::Nightly => &["--ignore-rust-version"],
        }
    }

    fn program(self, name: &str) -> Command {
        let mut command = match self {
            Self::Own => Command::new(name),
            Self::Nightly => {
                let mut command = Command::new("rustup");
                command.args(["run", "nightly", name]);
                // What cargo tells of the compiler that runs now is not for another.
                for variable in ["CARGO", "RUSTC", "RUSTUP_TOOLCHAIN"] {
                    command.env_remove(variable);
                }
                command
            }
        };
        // Settings for other builds must not change this one.
        for variable in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
            command.env_remove(variable);
        }
        command
    }
}

/// The packages of Debian that simulate boards in RTL, and that install their processors.
const SIMULATOR_PACKAGES: [&str; 4] = ["verilator", "g++", "make", "python3-venv"];

/// What makes programs of boards in RTL.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Simulator {
    /// The path of Verilator.
    pub verilator: PathBuf,
    /// The paths of the processor in Verilog, in the order in which they are read.
    pub processor: Vec<PathBuf>,
}

impl Simulator {
    /// Returns the tools for boards with a processor.
    ///
    /// # Errors
    /// Fails with one line that names what is missing.
    pub fn find(processor: Processor) -> Result<Self> {
        let named = |name: &str| program(name).with_context(|| format!("there is no {name}"));
        let verilator = named("verilator")?;
        named("g++")?;
        named("make")?;
        let sources = sources(processor);
        let processor = sources.with_context(|| format!("there is no {}", processor.name()))?;
        Ok(Self {
            verilator,
            processor,
        })
    }

    /// The folder that boards in RTL are built in.
    #[must_use]
    pub fn folder() -> PathBuf {
        root().join("target/softcore")
    }

    /// The Python environment in which their processors are installed.
    fn environment() -> PathBuf {
        Self::folder().join("python")
    }
}

/// Returns the paths of a processor in Verilog, if it is installed.
fn sources(processor: Processor) -> Option<Vec<PathBuf>> {
    let file = match processor {
        Processor::VexRiscv => "pythondata_cpu_vexriscv/verilog/VexRiscv_FullCfu.v",
        Processor::Cv32e40p => "pythondata_cpu_cv32e40p/system_verilog/cv32e40p_manifest.flist",
    };
    // The folder has the version of Python in its name.
    let versions = fs::read_dir(Simulator::environment().join("lib")).ok()?;
    let mut all = versions.flatten().map(|version| {
        let packages = version.path().join("site-packages");
        packages.join(file)
    });
    let path = all.find(|path| path.is_file())?;
    match processor {
        Processor::VexRiscv => Some(vec![path]),
        Processor::Cv32e40p => {
            let list = fs::read_to_string(&path).ok()?;
            Some(listed(&list, &path.with_file_name("rtl")))
        }
    }
}

/// Returns the files of a list of Verilog's sources that are in its folder of RTL: the others simulate what is around.
fn listed(list: &str, rtl: &Path) -> Vec<PathBuf> {
    let names = list
        .lines()
        .filter_map(|line| line.strip_prefix("${DESIGN_RTL_DIR}/"));
    let names = names.filter(|name| !name.starts_with(".."));
    names.map(|name| rtl.join(name.trim_end())).collect()
}

/// Installs the processors of boards in RTL in a Python environment of their own.
fn install_processor() -> Result<()> {
    let environment = Simulator::environment();
    let requirements = root().join("firmware/boards/softcore/requirements.txt");
    let mut create = Command::new("python3");
    create.args(["-m", "venv"]).arg(&environment);
    let mut install = Command::new(environment.join("bin/pip"));
    install
        .args(["install", "--quiet", "--requirement"])
        .arg(requirements);
    for command in [&mut create, &mut install] {
        let program = command.get_program().display().to_string();
        // Standard output is for results.
        let status = command.stdout(std::io::stderr()).status();
        let status = status.with_context(|| format!("cannot run {program}"))?;
        ensure!(status.success(), "{program} failed");
    }
    Ok(())
}

/// Returns the minor version that a compiler tells; `None` if there is none.
fn minor_version(compiler: &mut Command) -> Option<u32> {
    let output = compiler.arg("--version").stderr(Stdio::null()).output();
    let text = String::from_utf8(output.ok()?.stdout).ok()?;
    let version = text.strip_prefix("rustc 1.")?;
    version.split('.').next()?.parse().ok()
}

/// Returns the path of LLVM's linker: the one that Rust's own toolchain in `libraries` brings,
/// or another on the path.
fn linker(libraries: &Path) -> Result<Option<PathBuf>> {
    let entries =
        fs::read_dir(libraries).with_context(|| format!("cannot read {}", libraries.display()))?;
    let own = entries
        .flatten()
        .map(|host| host.path().join("bin/rust-lld"));
    let mut all = own.chain(["rust-lld", "ld.lld"].into_iter().filter_map(program));
    Ok(all.find(|path| path.is_file()))
}

/// Returns the folder of the compiler that cargo uses.
fn sysroot() -> Result<PathBuf> {
    let compiler = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(&compiler)
        .args(["--print", "sysroot"])
        .output();
    let output = output.with_context(|| format!("cannot run {}", compiler.display()))?;
    ensure!(
        output.status.success(),
        "{} does not tell its folder",
        compiler.display()
    );
    let path = String::from_utf8(output.stdout).context("the compiler's folder is not UTF-8")?;
    Ok(path.trim_end().into())
}

/// Returns where the path has this program; `None` if it does not.
fn program(name: &str) -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let mut all = std::env::split_paths(&folders).map(|folder| folder.join(name));
    all.find(|path| path.is_file())
}

/// Something that boards need to be built, linted or run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Need {
    /// A name for the user.
    pub what: String,
    /// Place at which it was found; `None` if it is missing.
    pub found: Option<String>,
    /// How the user can install it without `setup --install`.
    pub remedy: String,
    /// The packages that have it on Debian.
    pub packages: Vec<&'static str>,
    /// Whether boards are built, and those of QEMU run, without it.
    pub is_optional: bool,
}

/// Returns what a set of boards needs, each need once.
///
/// # Errors
/// Fails when there is no Rust compiler at all.
pub fn needs(boards: &[Board]) -> Result<Vec<Need>> {
    let targets: BTreeSet<_> = boards.iter().map(|board| board.target).collect();
    let emulators: BTreeSet<_> = boards
        .iter()
        .filter_map(|board| board.emulation)
        .map(|emulation| emulation.program)
        .collect();
    let mut needs = Vec::new();
    for target in targets {
        let toolchain = Toolchain::find(target)?;
        let found = toolchain.as_ref().map(|toolchain| match toolchain {
            Toolchain::Rustup => "installed by rustup".to_owned(),
            Toolchain::Debian { linker } => {
                format!(
                    "{DEBIAN_COMPILER} with library source, {}",
                    linker.display()
                )
            }
        });
        let mut packages = DEBIAN_COMPILER_PACKAGES.to_vec();
        if linker(&sysroot()?.join("lib/rustlib"))?.is_none() {
            packages.push("lld");
        }
        needs.push(Need {
            what: format!("Rust for {target}"),
            found,
            remedy: format!("rustup target add {target}"),
            packages,
            is_optional: false,
        });
        let linter = match &toolchain {
            Some(toolchain) => toolchain.linter()?,
            None => None,
        };
        let (remedy, packages) = match toolchain {
            Some(Toolchain::Rustup) => ("rustup component add clippy", vec![]),
            _ => (
                "apt-get install rust-web-clippy",
                vec![DEBIAN_LINTER_PACKAGE],
            ),
        };
        needs.push(Need {
            what: format!("clippy for {target}, only to lint"),
            found: linter.map(|path| path.display().to_string()),
            remedy: remedy.to_owned(),
            packages,
            is_optional: true,
        });
    }
    for emulator in emulators {
        let package = match emulator {
            "qemu-system-arm" => "qemu-system-arm",
            _ => "qemu-system-misc",
        };
        needs.push(Need {
            what: emulator.to_owned(),
            found: program(emulator).map(|path| path.display().to_string()),
            remedy: "install QEMU".to_owned(),
            packages: vec![package],
            is_optional: false,
        });
    }
    for board in boards.iter().filter(|board| board.model.is_some()) {
        needs.push(Need {
            what: format!("Rust for the model of {}, only to run it", board.name),
            found: ModelCompiler::find().map(|compiler| match compiler {
                ModelCompiler::Own => "the compiler that cargo uses".to_owned(),
                ModelCompiler::Nightly => "nightly, installed by rustup".to_owned(),
            }),
            remedy: "rustup toolchain install nightly".to_owned(),
            packages: vec![],
            is_optional: true,
        });
    }
    for board in boards.iter().filter(|board| board.simulation.is_some()) {
        let mut processors = Processor::ALL.into_iter().map(Simulator::find);
        let missing = processors.find_map(Result::err);
        needs.push(Need {
            what: format!("Verilator and processors for {}, only to run it", board.name),
            found: match &missing {
                None => Some(format!("in the path, and in {}", Simulator::environment().display())),
                Some(_) => None,
            },
            remedy: missing.map_or_else(String::new, |missing| {
                format!("{missing}: install Verilator, and firmware/boards/softcore/requirements.txt in target/softcore/python")
            }),
            packages: SIMULATOR_PACKAGES.to_vec(),
            is_optional: true,
        });
    }
    Ok(needs)
}

/// Checks that everything is there to build these boards and to run the emulated ones.
///
/// # Errors
/// Fails with one line that names what is missing and how to install it.
pub fn ensure_complete(boards: &[Board]) -> Result<()> {
    let mut missing = needs(boards)?;
    missing.retain(|need| need.found.is_none() && !need.is_optional);
    if missing.is_empty() {
        return Ok(());
    }
    let named: Vec<_> = missing
        .iter()
        .map(|need| format!("{} ({})", need.what, need.remedy))
        .collect();
    bail!(
        "missing: {}; on Debian, cargo firmware setup --install installs all",
        named.join(", ")
    )
}

/// Installs what is missing for these boards with Debian's `apt-get`, and the processors of boards in RTL
/// with `pip`.
///
/// # Errors
/// Fails when there is no `apt-get` or `pip` or when one of them fails.
pub fn install(boards: &[Board]) -> Result<()> {
    let missing = needs(boards)?
        .into_iter()
        .filter(|need| need.found.is_none());
    let packages: BTreeSet<_> = missing.flat_map(|need| need.packages).collect();
    if !packages.is_empty() {
        apt_get(&["update", "-qq"])?;
        let mut arguments = vec!["install", "-qq", "--yes", "--no-install-recommends"];
        arguments.extend(packages);
        apt_get(&arguments)?;
    }
    let is_simulated = boards.iter().any(|board| board.simulation.is_some());
    let is_complete = Processor::ALL.into_iter().all(|one| sources(one).is_some());
    if is_simulated && !is_complete {
        install_processor()?;
    }
    Ok(())
}

fn apt_get(arguments: &[&str]) -> Result<()> {
    let status = Command::new("apt-get")
        .args(arguments)
        .env("DEBIAN_FRONTEND", "noninteractive")
        // Standard output is for results.
        .stdout(std::io::stderr())
        .status();
    let status = status.context("cannot run apt-get: --install is for Debian")?;
    ensure!(status.success(), "apt-get {} failed", arguments.join(" "));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_of_a_processor_are_those_of_its_folder_in_their_order() {
        let list = "// Comment\n+incdir+${DESIGN_RTL_DIR}/include\n${DESIGN_RTL_DIR}/include/b.sv\n\
                    ${DESIGN_RTL_DIR}/a.sv\n${DESIGN_RTL_DIR}/../bhv/c.sv\n";
        let expected = ["rtl/include/b.sv", "rtl/a.sv"].map(PathBuf::from);
        assert_eq!(listed(list, Path::new("rtl")), expected);
    }

    #[test]
    fn the_compilers_version_is_read() {
        let version = |text: &str| minor_version(Command::new("echo").arg(text));
        assert_eq!(version("rustc 1.97.0-nightly (e50aa6fba)"), Some(97));
        assert_eq!(version("cargo 1.97.0"), None);
        assert_eq!(minor_version(&mut Command::new("no such compiler")), None);
    }
}
