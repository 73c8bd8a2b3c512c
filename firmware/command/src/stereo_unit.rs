//! Drives the stereo unit alone, as Verilator makes a program of it with a memory beside it.

use std::cell::RefCell;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context, Result};
use vgstereo_kernels::Port;

/// Bytes of the memory that runs are placed in, one after another, over and over. More than all that wait at a time.
const MEMORY_BYTES: u32 = 1 << 18;

/// A unit that runs. It ends with its input.
#[derive(Debug)]
pub struct SimulatedUnit(RefCell<Wires>);

#[derive(Debug)]
struct Wires {
    child: Child,
    to_unit: Option<BufWriter<ChildStdin>>,
    from_unit: BufReader<ChildStdout>,
    /// Where the next run is placed.
    free: u32,
}

impl SimulatedUnit {
    /// Starts a program that [`build_unit`](crate::simulation::build_unit) has made.
    ///
    /// # Errors
    /// Fails with one line when it cannot be run.
    pub fn start(program: &Path) -> Result<Self> {
        let mut command = Command::new(program);
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let child = command.spawn();
        let mut child = child.with_context(|| format!("cannot run {}", program.display()))?;
        let to_unit = child.stdin.take().map(BufWriter::new);
        let from_unit = child.stdout.take().context("the unit has no output")?;
        Ok(Self(RefCell::new(Wires {
            child,
            to_unit,
            from_unit: BufReader::new(from_unit),
            free: 0,
        })))
    }
}

impl Wires {
    /// # Panics
    /// When the program has ended.
    fn send(&mut self, bytes: &[u8]) {
        let sent = self.to_unit.as_mut().map(|wire| wire.write_all(bytes));
        assert!(matches!(sent, Some(Ok(()))), "the unit has ended");
    }
}

impl Port for &SimulatedUnit {
    fn read(self, offset: usize) -> u32 {
        let mut wires = self.0.borrow_mut();
        let mut value = [0; 4];
        wires.send(b"r");
        wires.send(&(offset as u16).to_le_bytes());
        let flushed = wires.to_unit.as_mut().map(Write::flush);
        let answered = wires.from_unit.read_exact(&mut value);
        assert!(
            matches!((flushed, answered), (Some(Ok(())), Ok(()))),
            "the unit has ended"
        );
        u32::from_le_bytes(value)
    }

    fn write(self, offset: usize, value: u32) {
        let mut wires = self.0.borrow_mut();
        wires.send(b"w");
        wires.send(&(offset as u16).to_le_bytes());
        wires.send(&value.to_le_bytes());
    }

    fn address(self, bytes: &[u8]) -> u32 {
        let mut wires = self.0.borrow_mut();
        let length = bytes.len() as u32;
        if wires.free + length > MEMORY_BYTES {
            wires.free %= 4;
        }
        let address = wires.free;
        wires.send(b"m");
        wires.send(&address.to_le_bytes());
        wires.send(&length.to_le_bytes());
        wires.send(bytes);
        // Runs begin at every place in a word.
        wires.free += length + 1;
        address
    }
}

impl Drop for SimulatedUnit {
    fn drop(&mut self) {
        let wires = self.0.get_mut();
        // The end of its input ends it.
        drop(wires.to_unit.take());
        let _ended = wires.child.wait();
    }
}
