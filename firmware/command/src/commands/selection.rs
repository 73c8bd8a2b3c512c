//! The option `--board`, which several verbs take.

use clap::Args;

use crate::board::{Board, UnknownBoard};
use crate::toolchain::ModelCompiler;

/// The option of the verbs that take one board or all boards.
#[derive(Debug, Clone, Args)]
pub struct Selection {
    /// Only this board: stm32f405, mps2-an500, mps3-an547, riscv-virt, riscv-virt-zbb, stm32h743 or stm32f407.
    #[arg(long, value_name = "B", value_parser = parse_board)]
    board: Option<Board>,
}

impl Selection {
    /// Returns the board that was named, or else all boards.
    #[must_use]
    pub fn boards(&self) -> Vec<Board> {
        self.board.map_or(Board::ALL.to_vec(), |board| vec![board])
    }
}

/// The option of the verbs that take one emulated board or all of them.
#[derive(Debug, Clone, Args)]
pub struct EmulatedSelection {
    /// Only this board: stm32f405, mps2-an500, mps3-an547, riscv-virt or riscv-virt-zbb.
    #[arg(long, value_name = "B", value_parser = parse_emulated_board)]
    board: Option<Board>,
}

impl EmulatedSelection {
    /// Returns the board that was named, or else all emulated boards.
    #[must_use]
    pub fn boards(&self) -> Vec<Board> {
        self.board
            .map_or(Board::emulated().collect(), |board| vec![board])
    }
}

/// The option of the verbs that take one board that this machine can run or all of them.
#[derive(Debug, Clone, Args)]
pub struct ExecutedSelection {
    /// Only this board: stm32f405, mps2-an500, mps3-an547, riscv-virt, riscv-virt-zbb or stm32h743.
    #[arg(long, value_name = "B", value_parser = parse_executed_board)]
    board: Option<Board>,
}

impl ExecutedSelection {
    /// Whether one board was named.
    #[must_use]
    pub const fn is_one(&self) -> bool {
        self.board.is_some()
    }

    /// Returns the board that was named, or else all emulated boards, and the modelled ones if
    /// their models can be built.
    #[must_use]
    pub fn boards(&self) -> Vec<Board> {
        let modelled = Board::modelled().filter(|_| ModelCompiler::find().is_some());
        self.board
            .map_or(Board::emulated().chain(modelled).collect(), |board| {
                vec![board]
            })
    }
}

/// Returns the board that has this name.
///
/// # Errors
/// Fails with one line when no board has the name.
pub fn parse_board(name: &str) -> Result<Board, String> {
    name.parse()
        .map_err(|error: UnknownBoard| error.to_string())
}

/// Returns the board that has this name.
///
/// # Errors
/// Fails with one line when no board has the name or when the board is not emulated.
pub fn parse_emulated_board(name: &str) -> Result<Board, String> {
    let board = parse_board(name)?;
    board.emulation().map_err(|error| error.to_string())?;
    Ok(board)
}

/// Returns the board that has this name.
///
/// # Errors
/// Fails with one line when no board has the name or when it runs only as hardware.
pub fn parse_executed_board(name: &str) -> Result<Board, String> {
    let board = parse_board(name)?;
    if !board.is_executed() {
        board.emulation().map_err(|error| error.to_string())?;
    }
    Ok(board)
}
