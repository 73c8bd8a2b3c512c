//! `cargo firmware live`: runs a board that serves the link, until it is ended.

use std::io::{self, Write};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use clap::Args;
use vgstereo_sim::terminal::write_output;

use super::selection::{SoftCore, parse_live_board};
use super::source::{Source, ensure_fits};
use crate::board::Board;
use crate::bridge::Damage;
use crate::build::build;
use crate::live::{Link, LiveBoard};
use crate::model;
use crate::simulation::{self, Scenario};
use crate::toolchain::ensure_complete;

/// How often it is looked whether standard input is closed.
const LOOK: Duration = Duration::from_millis(100);

/// The arguments of `live`.
#[derive(Debug, Args)]
#[command(
    after_help = "Prints `link ADDRESS` when the board has started, and goes on until it is interrupted or, if \
    standard input is a pipe, until that is closed. Hosts may come and go; one is served at a time. docs/link.md \
    has the bytes. Without images, the board sees the built-in scene at 160x120 px.\n\nExample: cargo firmware \
    live --board stm32f405 --listen 127.0.0.1:7878"
)]
pub struct Live {
    /// The board: stm32f405, mps2-an500, mps3-an547, riscv-virt, riscv-virt-zbb, stm32h743 on its model, or softcore in its
    /// simulation. Either of the two takes some 15 s for a frame.
    #[arg(long, value_name = "B", value_parser = parse_live_board)]
    board: Board,
    #[command(flatten)]
    soft_core: SoftCore,
    #[command(flatten)]
    source: Source,
    /// Address at which the link is served; with port 0, a port that is free.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:0")]
    listen: SocketAddr,
    /// Leave out the N-th byte that is sent to hosts, to test these. May be repeated.
    #[arg(long, value_name = "N", help_heading = "Damage")]
    drop_byte: Vec<u64>,
    /// Change a bit of the N-th byte that is sent to hosts, likewise.
    #[arg(long, value_name = "N", help_heading = "Damage")]
    flip_byte: Vec<u64>,
}

impl Live {
    /// Runs the board until it is ended, and returns the text to print then, which is none.
    ///
    /// # Errors
    /// Fails with one line that names the file or option and the reason.
    pub fn run(self) -> Result<String> {
        let board = &self.soft_core.applied(self.board);
        let pair = self.source.pair(board)?;
        let link = Link {
            address: self.listen,
            damage: Damage {
                dropped: self.drop_byte,
                flipped: self.flip_byte,
            },
        };
        let preset = self.source.preset;
        let mut live = if let Some(built_for) = &board.model {
            ensure!(
                preset == built_for.preset && self.source.faults.is_empty(),
                "the firmware of {} is built for {}, and its camera has no faults here",
                board.name,
                built_for.preset
            );
            model::ensure_built_for(built_for, &pair)?;
            ensure_complete(&[*board])?;
            let (program, firmware) = (model::build(board)?, build(board)?);
            LiveBoard::modelled(board, &program, &firmware, &pair, link)?
        } else if board.simulation.is_some() {
            let board = &board.alone(preset)?;
            let scenario = Scenario::of(&self.source.faults)?;
            let request = pair.live_request(preset, &[])?;
            simulation::ensure_built_for(board, &request)?;
            ensure_complete(&[*board])?;
            let (program, firmware) = (simulation::build(board)?, build(board)?);
            LiveBoard::simulated(board, &program, &firmware, &pair, &request, &scenario, link)?
        } else {
            let request = pair.live_request(preset, &self.source.faults)?;
            request.config().validate()?;
            ensure_complete(&[*board])?;
            let firmware = build(board)?;
            ensure_fits(board, &firmware, &pair, &request)?;
            LiveBoard::emulated(board, &firmware, &[pair], &request, link)?
        };
        write_output(format!("link {}\n", live.address()).as_bytes())?;
        io::stdout()
            .flush()
            .context("cannot write to standard output")?;
        let is_over = end_of_input()?;
        while !is_over.load(Ordering::Relaxed) {
            live.wait(LOOK)?;
        }
        Ok(String::new())
    }
}

/// Returns what becomes true when standard input is a pipe and is closed.
fn end_of_input() -> Result<Arc<AtomicBool>> {
    let is_over = Arc::new(AtomicBool::new(false));
    if is_pipe().context("standard input")? {
        let ends = Arc::clone(&is_over);
        thread::spawn(move || {
            // Closed or broken, it is over.
            let _ = io::copy(&mut io::stdin().lock(), &mut io::sink());
            ends.store(true, Ordering::Relaxed);
        });
    }
    Ok(is_over)
}

#[cfg(unix)]
fn is_pipe() -> io::Result<bool> {
    use std::os::fd::AsFd;
    use std::os::unix::fs::FileTypeExt;
    let input = std::fs::File::from(io::stdin().as_fd().try_clone_to_owned()?);
    Ok(input.metadata()?.file_type().is_fifo())
}

#[cfg(not(unix))]
fn is_pipe() -> io::Result<bool> {
    Ok(false)
}
