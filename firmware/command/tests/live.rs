//! `cargo firmware live` from outside: it says where it serves, ends when it is to, and leaves no emulator
//! behind. Listed as ignored where the board cannot be emulated, or processes cannot be looked at.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use libtest_mimic::{Arguments, Failed, Trial};
use vgstereo_boards::board::STM32F405;
use vgstereo_boards::toolchain;

/// Long enough for what is to happen.
const LONG: Duration = Duration::from_secs(60);

type Test = fn() -> Result<(), Failed>;

fn main() {
    let absent = toolchain::ensure_complete(&[STM32F405]).is_err();
    let is_blind = fs::read_to_string("/proc/thread-self/children").is_err();
    let tests: [(&str, Test); 3] = [
        (
            "ends_when_its_input_is_closed",
            ends_when_its_input_is_closed,
        ),
        ("ends_when_it_is_asked_to", ends_when_it_is_asked_to),
        (
            "leaves_nothing_when_it_is_killed",
            leaves_nothing_when_it_is_killed,
        ),
    ];
    let trials =
        tests.map(|(name, test)| Trial::test(name, test).with_ignored_flag(absent || is_blind));
    libtest_mimic::run(&Arguments::from_args(), trials.into()).exit();
}

/// The command, which serves a board, and the process that emulates it.
struct Live {
    command: Child,
    output: BufReader<ChildStdout>,
    emulator: u32,
}

impl Live {
    fn start() -> Result<Self, Failed> {
        let mut command = Command::new(env!("CARGO_BIN_EXE_vgstereo-boards"))
            .args(["live", "--board", "stm32f405"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let mut output = BufReader::new(command.stdout.take().ok_or("no output")?);
        let mut line = String::new();
        output.read_line(&mut line)?;
        let address = line.strip_prefix("link ").ok_or("no address")?;
        // The board speaks.
        let mut host = TcpStream::connect(address.trim_end())?;
        host.set_read_timeout(Some(LONG))?;
        host.read_exact(&mut [0; 100])?;
        let pid = command.id();
        let children = fs::read_to_string(format!("/proc/{pid}/task/{pid}/children"))?;
        let [emulator] = children.split_whitespace().collect::<Vec<_>>()[..] else {
            return Err(format!("children: {children}").into());
        };
        let emulator = emulator.parse()?;
        assert!(runs(emulator));
        Ok(Self {
            command,
            output,
            emulator,
        })
    }

    /// Asserts that the emulator ends.
    fn assert_nothing_left(&self) {
        let begun = Instant::now();
        while runs(self.emulator) {
            assert!(begun.elapsed() < LONG, "the emulator goes on");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// Whether an emulator with this number runs. One that has ended may be listed until it is looked at.
fn runs(pid: u32) -> bool {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    status.starts_with("Name:\tqemu-system") && !status.contains("State:\tZ")
}

fn ends_when_its_input_is_closed() -> Result<(), Failed> {
    let mut live = Live::start()?;
    drop(live.command.stdin.take());
    assert!(live.command.wait()?.success());
    live.assert_nothing_left();
    let mut rest = String::new();
    live.output.read_to_string(&mut rest)?;
    assert_eq!(rest, "", "nothing but the address is printed");
    Ok(())
}

fn ends_when_it_is_asked_to() -> Result<(), Failed> {
    let mut live = Live::start()?;
    let asked = Command::new("kill")
        .args(["-s", "TERM", &live.command.id().to_string()])
        .status()?;
    assert!(asked.success());
    live.command.wait()?;
    live.assert_nothing_left();
    Ok(())
}

fn leaves_nothing_when_it_is_killed() -> Result<(), Failed> {
    let mut live = Live::start()?;
    live.command.kill()?;
    live.command.wait()?;
    live.assert_nothing_left();
    Ok(())
}
