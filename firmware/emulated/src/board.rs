//! A board, and what frames a run of it: the words of the command line, and the report.

use core::mem::MaybeUninit;

use semihosting::fs::File;
use semihosting::io::Error;
use semihosting::process;
use semihosting::sys::arm_compat::sys_get_cmdline_uninit;

use crate::report::Report;
use crate::request::Refusal;
use crate::stack::Stack;
use crate::{REPORT_FILE, sink};

/// Largest length of the command line, bytes.
const COMMAND_LINE_BYTES: usize = 1024;

/// Parts of a run that differ from board to board: counter, port, kernels, memory and stack.
#[derive(Debug)]
pub struct Board<C, U, K> {
    /// The board's name.
    pub name: &'static str,
    /// Counts instructions.
    pub counter: C,
    /// The port to the host.
    pub uart: U,
    /// The kernels of the processor.
    pub kernels: K,
    /// Memory for session and matcher.
    pub memory: &'static mut [u32],
    /// The stack, painted.
    pub stack: Stack,
}

/// Serves a request, writes the report, and ends the emulation.
pub(crate) fn report(stack: Stack, serve: impl FnOnce() -> Result<Report, Refusal>) -> ! {
    let Ok(mut file) = File::create(REPORT_FILE) else {
        process::exit(1);
    };
    let written = match serve() {
        Ok(report) => {
            let stack_bytes = stack.worst_bytes() as u32;
            let report = Report {
                stack_bytes,
                ..report
            };
            report.each(|name, number| write_line(&mut file, name, number))
        }
        Err(Refusal(reason)) => write_all(&mut file, ["error ", reason, "\n"]),
    };
    process::exit(written.is_err().into())
}

/// Returns what `read` makes of the command line without the name of the program; `None` if there is no command line, or
/// `read` returns `None`.
pub(crate) fn of_command_line<R>(read: impl FnOnce(&str) -> Option<R>) -> Option<R> {
    let mut buffer = [MaybeUninit::uninit(); COMMAND_LINE_BYTES];
    let words = sys_get_cmdline_uninit(&mut buffer).ok()?;
    let words = core::str::from_utf8(words).ok()?;
    // The first word is the program's name.
    let (_, words) = words.split_once(' ')?;
    read(words)
}

/// Writes a line of the report. What formats text would take more code than all else here.
fn write_line(file: &mut File, name: &str, number: u64) -> Result<(), Error> {
    // Up to 20 digits, from the end.
    let mut digits = [b'0'; 20];
    let (mut left, mut first) = (number, digits.len());
    for (at, digit) in digits.iter_mut().enumerate().rev() {
        *digit += (left % 10) as u8;
        left /= 10;
        first = at;
        if left == 0 {
            break;
        }
    }
    let digits = digits.get(first..).unwrap_or_default();
    let digits = core::str::from_utf8(digits).unwrap_or_default();
    write_all(file, [name, " ", digits, "\n"])
}

fn write_all<const N: usize>(file: &mut File, texts: [&str; N]) -> Result<(), Error> {
    let mut texts = texts.iter();
    texts.try_for_each(|text| sink::write(file, text.as_bytes()))
}
